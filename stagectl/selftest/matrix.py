"""The matrix: each fault in each state, what came of it, and whether that is what the table demands."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.daemon import loop
from stagectl.drives import faults
from stagectl.drives.canopen import CanopenDrive
from stagectl.drives.drive import DriveError, Fault
from stagectl.drives.faults import Row
from stagectl.selftest.limits import Limit, limit, ramp
from stagectl.selftest.rig import Known, Rig, Seen, Sleepy, motions

STATES = ("connecting", "enabling", "holding", "moving", "stopping", "faulted")
_BEFORE = 0.15  # s of holding or moving before the fault
_AFTER = 0.3  # s that a motion which must go on is watched
_REST = 0.2  # s that an axis is watched after the loop has let go of it
_STANDING = 1e-4  # s of the ramp's deceleration: speed below which an axis stands
_PATIENCE = 30.0  # s in which connecting must succeed or be given up
_UNSEEN = 0.05  # s between two looks at the axis after which nothing is known of what was between them
_TRIP = 0x2310
_SUBSTEPS = 2  # a stop is not a matter of nanometres: 2 do as well as 160, see .docs/architecture.md


class Outcome(NamedTuple):
    """One case."""

    name: str
    component: str
    kind: str
    state: str
    passed: bool
    category: int | None  # 0 power was cut in motion, 1 after it stood; None: it did not have to stop
    reason: str  # the loop's, or the error's first words
    stop_time: float | None  # s from the fault to standstill; None: it never moved, or goes on
    stop_time_limit: float | None
    stop_distance: float  # rad | m that the axis went after the fault
    stop_distance_limit: float | None
    words: str  # why it did not pass


class _Case:
    """One fault in one state."""

    def __init__(self, rig: Known, row: Row) -> None:
        self.setup, self.row, self.rig = rig.setup, row, rig
        self.block = faults.default(row.name)
        self.reason, self.begun, self.fault = "", math.nan, Fault.NONE
        self.where = 0.0  # rad | m, of the axis when the fault began
        self.dead = False

    def run(self, state: str) -> None:
        """Go to the state, let the fault begin, and hear out what follows.  Raises nothing."""
        try:
            {"connecting": self._connecting, "enabling": self._enabling}.get(state, lambda: self._enabled(state))()
        except DriveError as error:
            self.reason = str(error)
        alone = "supervision" in self.row.must.noticed  # then the drive stops by its own time-outs
        self.rig.time.sleep(_REST + alone * limit(self.setup, self.row, self.block, self.rig.laid_out.speed).time)
        self.rig.settle()

    def begin(self, cycle: loop.Cycle | None = None) -> None:
        """The fault, now."""
        seen = self.rig.seen
        self.begun, self.where = seen.time, seen.position
        name = self.row.name
        if name == "interface-down":
            self.rig.cut_off()
        elif name == "controller-dead":
            self.dead = True
            self.rig.left_alone()
        elif name == "loop-stalled":
            if cycle is not None and isinstance(cycle.metronome, Sleepy):
                cycle.metronome.extra = self.block.delay
        else:
            self.rig.begin(self.block)

    def _connecting(self) -> None:
        self.begin()
        drive = self._connect()
        drive.enable()
        drive.close()

    def _enabling(self) -> None:
        drive = self._connect()
        self.begin()
        if not self.dead:
            drive.enable()
            drive.close()

    def _connect(self) -> CanopenDrive:
        return self.rig.connect()

    def _enabled(self, state: str) -> None:
        drive = self._connect()
        origin = drive.enable().position
        rows = self.rig.laid_out.holding if state in ("holding", "faulted") else self.rig.laid_out.moving
        cycle = self.rig.cycle(drive, rows, origin)
        self._go(cycle, _BEFORE)
        if state == "faulted":
            self.rig.trip(_TRIP)
            loop.stop(drive, self._go(cycle, _AFTER))
            self.begin()
        elif state == "stopping":
            self.begin(cycle)
            if not self.dead:
                drive.quick_stop()
        else:
            self.begin(cycle)
            self.fault = Fault.NONE if self.dead else self._go(cycle, self._patience())
            if self.fault is not Fault.NONE:
                self.reason = self.fault.name
                loop.stop(drive, self.fault)
        if self.dead:
            self.rig.time.sleep(self._patience())
        elif self.row.must.category is not None or state not in ("holding", "moving") or self.fault:
            drive.close()
        else:
            self.rig.let_go(drive)

    def _go(self, cycle: loop.Cycle, seconds: float) -> Fault:
        """Run the cycle so long, or to its first reason to stop."""
        end, fault = self.rig.time.now() + seconds, Fault.NONE
        while fault is Fault.NONE and self.rig.time.now() < end and cycle.row < cycle.rows:
            fault = cycle()
        return fault

    def _patience(self) -> float:
        if self.row.must.category is None:
            return _AFTER
        return min(limit(self.setup, self.row, self.block, self.rig.laid_out.speed).time + _AFTER, _PATIENCE)


class Bench(NamedTuple):
    """What is tried, on what."""

    rig: Callable[[], Known]  # a new one for each case
    rows: tuple[Row, ...]
    states: tuple[str, ...]
    speed: float  # rad/s | m/s
    mode: str


def virtual(setup: Setup, only: frozenset[str] = frozenset()) -> Bench:
    """All faults, or `only` those of some names, in all states, on the virtual drive in virtual time."""
    simulation = setup.file.simulation._replace(substeps=_SUBSTEPS)
    setup = setup._replace(file=setup.file._replace(simulation=simulation))
    laid_out = motions(setup)
    rows = tuple(row for row in faults.TABLE if not only or row.name in only)
    return Bench(lambda: Rig(setup, laid_out), rows, STATES, laid_out.speed, "virtual drive in virtual time")


def matrix(bench: Bench) -> Iterator[Outcome]:
    """Each fault in each state."""
    for row in bench.rows:
        for state in bench.states:
            case, raised = _Case(bench.rig(), row), ""
            try:
                case.run(state)
            except Exception as error:  # the point of the test is that none gets out of the cycle
                raised = f"{type(error).__name__} was raised: {error}"
                case.rig.settle()
            except BaseException:  # an interrupt: a real axis is not left moving
                case.rig.settle()
                raise
            yield _outcome(case, state, raised)


def _outcome(case: _Case, state: str, raised: str) -> Outcome:
    row, end = case.row, case.rig.seen
    after = [seen for seen in case.rig.trace if seen.time >= case.begun] + [end]
    bound = _limit(case, state)
    stop_time = _stop_time(case, after)
    way = max(abs(seen.position - case.where) for seen in after)
    goes_on = _goes_on(case, state) and not case.fault
    words = raised or _judge(case, state, (after, bound, stop_time, way, goes_on))
    return Outcome(
        row.name,
        row.component,
        row.kind,
        state,
        not words,
        None if goes_on else _category(case, after),
        case.reason,
        None if goes_on else stop_time,
        None if goes_on or bound is None else bound.time,
        way,
        None if goes_on or bound is None else bound.distance,
        words,
    )


def _limit(case: _Case, state: str) -> Limit | None:
    """What is admitted; None where the motion goes on."""
    speed = case.rig.laid_out.speed
    if state in ("connecting", "enabling", "faulted"):
        return Limit(_PATIENCE, _creep(case))
    if state == "holding":
        return limit(case.setup, case.row, case.block, 0.0)._replace(time=_PATIENCE)
    if case.row.must.category is None:
        return ramp(case.setup, speed) if state == "stopping" else None
    return limit(case.setup, case.row, case.block, speed)


def _creep(case: _Case) -> float:
    """What an axis that nobody moves may seem to move (rad | m): the relaxing of its friction."""
    return 4.0 * case.setup.stage.encoder.step + 1e-3 * case.setup.file.limits.following_error


def _goes_on(case: _Case, state: str) -> bool:
    """Whether the axis may go on as if nothing were."""
    must = case.row.must
    if state == "holding":
        return must.holding in ("go on", "either")
    return state == "moving" and must.category is None


def _judge(case: _Case, state: str, seen: tuple[list[Seen], Limit | None, float | None, float, bool]) -> str:
    """Why it did not pass; empty where it did."""
    after, bound, stop_time, way, goes_on = seen
    if goes_on:
        return ""
    if _goes_on(case, state) and case.row.must.category is None:
        return f"stopped by {case.reason}, must go on"
    if bound is None:
        return ""
    if state in ("holding", "moving") and not (case.fault or case.dead):
        return "the loop noticed nothing"
    return _late(after, bound, stop_time, way) or (_wrongly(case, after) if state == "moving" else "") or _held(after)


def _late(after: list[Seen], bound: Limit, stop_time: float | None, way: float) -> str:
    if stop_time is None:
        return f"still moves at {abs(after[-1].velocity):.3g} axis units/s"
    if stop_time > bound.time:  # never where the end was not seen: NaN
        return "too late"
    return "too far" if way > bound.distance else ""


def _wrongly(case: _Case, after: list[Seen]) -> str:
    """Stopped in time, but not for the reason or not in the way that the table says."""
    must = case.row.must
    if must.reasons and not case.dead and case.fault not in must.reasons:
        return f"stopped by {case.reason}, must be one of {', '.join(reason.name for reason in must.reasons)}"
    cut = must.category == 1 and must.brakes == "ramp" and _category(case, after) == 0
    return "the power was cut in motion, must be braked" if cut else ""


def _held(after: list[Seen]) -> str:
    return "the power is still on" if after[-1].powered else ""


def _standing(case: _Case) -> float:
    return case.rig.settings.quick_stop_deceleration * _STANDING


def _stop_time(case: _Case, after: list[Seen]) -> float | None:
    """From the fault to the last motion (s); None where it moves at the end, NaN where nobody saw it stop."""
    moving = [n for n, seen in enumerate(after) if abs(seen.velocity) > _standing(case)]
    if not moving:
        return 0.0
    last = moving[-1]
    if last == len(after) - 1 or after[last].time == after[-1].time:
        return None
    return math.nan if after[last + 1].time - after[last].time > _UNSEEN else after[last].time - case.begun


def _category(case: _Case, after: list[Seen]) -> int:
    """0 where the axis moved on without power."""
    return 0 if any(not seen.powered and abs(seen.velocity) > 2.0 * _standing(case) for seen in after) else 1
