"""The columns of any file, and which is which.

Time runs evenly, a velocity is a derivative, a reference is followed, an effort drives.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl.number_format import percent
from stagectl.recording import constants
from stagectl.recording.columns import Array
from stagectl.recording.guess import motion, units
from stagectl.recording.guess.names import Column, by_name, hinted, may_drive


class Role(NamedTuple):
    """What a column is taken for."""

    column: Column
    sure: float  # 0 to 1
    why: str
    ratio: float = 0.0  # of a velocity: d position/dt over it; of an effort: the sign with which it drives

    @property
    def rough(self) -> float:
        """How noisy its column is."""
        return motion.roughness(self.column.values)


def live(columns: Sequence[Column]) -> list[Column]:
    """Columns that vary, each once."""
    kept: list[Column] = []
    for column in columns:
        values = column.values
        varies = bool(np.all(np.isfinite(values))) and float(np.ptp(values)) > 0.0
        if varies and not any(np.array_equal(values, other.values) for other in kept):
            kept.append(column)
    return kept


def time_of(columns: Sequence[Column]) -> Role | None:
    """The column that runs on evenly; None where none does."""
    running = []
    for column in columns:
        steps = np.diff(column.values)
        if np.all(steps >= 0.0):
            uneven = float(np.std(steps) / np.mean(steps))
            running.append((uneven - hinted(column, "time"), uneven, column))
    if not running:
        return None
    _, uneven, column = min(running, key=lambda entry: entry[0])
    named = hinted(column, "time")
    clear = named or uneven < constants.EVEN_STEPS or len(running) == 1
    sure = constants.SURE_BY_NAME if clear else constants.SURE_BY_MAGNITUDE
    return Role(column, sure, "its header says time" if named else "it runs on")


def beside(columns: Sequence[Column], time: Column) -> list[Column]:
    """The other columns; of a file with several variables those in one table with the time, where it has three."""
    table = time.name.partition("[")[0]
    same = [column for column in columns if "[" in time.name and column.name.startswith(f"{table}[")]
    return [column for column in (same if len(same) > 2 else columns) if column is not time]


def position_and_velocity(columns: Sequence[Column], blocks: motion.Blocks) -> tuple[Role | None, Role | None]:
    """The pair of which one is the other's derivative, the longest travel first; else what names and smoothness say.

    A column that is called a position comes before the others, whatever is the derivative of what.
    """
    pairs, free = [], [c for c in columns if not any(hinted(c, other) for other in ("velocity", "effort", "no effort"))]
    named = _named(free)
    for x in named or free:
        for v in columns:
            if x is v or hinted(v, "effort"):
                continue
            ratio, share = motion.derivative(blocks, x.values, v.values)
            if share >= constants.DERIVATIVE:
                worth = float(np.ptp(x.values)) * (0.5 if hinted(x, "reference") else 1.0)
                pairs.append((worth, share, ratio, x, v))
    if not pairs:
        return _alone(columns, named, blocks)
    derived = {pair[4].name for pair in pairs}  # a force is often the derivative of a velocity
    pairs = [pair for pair in pairs if pair[3].name not in derived] or pairs
    longest = max(pair[0] for pair in pairs)
    _, share, ratio, x, v = max((pair for pair in pairs if pair[0] > 0.9 * longest), key=lambda pair: pair[1])
    why = f"{100.0 * share:.3g} % of its way is the integral of {v.name}"
    return Role(x, constants.SURE_BY_PHYSICS, why), Role(v, constants.SURE_BY_PHYSICS, f"it is {x.name}'s", ratio)


def _named(columns: Sequence[Column]) -> list[Column]:
    """Columns that are called a position, else those in a unit of one."""
    measured = [column for column in columns if not hinted(column, "reference")]
    called = [column for column in measured if hinted(column, "position")]
    return called or [column for column in measured if units.said(column.words, "position")]


def _smoothest(columns: Sequence[Column]) -> Column:
    return min(columns, key=lambda column: motion.roughness(column.values))


def _alone(
    columns: Sequence[Column], named: Sequence[Column], blocks: motion.Blocks
) -> tuple[Role | None, Role | None]:
    """A position without a velocity, one of those that are `named` so, or a velocity without a position."""
    if named:
        position = _smoothest(named)
        if hinted(position, "position"):
            return Role(position, constants.SURE_BY_NAME, "its header says position"), None
        return Role(position, constants.SURE_BY_MAGNITUDE, "it is the smoothest in a unit of a position"), None
    free = [column for column in columns if not hinted(column, "effort")] or list(columns)
    if called := [column for column in free if hinted(column, "velocity") and not hinted(column, "reference")]:
        return None, Role(_smoothest(called), constants.SURE_BY_NAME, "its header says velocity", 1.0)
    smoothest = _smoothest(free)
    others = [column.values for column in columns if column is not smoothest]
    as_velocity, as_position = (
        max((motion.drives(blocks, speed, other).share for other in others), default=0.0)
        for speed in (
            motion.mean(blocks, smoothest.values),
            motion.change(blocks, smoothest.values) / blocks.duration,
        )
    )
    if as_velocity > as_position + constants.CLEARLY_MORE:
        why = f"it explains {100.0 * as_velocity:.3g} % of another column as its velocity"
        return None, Role(smoothest, constants.SURE_BY_MAGNITUDE, why, 1.0)
    return Role(smoothest, constants.SURE_BY_MAGNITUDE, "it is the smoothest column"), None


def reference_of(columns: Sequence[Column], position: Column) -> tuple[Role, Column] | None:
    """The reference and the position, of two columns that follow each other; None where none does."""
    following = [
        (share, column)
        for column in columns
        if column is not position and (share := motion.follows(column.values, position.values)) > _least(column)
    ]
    if not following:
        return None
    share, other = max(following, key=lambda entry: entry[0])
    turned = hinted(position, "reference") or (
        not hinted(other, "reference") and motion.roughness(other.values) > motion.roughness(position.values)
    )
    reference, measured = (position, other) if turned else (other, position)
    named = hinted(reference, "reference")
    why = "its header says reference" if named else f"the position follows it within {percent(max(1.0 - share, 0.0))}"
    return Role(reference, constants.SURE_BY_NAME if named else constants.SURE_BY_MAGNITUDE, why), measured


def _least(column: Column) -> float:
    """The share of a position that `column` must hold to be its reference: less where its words say that it is one."""
    named = hinted(column, "reference") and not hinted(column, "effort")
    return constants.FOLLOWS_BY_NAME if named else constants.FOLLOWS


def of_one_axis(columns: Sequence[Column], position: Role, velocity: Role | None, width: int) -> list[Column]:
    """The columns of the position's axis, where several axes repeat as far apart as its position and velocity are.

    `width` is the number of columns in the file.
    """
    names = [position.column.name, velocity.column.name if velocity else ""]
    if velocity is None or not all(name.isdecimal() for name in names):
        return list(columns)
    first, second = (int(name) for name in names)
    apart = abs(second - first)
    same = [c for c in columns if c.name.isdecimal() and (int(c.name) - first) % apart == 0]
    repeats = apart >= constants.LEAST_AXES and width // apart >= constants.LEAST_QUANTITIES
    return same if repeats and same else list(columns)


def efforts(columns: Sequence[Column], blocks: motion.Blocks, speed: Array) -> list[Role]:
    """What may drive the motion with the blocks' `speed` (b,), the likeliest measured current first."""
    roles = [_as_effort(column, motion.drives(blocks, speed, column.values)) for column in filter(may_drive, columns)]
    best = max(roles, key=lambda role: (by_name(role.column), role.sure), default=None)
    if best is None:
        return []
    if best.sure < constants.LEAST_DRIVE:
        return [best._replace(why=f"nothing else is left, and {best.why}")] if len(roles) == 1 else []
    alike = [role for role in roles if role is best or together(blocks, role, best) > constants.GOES_WITH]
    return sorted(alike, key=_measured_first)


def _as_effort(column: Column, drive: motion.Drive) -> Role:
    """A name is not sure of a sign, and a motion that explains little of a column does not turn it."""
    sure, why = min(drive.share, constants.SURE_BY_PHYSICS), f"the motion explains {100.0 * drive.share:.3g} % of it"
    turned = drive.sign < 0.0
    if hinted(column, "effort"):
        why = f"its header says what drives, {why}"
        sure = max(sure, constants.SURE_BY_DEFAULT) if turned else constants.SURE_BY_NAME
    if turned and drive.share < constants.LEAST_SURE:
        return Role(column, sure, f"{why}, and seems to oppose it: check the sign", 1.0)
    return Role(column, sure, why, drive.sign)


def ahead(first: Role, second: Role) -> bool:
    """Whether the first of two columns changes before the second, as a command does."""
    a, b = (role.column.values - role.column.values.mean() for role in (first, second))
    later, earlier = (
        sum(float(np.dot(p[:-k], q[k:])) for k in range(1, constants.LEAD_ROWS)) for p, q in ((a, b), (b, a))
    )
    return later > (1.0 + constants.LEADS) * earlier


def together(blocks: motion.Blocks, first: Role, second: Role) -> float:
    """Correlation of two columns, in blocks."""
    a, b = (motion.mean(blocks, role.column.values) for role in (first, second))
    return float(np.corrcoef(a, b)[0, 1]) if np.ptp(a) > 0.0 and np.ptp(b) > 0.0 else 0.0


def _measured_first(role: Role) -> tuple[tuple[bool, ...], bool, float]:
    """Names come first, then noise, which shows what was measured; whole numbers without a unit come last."""
    whole = bool(np.all(role.column.values == np.rint(role.column.values)))
    return tuple(not has for has in by_name(role.column)), whole, -role.rough
