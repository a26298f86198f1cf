"""The nominal model of the machine, from a nominal.yaml to the plant's parameters."""

import math

from stagectl.gap.logs.nominal_values import Block, quantity
from stagectl.gap.logs.session import NominalValueError
from stagectl.gap.logs.thresholds import NOTED_SUM, WRONG_SUM
from stagectl.kernels import friction, friction_bristle, stage
from stagectl.kernels.effects import TURN, Harmonic
from stagectl.units import LINEAR, Quantity

# The friction of a model that gives none: nothing rubs, and how far it moves before it slips is not known.
FREE = stage.Friction(friction.bundle([0.0], [1.0]), friction.Stribeck())
_STOPS = ("stop-operator", "maxwell-slip", "gms")
_LAWS = (*_STOPS, "dahl", "lugre", "none")
_KEYS = {
    "stage": "name kind position_unit torque_unit force_constant rated_current inertia viscous bias travel_per_unit_mm "
    "pitch encoder_step encoder_periods_per_pitch accuracy",
    "friction": "law weight slip coulomb stribeck stiffness exponent damping viscous bristle",
    "drive": "current_loop_s delay_samples resistance_ohm back_emf_V_per_unit_s current_limit_A voltage_limit_V "
    "amplifier_A_per_V current_quantum_A",
}

STAGE_KEYS = tuple(_KEYS["stage"].split())
STAGE_WORDS = ("name", "kind", "position_unit", "torque_unit", "accuracy")  # of these, those that are no numbers


def read(file: Block) -> stage.Stage:
    """The model in a nominal.yaml; defaults taken and doubts are added to the block's `defaults` and `notes`.

    Raises NominalValueError where a value is missing, not physical or contradicts another.
    """
    body, rubbing, drive = (file.block(name) for name in ("stage", "friction", "drive"))
    for part in (body, rubbing, drive):
        part.ignore_others(_KEYS[part.name].split())
    _check_units(body)
    return stage.Stage(
        _drive(drive, 1 if file.block("controller").has("Ts") else 0),
        stage.Motor(body.number("force_constant", quantity(stage.Motor, "force_constant"))),
        _mechanics(body, rubbing),
        _friction(rubbing),
        _encoder(body, _late(file)),
    )


def _check_units(body: Block) -> None:
    expected = ("N",) if body.kind == LINEAR else ("Nm", "N m", "N*m")
    unit = body.values.get("torque_unit")
    if unit is not None and unit not in expected:
        raise body.refused("torque_unit", f"must be {expected[0]}: convert the values of {body.place.name}")


def _mechanics(body: Block, rubbing: Block) -> stage.Mechanics:
    inertia, bias = body.fields(stage.Mechanics, "inertia", bias=0.0)
    pitch = body.number("pitch", quantity(stage.Mechanics, "pitch"), TURN)
    return stage.Mechanics(inertia, _viscous(body, rubbing), bias, pitch)


def _viscous(body: Block, rubbing: Block) -> float:
    """The viscous friction, from the stage or from the friction: many count it there."""
    given = [block for block in (body, rubbing) if block.has("viscous")]
    viscous, *others = (block.number("viscous", quantity(stage.Mechanics, "viscous"), 0.0) for block in given or [body])
    if any(other != viscous for other in others):
        raise rubbing.refused("viscous", f"but stage.viscous is {viscous:g}: state it once")
    return viscous


def _drive(drive: Block, late: int) -> stage.Drive:
    """`late`: control periods of delay where the file gives none; without a controller no period is known."""

    def number(key: str, field: str, default: float | None = None) -> float:
        return drive.number(key, quantity(stage.Drive, field), default)

    p = stage.Drive(
        number("current_quantum_A", "current_quantum") if drive.has("current_quantum_A") else 0.0,
        drive.whole("delay_samples", quantity(stage.Drive, "delay_samples"), late),
        number("current_limit_A", "current_limit", math.inf),
        number("current_loop_s", "current_lag", 0.0),
    )
    if not (drive.has("voltage_limit_V") or drive.has("resistance_ohm")):
        return p
    return p._replace(
        voltage_limit=number("voltage_limit_V", "voltage_limit") if drive.has("voltage_limit_V") else math.inf,
        resistance=number("resistance_ohm", "resistance"),
        back_emf=number("back_emf_V_per_unit_s", "back_emf", 0.0),
    )


def _encoder(body: Block, late: int) -> stage.Encoder:
    """With the order of an interpolation error, where it is known, and an amplitude of zero."""
    key = "encoder_periods_per_pitch"
    lines = Harmonic(order=body.number(key, quantity(Harmonic, "order"))) if body.has(key) else Harmonic()
    return stage.Encoder(body.number("encoder_step", quantity(stage.Encoder, "step"), 0.0), late, interpolation=lines)


def _late(file: Block) -> int:
    """Periods by which the controller sees the position late, from the description of the controller."""
    controller = file.block("controller")
    late = quantity(stage.Encoder, "delay_samples")
    return controller.whole("measurement_delay_samples", late) if controller.has("measurement_delay_samples") else 0


def _friction(rubbing: Block) -> stage.Friction:
    if not rubbing.values:
        rubbing.notes.append("nominal.yaml has no friction: the model's axis slides freely")
        return FREE
    law = rubbing.word("law", _LAWS, _STOPS[0])
    if law == "none":
        return FREE
    curve = stribeck(rubbing.block("stribeck"))
    if law in _STOPS:
        beside = rubbing.block("bristle")
        own = bristle(beside, curve) if beside.values else friction_bristle.NEUTRAL
        return stage.Friction(operators(rubbing, "weight", "slip"), curve, own)
    return stage.Friction(friction.bundle([0.0], [1.0]), friction.Stribeck(), bristle(rubbing, curve))


def operators(rubbing: Block, weights: str, slips: str) -> friction.StopOperators:
    """The elements in two lists of a block, checked against their sum in `coulomb` where it has one.

    Raises NominalValueError where the lists differ in length, or contradict the sum.
    """
    weight = rubbing.numbers(weights, quantity(friction.StopOperators, "weight"))
    slip = rubbing.numbers(slips, quantity(friction.StopOperators, "slip"))
    if len(weight) != len(slip):
        rule = f"has {len(slip)} entries, {rubbing.name}.{weights} has {len(weight)}; each element needs one of both"
        raise NominalValueError(rubbing.place, f"{rubbing.name}.{slips}", slip, rule)
    if not weight:
        if weights == "weight":
            raise rubbing.refused(weights, "stop operators need their forces here and their slips in `slip`")
        return friction.bundle([0.0], [1.0])
    if weights == "weight" and rubbing.has("coulomb"):
        _check_sum(rubbing, math.fsum(weight))
    return friction.bundle(weight, slip)


def _check_sum(rubbing: Block, total: float) -> None:
    coulomb = rubbing.number("coulomb", Quantity("N m | N", "[0, 1e6]", "friction at speed"))
    if abs(coulomb - total) > WRONG_SUM * max(coulomb, total):
        raise rubbing.refused("coulomb", f"but the sum of its weights is {total:.6g}: one of the two must be wrong")
    if abs(coulomb - total) > NOTED_SUM * max(coulomb, total):
        rubbing.notes.append(
            f"friction.coulomb of {rubbing.place.name} is {coulomb:g}, but the sum of its weights is {total:.6g}: "
            "the weights are used"
        )


def stribeck(curve: Block) -> friction.Stribeck:
    """Stribeck's curve, neutral where there is none."""
    if not curve.values:
        return friction.Stribeck()
    curve.ignore_others(friction.Stribeck._fields)
    return friction.Stribeck(*curve.fields(friction.Stribeck, "rise", "velocity", shape=1.0))


def bristle(rubbing: Block, curve: friction.Stribeck) -> friction_bristle.Bristle:
    """Dahl's or LuGre's bristle."""
    kind = friction_bristle.Bristle
    coulomb, stiffness, exponent, damping = rubbing.fields(kind, "coulomb", "stiffness", exponent=1.0, damping=0.0)
    return kind(coulomb, stiffness, exponent, damping, curve)
