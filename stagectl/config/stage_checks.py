"""What entries of a stage file must hold together, although each is admissible by itself."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from stagectl.config.bounds import DELAY_LINE, WIDEST_SLIPS
from stagectl.config.compensator_checks import compensator_conflicts
from stagectl.config.friction_laws import Operators, Rolling
from stagectl.config.stage_blocks import StageFile
from stagectl.config.time_outs import too_far
from stagectl.config.wire_checks import wire_conflicts
from stagectl.drives.drive import Canopen
from stagectl.number_format import duration
from stagectl.problem import Problem, ProblemKind
from stagectl.units import LINEAR

_CONFLICT = ProblemKind.CONFLICT


def conflicts(file: StageFile, path: Path) -> Iterator[Problem]:
    """Everything in `file`, read from `path`, that contradicts something else there."""
    yield from _encoder(file)
    yield from _limits(file)
    yield from _homing(file)
    yield from _brake(file)
    yield from _drive(file)
    yield from _transmission(file)
    yield from _friction(file)
    yield from compensator_conflicts(file)
    yield from wire_conflicts(file, path)
    yield from too_far(file)


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
        unit = "m" if axis.kind == LINEAR else "rad"
        reason = f"must be at most limits.following_error, {moving:g} {unit}"
        yield Problem(reason, _CONFLICT, "limits.following_error_at_rest", f"{at_rest:g} {unit}", unit)


def _brake(file: StageFile) -> Iterator[Problem]:
    if file.brake.present and not isinstance(file.drive.wire, Canopen):
        reason = "a brake is worked by a CANopen drive, or by its outputs"
        yield Problem(reason, _CONFLICT, "brake.control", file.brake.control)


def _homing(file: StageFile) -> Iterator[Problem]:
    homing = file.homing
    if homing.by_drive and not isinstance(file.drive.wire, Canopen):
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
    if drive.current_limit <= drive.continuous_current < math.inf:
        reason = f"must be below drive.current_limit, {drive.current_limit:g} A, from which the drive folds back to it"
        current = f"{drive.continuous_current:g} A"
        yield Problem(reason, _CONFLICT, "drive.continuous_current", current, "A", f"(0, {drive.current_limit:g})")


def _transmission(file: StageFile) -> Iterator[Problem]:
    p = file.mechanics.transmission
    if (p.load_share > 0.0 or p.backlash > 0.0) and not (p.load_share > 0.0 and p.resonance > 0.0):
        reason = (
            "needs load_share and resonance, both above 0: without them motor and load are one body, and there is no "
            "backlash between them"
        )
        yield Problem(reason, _CONFLICT, "mechanics.transmission")


def _friction(file: StageFile) -> Iterator[Problem]:
    law = file.friction
    if isinstance(law, Rolling) and not law.shortest <= law.longest <= WIDEST_SLIPS * law.shortest:
        yield Problem(f"must be 1 to {WIDEST_SLIPS:g} times friction.shortest", _CONFLICT, "friction.longest")
    if isinstance(law, Operators) and len(law.weight) != len(law.slip):
        reason = f"has {len(law.weight)} entries, and friction.slip has {len(law.slip)}: give one slip for each weight"
        yield Problem(reason, _CONFLICT, "friction.weight")
