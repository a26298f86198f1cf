"""The matrix: each fault in each state, what came of it, and whether that is what the table demands."""

import hashlib
import math
import platform
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from stagectl.config.machine_file import text_of
from stagectl.config.stage_file import Setup
from stagectl.drives import faults
from stagectl.drives.faults import FaultType
from stagectl.realtime.states import State
from stagectl.recording.metadata import STAMP
from stagectl.selftest.case import GOVERNED, MOVES, Case, named
from stagectl.selftest.limits import Limit
from stagectl.selftest.rig import AxisSample, BaseRig, Rig, Service, laid_out, usual
from stagectl.typed_json import plain

_STANDING = 1e-4  # s of the ramp's deceleration: speed below which an axis stands
UNSEEN = 0.05  # s between two looks at the axis after which nothing is known of what was between them
_SUBSTEPS = 2  # a stop is not a matter of nanometres: 2 do as well as 160, see docs/architecture.md


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


class Bench(NamedTuple):
    """What is tried, on what."""

    rig: Callable[[], tuple[BaseRig, Service]]  # a new one for each case
    rows: tuple[FaultType, ...]
    states: tuple[State, ...]
    speed: float  # rad/s | m/s
    mode: str


def virtual(setup: Setup, only: frozenset[str] = frozenset()) -> Bench:
    """All faults, or `only` those of some names, in all states, on the virtual drive in virtual time."""
    setup = setup.having(simulation=setup.file.simulation._replace(substeps=_SUBSTEPS))
    pace = usual(setup)
    service, rows = laid_out(setup, pace), tuple(row for row in faults.TABLE if not only or row.name in only)
    # An axis without a brake is in the first one for no period, and only its drive's homing leads to the second.
    reached = {State.ENGAGING: setup.file.brake.present, State.DRIVE_HOMING: setup.file.homing.by_drive}
    states = tuple(state for state in State if reached.get(state, True))
    return Bench(lambda: (Rig(setup), service), rows, states, pace.speed, "virtual drive in virtual time")


def matrix(bench: Bench) -> Iterator[Outcome]:
    """Each fault in each state."""
    for row in bench.rows:
        for state in bench.states:
            tried, raised = Case(*bench.rig(), row, state), ""
            try:
                tried.run()
            except Exception as error:  # the point of the test is that none gets out of the cycle
                raised = f"{type(error).__name__} was raised: {error}"
                tried.rig.settle()
            except BaseException:  # an interrupt: a real axis is not left moving
                tried.rig.settle()
                raise
            yield _outcome(tried, raised)


def _outcome(tried: Case, raised: str) -> Outcome:
    row, end = tried.row, tried.rig.seen
    after = [seen for seen in tried.rig.trace if tried.begun <= seen.time <= tried.until] + [end]
    bound = tried.admitted
    stop_time = _stop_time(tried, after)
    way = max(abs(seen.position - tried.where) for seen in after)
    goes_on = tried.may_go_on and not tried.fault
    words = raised or "" if goes_on else _judge(tried, after, bound, (stop_time, way))
    return Outcome(
        row.name,
        row.component,
        row.kind,
        named(tried.state),
        not words,
        None if goes_on else _category(tried, after),
        tried.reason,
        None if goes_on else stop_time,
        None if goes_on or bound is None else bound.time,
        way,
        None if goes_on or bound is None else bound.distance,
        words,
    )


def _judge(tried: Case, after: list[AxisSample], bound: Limit | None, went: tuple[float | None, float]) -> str:
    """Why it did not pass, as far as it `went` after the fault (s, rad | m); empty where it did."""
    if tried.may_go_on and tried.row.required.category is None:
        return f"stopped by {tried.reason}, must go on"
    if bound is None:
        return ""
    if tried.state in GOVERNED and not (tried.fault or tried.dead):
        return "the loop noticed nothing"
    late = _late(after, bound, *went)
    held = "the power is still on" if after[-1].powered else ""
    return late or (_wrongly(tried, after) if tried.state in MOVES else "") or held or tried.wrong


def _late(after: list[AxisSample], bound: Limit, stop_time: float | None, way: float) -> str:
    if stop_time is None:
        return f"still moves at {abs(after[-1].velocity):.3g} axis units/s"
    if stop_time > bound.time:  # never where the end was not seen: NaN
        return "too late"
    return "too far" if way > bound.distance else ""


def _wrongly(tried: Case, after: list[AxisSample]) -> str:
    """Stopped in time, but not for the reason or not in the way that the table says."""
    must = tried.row.required
    if must.reasons and not tried.dead and tried.fault not in must.reasons:
        return f"stopped by {tried.reason}, must be one of {', '.join(reason.name for reason in must.reasons)}"
    cut = must.category == 1 and must.brakes == "ramp" and _category(tried, after) == 0
    return "the power was cut in motion, must be braked" if cut else ""


def _standing(tried: Case) -> float:
    return tried.rig.settings.quick_stop_deceleration * _STANDING


def _stop_time(tried: Case, after: list[AxisSample]) -> float | None:
    """From the fault to the last motion (s); None where it moves at the end, NaN where nobody saw it stop."""
    moving = [n for n, seen in enumerate(after) if abs(seen.velocity) > _standing(tried)]
    if not moving:
        return 0.0
    last = moving[-1]
    if last == len(after) - 1 or after[last].time == after[-1].time:
        return None
    return math.nan if after[last + 1].time - after[last].time > UNSEEN else after[last].time - tried.begun


def _category(tried: Case, after: list[AxisSample]) -> int:
    """0 where the axis moved on without power."""
    return 0 if any(not seen.powered and abs(seen.velocity) > 2.0 * _standing(tried) for seen in after) else 1


def run(setup: Setup, tried: Bench, signed: str, command: str, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Run the matrix; `faults` is the list of all cases, in axis units."""
    total, cases = len(tried.rows) * len(tried.states), []
    for outcome in matrix(tried):
        cases.append(plain(outcome))
        progress(len(cases), total)
    passed = sum(case["passed"] for case in cases)
    axis = setup.file.axis
    return {
        "stage": setup.file.name,
        "file": setup.path.name,
        "file_digest": hashlib.sha256(text_of(setup.path).encode()).hexdigest(),
        "mode": tried.mode,
        "created": time.strftime(STAMP),
        "host": platform.node(),
        "signed": signed,
        "command": command,
        "words": _words(passed, total),
        "speed": tried.speed * axis.travel_per_unit,
        "unit": axis.travel_unit,
        "travel_per_unit": axis.travel_per_unit,
        "passed": passed,
        "faults": cases,
    }


def _words(passed: int, total: int) -> str:
    if passed == total:
        return f"All {total} cases ended as they must: in the state, within the time and within the distance."
    return f"{total - passed} of {total} cases did not end as they must."
