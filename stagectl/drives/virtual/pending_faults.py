"""Faults on demand in the virtual drive: which wait, and which act."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from stagectl.drives.bus.faulty_bus import Undo
from stagectl.drives.canopen import cia402
from stagectl.drives.virtual.fault_actions import DEEDS, Machine


class _Acting(NamedTuple):
    block: Any
    until: float  # s; 0: for good
    undo: Undo


class Faults:
    """The faults of one virtual drive."""

    def __init__(self, machine: Machine, report: Callable[[str], None]) -> None:
        """`report` gets, in words, what begins and what is over."""
        self._machine, self._report = machine, report
        self._standing: tuple[Any, ...] = ()
        self._waiting: list[tuple[float, Any]] = []
        self._acting: list[_Acting] = []
        self._enabled = False

    def standing(self, blocks: Iterable[Any]) -> None:
        """Faults that begin so long after each time that Operation enabled is reached from a reset."""
        self._standing = tuple(blocks)
        self._enabled = False

    def add(self, block: Any, now: float) -> None:
        """A fault that begins so long after `now` (s)."""
        self._waiting.append((now + block.after, block))
        self.look(now)

    def begin(self, block: Any, now: float) -> None:
        """A fault that begins now, whatever its `after`."""
        self._report(f"fault begins: {block.fault}")
        undo = DEEDS[block.fault](self._machine, block, now)
        self._acting.append(_Acting(block, now + block.duration if block.duration else 0.0, undo))

    def clear(self) -> None:
        """Undo all that acts, forget all that waits."""
        self._waiting.clear()
        acting, self._acting = self._acting, []
        for each in acting:
            self._end(each)

    def renew(self) -> None:
        """As after power-on: the standing faults wait for Operation enabled again; others stay as they are."""
        self._enabled = False
        self._waiting = [(at, each) for at, each in self._waiting if each not in self._standing]
        over = [each for each in self._acting if each.block in self._standing]
        self._acting = [each for each in self._acting if each not in over]
        for each in over:
            self._end(each)

    @property
    def active(self) -> list[str]:
        """Names of the faults that act."""
        return [acting.block.fault for acting in self._acting]

    def look(self, now: float) -> None:
        """Begin and end what is due at `now` (s)."""
        if self._standing and not self._enabled and self._machine.axis.state is cia402.State.OPERATION_ENABLED:
            self._enabled = True
            self._waiting += [(now + block.after, block) for block in self._standing]
        if not (self._waiting or self._acting):
            return
        over = [each for each in self._acting if each.until and each.until <= now]
        self._acting = [each for each in self._acting if each not in over]
        for each in over:
            self._end(each)
        due = [each for at, each in self._waiting if at <= now]
        self._waiting = [(at, each) for at, each in self._waiting if at > now]
        for block in due:
            self.begin(block, now)
        self._machine.repeats.look(now)

    def _end(self, acting: _Acting) -> None:
        acting.undo()
        self._report(f"fault is over: {acting.block.fault}")
