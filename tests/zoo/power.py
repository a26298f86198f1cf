"""The CiA 402 state machine of a foreign drive, with its ramps, in the terms of CiA 402-2, clause 4."""

from __future__ import annotations

import enum
import time
from collections.abc import Callable


class State(enum.Enum):
    """States with their bits of the statusword."""

    SWITCH_ON_DISABLED = 0x0040
    READY_TO_SWITCH_ON = 0x0021
    SWITCHED_ON = 0x0023
    OPERATION_ENABLED = 0x0027
    QUICK_STOP_ACTIVE = 0x0007
    FAULT_REACTION_ACTIVE = 0x000F
    FAULT = 0x0008

    @property
    def title(self) -> str:
        """As in the standard, in lower case."""
        return self.name.lower().replace("_", " ")


POWERED = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE)
RAMPS = (State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE)
_S = State
_UPWARD = (State.READY_TO_SWITCH_ON, State.SWITCHED_ON, State.OPERATION_ENABLED)
_VOLTAGE_OFF = {_S.READY_TO_SWITCH_ON, _S.SWITCHED_ON, _S.OPERATION_ENABLED, _S.QUICK_STOP_ACTIVE}
_ORDERS: tuple[tuple[int, int, dict[State, State]], ...] = (  # mask, bits, transitions; the first match counts
    (0x02, 0x00, dict.fromkeys(_VOLTAGE_OFF, _S.SWITCH_ON_DISABLED)),  # disable voltage: 7, 9, 10, 12
    (0x06, 0x02, {_S.READY_TO_SWITCH_ON: _S.SWITCH_ON_DISABLED, _S.SWITCHED_ON: _S.SWITCH_ON_DISABLED,
                  _S.OPERATION_ENABLED: _S.QUICK_STOP_ACTIVE}),  # quick stop: 7, 10, 11
    (0x07, 0x06, {_S.SWITCH_ON_DISABLED: _S.READY_TO_SWITCH_ON, _S.SWITCHED_ON: _S.READY_TO_SWITCH_ON,
                  _S.OPERATION_ENABLED: _S.READY_TO_SWITCH_ON}),  # shutdown: 2, 6, 8
    (0x0F, 0x07, {_S.READY_TO_SWITCH_ON: _S.SWITCHED_ON, _S.OPERATION_ENABLED: _S.SWITCHED_ON}),  # 3, 5
    (0x0F, 0x0F, {_S.READY_TO_SWITCH_ON: _S.SWITCHED_ON, _S.SWITCHED_ON: _S.OPERATION_ENABLED}),  # 3, 4
)  # fmt: skip


class Power:
    """The state, and what leads to another one."""

    def __init__(self, note: Callable[..., None], reset_hold: float, transition_time: float) -> None:
        """In Switch on disabled; `note` writes the diary; each step towards power takes `transition_time` (s)."""
        self.state, self.since = State.SWITCH_ON_DISABLED, 0.0  # and the time at which it was entered
        self._transition_time = transition_time
        self.may_enable = True  # a lack of the variant may forbid it
        self._note = note
        self._hold = reset_hold
        self._controlword = 0
        self._pressed: float | None = None  # since when bit 7 is set
        self.cause = False  # of a fault: it is still there

    def to(self, state: State, why: str) -> None:
        """Enter a state."""
        if state is not self.state:
            self.state, self.since = state, time.monotonic()
            self._note("state", state=state.title, why=why)

    def order(self, controlword: int, now: float) -> None:
        """A controlword that has come by PDO or SDO."""
        rising = controlword & ~self._controlword & 0x80
        if not controlword & 0x80:
            self._pressed = None
        elif rising:
            self._pressed = now
        self._controlword = controlword
        self.hold(now)
        self._obey(now)

    def _obey(self, now: float) -> None:
        controlword = self._controlword
        for mask, bits, transitions in _ORDERS:
            if controlword & mask == bits:
                self._follow(transitions, now)
                return

    def hold(self, now: float) -> None:
        """Reset the fault once bit 7 has been set for long enough; go on with a step that takes its time."""
        if self._transition_time:
            self._obey(now)
        if (
            self.state is State.FAULT
            and not self.cause
            and self._pressed is not None
            and now - self._pressed >= self._hold
        ):
            self._pressed = None
            self.to(State.SWITCH_ON_DISABLED, "fault reset")

    def _follow(self, transitions: dict[State, State], now: float) -> None:
        target = transitions.get(self.state)
        if target is None or (target is State.OPERATION_ENABLED and not self.may_enable):
            return
        if target in _UPWARD and self.state not in POWERED and now - self.since < self._transition_time:
            return
        self.to(target, f"controlword 0x{self._controlword:04X}")

    def trip(self, reaction: int, why: str) -> None:
        """A fault; `reaction` is 0x605E: 0 cuts the power, others brake first."""
        braking = reaction > 0 and self.state in POWERED
        self.to(State.FAULT_REACTION_ACTIVE if braking else State.FAULT, why)

    def ramp_over(self, quick_stop_option: int) -> None:
        """The axis has come to rest under the drive's own ramp."""
        if self.state is State.FAULT_REACTION_ACTIVE:
            self.to(State.FAULT, "ramp over")
        elif self.state is State.QUICK_STOP_ACTIVE and quick_stop_option < 5:
            self.to(State.SWITCH_ON_DISABLED, "ramp over")
