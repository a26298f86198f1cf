"""What a drive's faults mean, in plain words, with the probable causes and the next step."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeGuard

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.drive import DriveError, Fault, Feedback

_RESET = "`stagectl fault reset`, or `stagectl run ... --reset-fault`"


class Emergency(NamedTuple):
    """An emergency message (EMCY, CiA 301)."""

    code: int  # emergency error code
    register: int  # error register 0x1001
    vendor: bytes  # five bytes of the maker's own


class Deviation(NamedTuple):
    """What the master saw for itself; `causes` take the place of those of the fault."""

    words: str
    causes: str = ""
    alone: bool = False  # the fault's own words add nothing

    def filled(self, *values: object) -> Deviation:
        """The same with `values` in its words."""
        return self._replace(words=self.words.format(*values))


class DriveSigns(NamedTuple):
    """What is known of a drive when its fault is explained."""

    problem: Deviation | None
    emergency: Emergency | None
    answered: bool  # it has answered a SYNC since it was configured
    heartbeat_age: float  # s; NaN: none was heard
    nmt: int | None  # NMT state in its last heartbeat
    alive: bool  # its heartbeat was heard after its last answer: power, wiring and bit rate are right


class FoundState(NamedTuple):
    """A drive as its set-up found it; None: it does not say."""

    statusword: int | None = None
    error_code: int | None = None  # 0x603F


MUTE = Deviation("its heartbeat was not heard for {:.2f} s while its answers went on", alone=True)
LEFT_OPERATIONAL = Deviation(
    "it left the NMT state operational (its heartbeat says {})",
    "Probable causes: another master, or a tool on the bus, gave it an NMT command, or the drive changed its state by"
    f" itself after an error (0x1029). Take the other one off the bus, then reset: {_RESET}",
)
OTHER_CONTROLLER = Deviation(
    "another controller is on the bus: {}",
    f"Two controllers must not command one drive. Stop the other one, then reset: {_RESET}",
)
OTHER_MAPPING = Deviation("its TPDO has {} bytes, must have {}; probable cause: another master mapped it")
WRONG_MODE = Deviation(
    "its mode of operation is {} (0x6061), must be {} (10: cyclic synchronous torque, 6: homing)",
    "Probable causes: a service tool or another controller wrote 0x6060, or an input of the drive selects the mode."
    f" Take it away, then reset: {_RESET}",
)
UNSHOWN_MODE = Deviation(
    "it has power, but shows the mode of operation {} (0x6061) where 10 (cyclic synchronous torque) was ordered",
    "Probable causes: the drive does not take the mode (0x6060), or its firmware does not report it. Compare both with"
    " `stagectl drive dump STAGE.yaml`; a drive that does not show its mode is not moved",
)
UNTAKEN_MODE = Deviation(
    "it does not take the mode of operation {} (0x6060) under power, but shows {} (0x6061)",
    "Probable causes: the drive changes its mode only without power, or an input selects it. See the drive's manual, or"
    " home by another homing.method",
)
UNTAKEN_BRAKE = Deviation(
    "its brake was to be {}, but the digital outputs (0x60FE) do not show it",
    "Probable causes: the drive answers no SDO, an input or its own program works the output, or its mask (0x60FE:02)"
    " is another. Look whether the brake holds, then compare with `stagectl drive dump STAGE.yaml`",
)
HOMING_FAILED = Deviation(
    "it reports an error of its homing (statusword bit 13)",
    "Probable causes: homing.number (0x6098) is a method that it does not have, its switch or index is not connected,"
    " or the direction is wrong. Compare with the drive's manual, then `stagectl fault reset`",
)
LOST_BITS = {
    9: Deviation(
        "it is no longer under remote control (statusword bit 9, remote)",
        "Probable causes: its panel or its service tool has taken control, or an input selects local operation. Give"
        f" control back to the bus, then reset: {_RESET}",
    ),
    12: Deviation(
        "it no longer follows the command (statusword bit 12)",
        "Probable causes: a limit inside the drive, a stop by one of its inputs, or another mode of operation. Read its"
        f" display and 0x6061, then reset: {_RESET}",
    ),
}
_SILENT_PDO = (
    "Probable causes: the drive is not operational, its TPDO has another COB-ID or mapping than 'tpdo' here,"
    " or is not sent at each SYNC, for instance for its inhibit time. Compare 0x1800 and 0x1A00 with"
    " `stagectl drive dump STAGE.yaml`"
)

FAULTS = {
    Fault.NONE: Deviation("no fault", "Nothing to be done"),
    Fault.FEEDBACK_LOST: Deviation(
        "no answer to SYNC within the time-out",
        "Probable causes: drive without power, cable or termination, another node with the same id, or a bus that is"
        " too busy. Check the wiring",
    ),
    Fault.DRIVE_FAULT: Deviation(
        "the drive left Operation enabled",
        "Probable causes: the drive's own limits, its enable or STO input, or its time-outs (heartbeat, RPDO). Look at"
        f" its display, remove the cause, then reset: {_RESET}",
    ),
    Fault.EMERGENCY: Deviation(
        "the drive sent an emergency",
        f"Probable causes are in the drive's manual under this code. Remove the cause, then reset: {_RESET}",
    ),
    Fault.BUS: Deviation(
        "the bus failed",
        "Probable causes: interface down or bus off. See 'ip -details link', and bring it up again",
    ),
    Fault.REBOOTED: Deviation(
        "the drive booted in mid operation",
        "Probable causes: a dip of its supply, its watchdog, or an NMT reset by another master. Its configuration and"
        f" its origin are gone with it. Check the supply, then configure it anew: {_RESET}",
    ),
    Fault.HOMING: Deviation("its homing (mode of operation 6) has failed", HOMING_FAILED.causes),
}
_HINTS = {
    DriveState.NOT_READY: (
        "Probable causes: the drive still initialises, or has no logic supply. Wait, then read its display"
    ),
    DriveState.SWITCH_ON_DISABLED: (
        "Probable causes: no DC link voltage, STO open, or the enable input missing. Close STO"
    ),
    DriveState.READY: "Probable cause: no DC link voltage. Switch the power supply on",
    DriveState.SWITCHED_ON: (
        "Probable causes: the enable input is missing or the brake or encoder is not ready. See the drive's display"
    ),
    DriveState.FAULT: f"A fault is reset by a person alone. Remove its cause, then reset: {_RESET}",
}


def state_words(statusword: int) -> str:
    """State of the drive with its statusword."""
    return f"{cia402.state(statusword).words} (statusword 0x{statusword:04X})"


def emergency_words(emergency: Emergency) -> str:
    """The emergency with the meaning of its code."""
    code, register, vendor = emergency
    meaning = cia402.emergency(code)
    return f"emergency 0x{code:04X} ({meaning}), error register 0x{register:02X}, vendor's bytes {vendor.hex(' ')}"


def standing_fault(node: int, statusword: int | None, found: FoundState, signs: DriveSigns) -> str:
    """A drive without power that is in Fault: what it reports, how a person resets it; empty for other states."""
    if not _is_fault(statusword):
        return ""
    error = found.error_code if _is_fault(found.statusword) else None  # one that comes later: by its emergency
    code = None if error is None else f"error code 0x603F = 0x{error:04X} ({cia402.emergency(error)})"
    emergency = emergency_words(signs.emergency) if signs.emergency else None
    parts = filter(None, (f"node {node} is in state {state_words(statusword)}", code, emergency))
    return f"{'; '.join(parts)}. {_HINTS[DriveState.FAULT]}"


def _is_fault(statusword: int | None) -> TypeGuard[int]:
    return statusword is not None and cia402.state(statusword) is DriveState.FAULT


def not_reset(node: int, statusword: int, found: FoundState, signs: DriveSigns) -> DriveError:
    """The error of a drive whose fault stays when it is reset."""
    reported = standing_fault(node, statusword, found, signs)
    return DriveError(
        f"the fault reset had no effect: the cause is still there. {reported}",
        node=node,
        object_key=cia402.STATUSWORD << 8,
        value=statusword,
    )


def not_enabled(node: int, last: Feedback, signs: DriveSigns) -> str:
    """Why a drive does not become enabled, with probable causes and the next step."""
    problem, emergency = signs.problem, signs.emergency
    reported = emergency_words(emergency) if emergency else "no emergency was sent"
    parts = filter(None, (_state(last, signs), problem and problem.words, reported))
    hint = _HINTS.get(cia402.state(last.statusword), FAULTS[Fault.DRIVE_FAULT].causes)
    causes = _causes(last, signs) if last.fault is Fault.FEEDBACK_LOST or problem else hint
    enabled = cia402.state(last.statusword) is DriveState.OPERATION_ENABLED
    missed = "is not ready" if enabled else "does not reach Operation enabled"
    return f"node {node} {missed} in time: it remains in {'; '.join(parts)}. {causes}"


def explained(node: int, last: Feedback, signs: DriveSigns) -> str:
    """The fault of the `last` feedback with its probable causes."""
    problem, emergency, heartbeat_age = signs.problem, signs.emergency, signs.heartbeat_age
    said = problem.words if problem else ""
    parts = [said] if problem and problem.alone else [_what(last, signs), said]
    parts.append(f"state {_state(last, signs)}")
    if emergency is not None:
        parts.append(emergency_words(emergency))
    if not math.isnan(heartbeat_age):
        left = "" if signs.nmt in (None, cia402.OPERATIONAL) else f": {nmt_words(signs.nmt or 0)}"
        parts.append(f"last heartbeat of the drive {heartbeat_age:.2f} s ago{left}")
    return f"node {node}: {'; '.join(filter(None, parts))}. {_causes(last, signs)}"


def nmt_words(state: int) -> str:
    """An NMT state of a heartbeat (CiA 301) in words."""
    return cia402.NMT_WORDS.get(state, f"unknown, 0x{state:02X}")


def _what(last: Feedback, signs: DriveSigns) -> str:
    if last.fault is Fault.FEEDBACK_LOST and not signs.answered:
        return "it has never answered a SYNC"
    enabled = cia402.state(last.statusword) is DriveState.OPERATION_ENABLED
    if last.fault is Fault.DRIVE_FAULT and signs.problem and enabled:
        return ""  # it has not left Operation enabled: the problem says what is wrong
    return FAULTS[last.fault].words


def _state(last: Feedback, signs: DriveSigns) -> str:
    """Its state; a drive that has answered nothing has shown none."""
    if signs.answered or last.statusword:
        return state_words(last.statusword)
    return "a state that is not known, as it has never answered a SYNC"


def _causes(last: Feedback, signs: DriveSigns) -> str:
    if signs.problem and signs.problem.causes:
        return signs.problem.causes
    if last.fault is Fault.FEEDBACK_LOST and signs.alive:
        return f"Its heartbeat goes on, so power, wiring and bit rate are right. {_SILENT_PDO}"
    if last.fault is Fault.FEEDBACK_LOST and not signs.answered:
        return f"{_SILENT_PDO}; or power, cable or termination"
    return FAULTS[last.fault].causes
