"""Parameters that are off, as entries of the verdict: each by its name, with its alternatives and its patch."""

from collections.abc import Sequence

from stagectl.gap.effects import library
from stagectl.gap.effects.effect import Data
from stagectl.gap.inference.parameter_errors import Shift, common, of_force, shared
from stagectl.gap.inference.patch_fields import fields_of
from stagectl.gap.logs.session import Session
from stagectl.gap.result.diagnosis import Fields, FoundEffect, Value
from stagectl.gap.selection.refine import Fitted

ALL_OF_FORCE = "inertia_and_all_friction"  # what a force constant scales, as one alternative
COORDINATES = {"inertia": "acceleration", "viscous": "speed", "coulomb": "direction"}


def shifted(session: Session, shifts: Sequence[Shift], now: Fitted) -> list[FoundEffect]:
    """The parameters that are off, the largest shares first.

    A common scale of inertia, viscous and Coulomb friction is that of the force constant, and replaces them.
    """
    scale = common(shifts)
    if scale is not None:
        rest = [shift for shift in shifts if shift.sure and shift.name not in library.FORCE_SCALED]
        surest = min(shift.probability for shift in shifts if shift.name in library.FORCE_SCALED)
        return [_force_constant(session, scale, surest, now), *(_shifted(session, shift, now) for shift in rest)]
    sure = sorted((shift for shift in shifts if shift.sure), key=lambda shift: -shift.share)
    effects = [_shifted(session, shift, now) for shift in sure]
    # The part that they share may as well be the force constant's.
    alike = shared(shifts) | ({sure[0].name} if _same_sign(sure) else frozenset())
    return [
        effect._replace(alternatives=(*effect.alternatives, "force_constant")) if effect.name in alike else effect
        for effect in effects
    ]


def _same_sign(sure: Sequence[Shift]) -> bool:
    """Whether inertia, viscous and Coulomb friction have all shifted the same way."""
    changes = [shift.change for shift in of_force(sure)]
    return len(changes) == 3 and len({change > 0.0 for change in changes}) == 1


def _force_constant(session: Session, shift: Shift, probability: float, now: Fitted) -> FoundEffect:
    """The common shift as that of the force constant; inertia and all friction can stand in its place together."""
    nominal, fitted = session.stage, now.model.stage
    mechanics = nominal.mechanics._replace(inertia=fitted.mechanics.inertia, viscous=fitted.mechanics.viscous)
    together = nominal._replace(mechanics=mechanics, friction=fitted.friction)
    value = nominal.motor.force_constant * (1.0 + shift.change)
    return FoundEffect(
        "force_constant",
        (*library.look_alikes("force_constant", Data.ALL), ALL_OF_FORCE),
        probability,
        shift.share,
        {"change": shift.value},
        fields=(("motor.force_constant", value),),
        choices=((ALL_OF_FORCE, fields_of(nominal, together)),),
        parameter=True,
    )


def _shifted(session: Session, shift: Shift, now: Fitted) -> FoundEffect:
    low, high = ((end - shift.value.value) / shift.scale for end in (shift.value.low, shift.value.high))
    unit = "periods" if shift.name == "time_shift" else ""  # it is relative to the control period
    change = Value(shift.change, shift.change + low, shift.change + high, unit)
    return FoundEffect(
        shift.name,
        tuple(dict.fromkeys((*shift.alike, *_alternatives(session, shift.name)))),
        shift.probability,
        shift.share,
        {shift.name: shift.value, "change": change},
        block=library.EFFECTS[shift.name].block,
        fields=_fields(session, shift, now),
        parameter=True,
        coordinate=COORDINATES.get(shift.name, "none"),
    )


def _alternatives(session: Session, name: str) -> tuple[str, ...]:
    """What causes the same shift."""
    unmeasured = any(log.current is None or not log.commanded for log in session.logs)
    data = Data.ONE_SPEED | Data.WITHOUT_CURRENT if unmeasured else Data.ONE_SPEED
    return tuple(sorted(library.look_alikes(name, data)))


def _fields(session: Session, shift: Shift, now: Fitted) -> Fields:
    if shift.name in ("inertia", "viscous", "bias"):
        return ((f"mechanics.{shift.name}", shift.value.value),)
    if shift.name == "dead_time":
        return fields_of(session.stage, session.stage._replace(drive=now.model.stage.drive))
    if shift.name in ("coulomb", "presliding"):
        return fields_of(session.stage, session.stage._replace(friction=now.model.stage.friction))
    return ()
