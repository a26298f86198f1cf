"""What entries of a stage file must hold together, although each is admissible by itself; what looks like a slip."""

import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_type_hints

from stagectl.compensation.rolling import GeneralisedMaxwell, ReversalTable
from stagectl.config.bounds import DELAY_LINE, SAME_VALUE, WIDEST_SLIPS
from stagectl.config.friction_laws import Operators, Rolling, friction_of
from stagectl.config.stage_blocks import StageFile
from stagectl.config.time_outs import too_far
from stagectl.config.wire_checks import wire_conflicts
from stagectl.drives.drive import Canopen
from stagectl.kernels.effects import TURN
from stagectl.kernels.equilibrium import weight
from stagectl.kernels.stage import Stage, sliding
from stagectl.number_format import duration
from stagectl.problem import Problem, ProblemKind
from stagectl.units import LINEAR, ROTARY, unit_on

TOO_DAMPED = 20.0  # times the current's force, that the damping may take at limits.speed; chosen: a slip is 1000
_CONFLICT = ProblemKind.CONFLICT


def conflicts(file: StageFile, path: Path) -> Iterator[Problem]:
    """Everything in `file`, read from `path`, that contradicts something else there."""
    checks = (_encoder, _limits, _homing, _drive, _transmission, _residual, _friction, _unanswered, _compensators)
    for check in checks:
        yield from check(file)
    yield from wire_conflicts(file, path)
    yield from too_far(file)


def _unanswered(file: StageFile) -> Iterator[Problem]:
    for place in file.control.unanswered:
        if not _in_model(place):
            reason = "must be a part of the stage model: of motor, mechanics, friction, drive, encoder, or residual"
            yield Problem(reason, _CONFLICT, "control.unanswered", place)


def _in_model(place: str) -> bool:
    """Whether the stage model has a field at this dotted place; an entry of a law, as friction.coulomb, is none."""
    block: Any = Stage
    for name in place.split("."):
        block = get_type_hints(block).get(name) if hasattr(block, "_fields") else None
    return block is not None


def _encoder(file: StageFile) -> Iterator[Problem]:
    encoder, axis = file.encoder, file.axis
    if (encoder.counts_per_revolution is None) == (encoder.step is None):
        yield Problem("needs exactly one of counts_per_revolution and step", _CONFLICT, "encoder")
    if axis.kind == LINEAR and (axis.lead or encoder.counts_per_revolution):
        yield Problem("a lead and counts_per_revolution belong to a rotary axis", _CONFLICT, "axis.kind", axis.kind)


def _limits(file: StageFile) -> Iterator[Problem]:
    axis, limits = file.axis, file.limits
    low, high = (end * axis.travel_per_unit for end in limits.travel)
    if low >= high:
        value, unit = f"[{low:g}, {high:g}] {axis.travel_unit}", axis.travel_unit
        yield Problem("the first must be below the second", _CONFLICT, "limits.travel", value, unit)
    at_rest, moving = limits.following_error_at_rest, limits.following_error
    if at_rest is not None and at_rest > moving:
        unit = unit_on(axis.kind, "rad | m")
        reason = f"must be at most limits.following_error, {moving:g} {unit}"
        yield Problem(reason, _CONFLICT, "limits.following_error_at_rest", f"{at_rest:g} {unit}", unit)
    yield from _following_error(file)


def _following_error(file: StageFile) -> Iterator[Problem]:
    """The encoder must see less than the limit, and the travel must hold more."""
    axis, limits, count = file.axis, file.limits, file.encoder.one_count
    span = limits.travel[1] - limits.travel[0]
    if span > 0.0 and not count < limits.following_error < span:
        least, error, most = (size * axis.travel_per_unit for size in (count, limits.following_error, span))
        given = "step" if file.encoder.step else f"counts_per_revolution = {file.encoder.counts_per_revolution}"
        reason = f"must be more than one count of encoder.{given}, and less than the span of limits.travel"
        interval, unit = f"({least:.4g}, {most:.4g})", axis.travel_unit
        yield Problem(reason, _CONFLICT, "limits.following_error", f"{error:g} {unit}", unit, interval)


def _homing(file: StageFile) -> Iterator[Problem]:
    """Homing, and the brake: both need a drive that works them."""
    homing, canopen = file.homing, isinstance(file.drive.wire, Canopen)
    if file.brake.present and not canopen:
        reason = "a brake is worked by a CANopen drive, or by its outputs"
        yield Problem(reason, _CONFLICT, "brake.control", file.brake.control)
    if homing.by_drive and not canopen:
        yield Problem("only a CANopen drive finds its home itself", _CONFLICT, "homing.method", homing.method)
    if homing.by_drive and homing.number == 0:
        yield Problem("needs homing.number, the drive's method (0x6098)", _CONFLICT, "homing.method", homing.method)
    if not homing.moves:
        return
    if homing.speed == 0.0 or homing.distance == 0.0:
        reason = "needs homing.speed, whose sign is the direction, and homing.distance"
        yield Problem(reason, _CONFLICT, "homing.method", homing.method)
    elif homing.method == "current" and homing.current == 0.0:
        yield Problem("needs homing.current", _CONFLICT, "homing.method", homing.method)


def _drive(file: StageFile) -> Iterator[Problem]:
    drive, period = file.drive, file.control.period
    longest = (DELAY_LINE - drive.delay_samples) * period
    if drive.dead_time > longest:
        reason = f"the plant holds {DELAY_LINE} control periods, and drive.delay_samples takes {drive.delay_samples}"
        dead_time = duration(drive.dead_time)
        yield Problem(reason, _CONFLICT, "drive.dead_time", dead_time, "s", f"[0, {longest:g}]")
    if drive.telemetry.late > period:
        reason, late = "longer than control.period", duration(drive.telemetry.late)
        yield Problem(reason, _CONFLICT, "drive.telemetry.late", late, "s", f"[0, {period:g}]")
    if 1.0 + drive.gain - abs(drive.gain_asymmetry) <= 0.0:
        reason = f"with drive.gain = {drive.gain:g} commands of one sign would give no current, or one against them"
        most = f"({-1.0 - drive.gain:g}, {1.0 + drive.gain:g})"
        yield Problem(reason, _CONFLICT, "drive.gain_asymmetry", f"{drive.gain_asymmetry:g}", "", most)
    yield from _continuous(file)
    yield from _held(file)


def _continuous(file: StageFile) -> Iterator[Problem]:
    """A current that may flow forever lies below the peak: else what watches it never acts."""
    most = file.drive.current_limit
    for key, current, otherwise in (
        ("drive.continuous_current", file.drive.continuous_current, "from which the drive folds back to it"),
        ("limits.continuous_current", file.limits.continuous_current, "or the motor's I2t never trips"),
    ):
        if current is not None and most <= current < math.inf:
            reason = f"must be below drive.current_limit, {most:g} A, {otherwise}"
            yield Problem(reason, _CONFLICT, key, f"{current:g} A", "A", f"(0, {most:g})")


def _held(file: StageFile) -> Iterator[Problem]:
    """Friction that the drive's current cannot overcome: either of the two may be the mistake."""
    friction, limit = sliding(friction_of(file.friction)), file.drive.current_limit
    most = limit * file.motor.force_constant
    if most > friction:
        yield from _damped(file, most - friction)
        return
    unit = unit_on(file.axis.kind, "N m | N")
    key = "friction.coulomb" if hasattr(file.friction, "coulomb") else "friction.weight"
    reason = "more than drive.current_limit overcomes, so the axis cannot move"
    yield Problem(reason, _CONFLICT, key, f"{friction:.4g} {unit}", unit, f"[0, {most:.4g})")
    reason, holding = f"does not overcome {key}", friction / file.motor.force_constant
    yield Problem(reason, _CONFLICT, "drive.current_limit", f"{limit:g} A", "A", f"({holding:.4g}, inf)")


def _damped(file: StageFile, left: float) -> Iterator[Problem]:
    """Damping that takes many times the current at a limits.speed which the travel has room for."""
    viscous, speed = file.mechanics.viscous, file.limits.speed
    if viscous * speed > TOO_DAMPED * left and not never_reached(file):
        unit = unit_on(file.axis.kind, "N m s/rad | N s/m")
        most = TOO_DAMPED * left / speed
        reason = f"takes {viscous * speed / left:.3g} times the force of drive.current_limit at limits.speed"
        yield Problem(reason, _CONFLICT, "mechanics.viscous", f"{viscous:g} {unit}", unit, f"[0, {most:.4g}]")


def _transmission(file: StageFile) -> Iterator[Problem]:
    p = file.mechanics.transmission
    if (p.load_share > 0.0 or p.backlash > 0.0) and not (p.load_share > 0.0 and p.resonance > 0.0):
        reason = "needs load_share and resonance, both above 0"
        why = "without them motor and load are one body, and there is no backlash between them"
        yield Problem(f"{reason}: {why}", _CONFLICT, "mechanics.transmission")


def _residual(file: StageFile) -> Iterator[Problem]:
    """A rotary axis repeats after a turn; what a linear one repeats over must be given."""
    over = "" if file.residual is None else file.residual.coordinate
    if over == "position_mod_pitch" and file.axis.kind == LINEAR and file.mechanics.pitch == TURN:
        reason = "needs mechanics.pitch, the travel over which the axis repeats"
        yield Problem(reason, _CONFLICT, "residual.coordinate", over)


def _friction(file: StageFile) -> Iterator[Problem]:
    law = file.friction
    if isinstance(law, Rolling) and not law.shortest <= law.longest <= WIDEST_SLIPS * law.shortest:
        shortest, longest = map(file.axis.travel.length, (law.shortest, law.longest))
        reason = f"must be 1 to {WIDEST_SLIPS:g} times friction.shortest, {shortest}"
        yield Problem(reason, _CONFLICT, "friction.longest", longest, file.axis.travel_unit)
    if isinstance(law, Operators):
        yield from _paired("friction", law, "weight", "slip")


def _compensators(file: StageFile) -> Iterator[Problem]:
    """Conflicts of the compensator that acts, and of those next to it."""
    compared = {f"compensators.{name}": block for name, block in file.compensators._asdict().items()}
    for name, block in {"compensation": file.compensation, **compared}.items():
        if isinstance(block, ReversalTable):
            yield from _table(block, name)
        elif isinstance(block, GeneralisedMaxwell):
            yield from _paired(name, block, "weight", "slip")


def _table(p: ReversalTable, name: str) -> Iterator[Problem]:
    """A curve from -T_c to T_c over a displacement that rises from 0."""
    unequal = list(_paired(name, p, "force", "displacement"))
    yield from unequal
    if unequal:
        return
    if p.displacement[0] != 0.0 or len(p.displacement) < 2 or not _rises(p.displacement, strictly=True):
        reason = "must begin with 0 and rise from row to row, over two rows at least"
        yield Problem(reason, _CONFLICT, f"{name}.displacement")
    first, last = p.force[0], p.force[-1]
    if not _rises(p.force) or last <= 0.0 or abs(first + last) > SAME_VALUE * last:
        reason = f"must rise from -T_c to T_c; it goes from {first:g} to {last:g}"
        yield Problem(reason, _CONFLICT, f"{name}.force")


def _paired(name: str, block: Any, one: str, other: str) -> Iterator[Problem]:
    """Two lists of the block `name` that must be of the same length."""
    count, others = len(getattr(block, one)), len(getattr(block, other))
    if count != others:
        reason = f"has {count} entries, and {name}.{other} has {others}: give one {other} for each {one}"
        yield Problem(reason, _CONFLICT, f"{name}.{one}")


def _rises(values: tuple[float, ...], strictly: bool = False) -> bool:
    steps = [after - before for before, after in itertools.pairwise(values)]
    return all(step > 0.0 if strictly else step >= 0.0 for step in steps)


def doubtful(file: StageFile) -> str:
    """What to say of entries that are admissible together, and yet a slip of the unit rather than a machine."""
    return stops_beyond(file) or never_reached(file)


def decelerations(file: StageFile) -> dict[str, float]:
    """What each of the entries that brake the axis allows (rad/s^2 | m/s^2); the least of them decides."""
    stated, pull = file.limits.deceleration, weight(file.mechanics)
    effort = max(file.drive.current_limit * file.motor.force_constant - pull, 0.0)
    ramp = "drive.wire.quick_stop_deceleration" if isinstance(file.drive.wire, Canopen) else "limits.acceleration"
    return {
        **({} if stated is None else {"limits.deceleration": stated}),
        ramp: file.own_ramp,
        "mechanics.inertia, motor.force_constant, drive.current_limit": effort / file.mechanics.inertia,
    }


def stops_beyond(file: StageFile) -> str:
    """What to say of an axis that cannot be stopped within its travel; empty where it can.

    Such an entry is a slip of the unit rather than a machine; where each way to brake is too weak, it is the speed.
    """
    (low, high), half, every = file.limits.travel, 0.5 * file.limits.speed**2, decelerations(file)
    weak = {entry: most for entry, most in every.items() if most * (high - low) < half}
    if not weak:
        return ""
    travel, least = file.axis.travel, min(weak.values())
    needed, room = map(travel.length, (half / least if least > 0.0 else math.inf, high - low))
    named = (entry if "," in entry else f"{entry} = {travel.length(most, '/s^2')}" for entry, most in weak.items())
    suspects = f"the unit of {', '.join(named)}" if len(weak) < len(every) else "limits.speed and limits.travel"
    return f"from limits.speed the axis stops within {needed}, and limits.travel is {room}: check {suspects}"


def never_reached(file: StageFile) -> str:
    """What to say of a travel too short for limits.speed: to accelerate and to brake needs more; empty elsewhere."""
    limits, axis = file.limits, file.axis
    needed, room = limits.speed**2 / limits.acceleration, limits.travel[1] - limits.travel[0]
    if needed <= room:
        return ""
    speed = axis.travel.length(limits.speed, "/s")
    way, travel = map(axis.travel.length, (needed, room))
    bare = "; a number without a unit is rad at the motor" if axis.kind == ROTARY and axis.lead else ""
    return (
        f"limits.speed = {speed} is never reached: to accelerate and to brake takes {way}, and limits.travel is "
        f"{travel}: check their units{bare}"
    )
