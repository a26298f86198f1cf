"""The deployed controller, from a nominal.yaml to the law and its feedforward.

Source of the keys: the description of capture folders; a cascade and an observer as our own export writes them.
"""

import math
from typing import Any, NamedTuple

from stagectl.compensation import model_effects
from stagectl.compensation.forms import FORMS, recorded
from stagectl.gap.logs import nominal_model
from stagectl.gap.logs.nominal_values import Block, quantity
from stagectl.kernels import cascade, feedback, feedforward, friction_bristle, law, observer, stage, unloading
from stagectl.units import Quantity

_GAIN = Quantity("", "[-1e15, 1e15]", "gain of the feedback, in A and the position's unit")
_POSITIVE = Quantity("", "[0, 1e15]", "gain of the feedback, in A and the position's unit")
_SHARE = Quantity("", "[0, 1)", "share of the last value that the force filter keeps")
_POLE = Quantity("rad/s", "(0, 1e9]", "pole of the derivative's filter")
_PERIOD = Quantity("s", "[1e-6, 1]", "control period")
_ADVANCE = Quantity("s", "[-1, 1]", "time by which it looks ahead")
_BAND = Quantity("rad | m", "[0, 1]", "error that is left alone while the reference stands still")
_UNLOADING = Quantity("", "[0, 1e15]", "A of the integral given up per unit of speed and period; the range is in A")
_LIMIT = Quantity("A", "(0, inf]", "largest command")
_SPAN = Quantity("", "[1, 2]", "periods over which the velocity is differenced")
_KEYS = (
    "Ts bandwidth_Hz Kp Ki Kd derivative_pole discretisation law position_gain velocity_gain integral_gain retained "
    "velocity_feedforward reference_velocity span kp kv observer observer_model observer_gains model_inertia "
    "model_viscous model_force_constant feedforward friction_compensation friction_bristle friction_weight "
    "friction_slip effect_feedforward feedforward_advance_s friction_advance_s measurement_delay_samples frame_samples "
    "reference_interpolation states_at_first_row anti_windup command_limit_A standstill_band "
    "unloading"
)


DERIVATIVE = "derivative"
# Velocity of the reference from its values, as rows before and after over which it is differenced.
DIFFERENCES = {"backward difference": (1, 0), "central difference": (1, 1), "forward difference": (0, 1)}


class DeployedController(NamedTuple):
    """All that decides the commands, except reference and position."""

    law: law.Law
    dt: float  # s
    feedforward: feedforward.Feedforward
    advance: float = 0.0  # s, by which the feedforward looks ahead
    friction_advance: float = 0.0  # s, the friction compensation
    late: int = 0  # periods by which the position is late
    bristle: friction_bristle.Bristle = friction_bristle.NEUTRAL  # of the compensation
    form: Any = None  # of the compensation, where it is not the model's
    effects: stage.Stage | None = None  # the model whose further effects are fed forward
    reference_velocity: str = DERIVATIVE


def read(file: Block) -> DeployedController | None:
    """The controller in a nominal.yaml; None where there is none, or it is described as free text only.

    Raises NominalValueError where a value is missing or outside its range.
    """
    c = file.block("controller")
    if not c.values:
        return None
    c.ignore_others(_KEYS.split())
    if not any(c.has(key) for key in ("Kp", "position_gain", "kv")):
        c.notes.append(
            "nominal.yaml gives none of Kp, position_gain and kv for its controller: the command cannot be recomputed"
        )
        return None
    dt = c.number("Ts", _PERIOD)
    if c.has("frame_samples") and c.number("frame_samples", Quantity("", "[1, 100]", "periods a frame")) != 2.0:
        raise c.refused("frame_samples", "must be 2: perfect tracking of a plant of second order")
    ahead, advance = _feedforward(c, dt)
    rubbing = ahead.with_friction or c.has("friction_compensation") or c.has("friction_bristle")
    late = c.number("friction_advance_s", _ADVANCE, advance + 0.5 * dt) if rubbing else 0.0
    form = _form(c)
    return DeployedController(
        _law(c, dt),
        dt,
        ahead,
        advance,
        late,
        c.whole("measurement_delay_samples", quantity(stage.Encoder, "delay_samples"), 0),
        _bristle(c),
        form,
        _effects(c, file, form),
        c.word("reference_velocity", (DERIVATIVE, *DIFFERENCES), DERIVATIVE) if _follows_velocity(c) else DERIVATIVE,
    )


def _follows_velocity(c: Block) -> bool:
    """Whether the controller takes a velocity from the reference."""
    return c.has("position_gain") and c.has("velocity_feedforward")


def _law(c: Block, dt: float) -> law.Law:
    limit = _limit(c)
    observed, band, held = _observer(c), c.number("standstill_band", _BAND, 0.0), _unloading(c)
    if c.has("Kp"):
        return law.Law(_pid(c, dt), limit, observer=observed, standstill_band=band, unloading=held)
    if c.has("position_gain"):
        own = _cascade(c, dt)
    else:  # the EMPS benchmark: velocity by differences of averaged positions, two proportional gains
        own = cascade.Cascade(c.number("kp", _POSITIVE), c.number("kv", _POSITIVE), span=2, dt=dt)
    return law.Law(feedback.ABSENT, limit, own, True, observed, band, held)


def _unloading(c: Block) -> unloading.Unloading:
    values = c.numbers("unloading", _UNLOADING)
    if len(values) not in (0, len(unloading.ABSENT)):
        raise c.refused(
            "unloading",
            "must be eight numbers: rates against the motion and along it, the range; the bristle's rate, its part of "
            "the friction and its exponent; stiffness, and the way that the encoder does not show",
        )
    return unloading.Unloading(*values)


def _limit(c: Block) -> float:
    """The law's own limit (A): without conditional integration there is none, and only the drive limits."""
    anti_windup = c.word("anti_windup", ("none", "conditional"), "none")
    if anti_windup == "none":
        if c.has("command_limit_A"):
            c.notes.append("controller.command_limit_A without anti-windup: the drive's limit is used instead")
        return math.inf
    return c.number("command_limit_A", _LIMIT)


def _pid(c: Block, dt: float) -> feedback.Pid:
    c.word("discretisation", ("tustin",), "tustin")
    derivative = c.number("Kd", _GAIN, 0.0)
    pole = c.number("derivative_pole", _POLE) if derivative else 1.0
    return feedback.discretised(feedback.Gains(c.number("Kp", _GAIN), c.number("Ki", _GAIN, 0.0), derivative, pole), dt)


def _cascade(c: Block, dt: float) -> cascade.Cascade:
    return cascade.Cascade(
        c.number("position_gain", _POSITIVE),
        c.number("velocity_gain", _POSITIVE),
        0.5 * dt * c.number("integral_gain", _POSITIVE, 0.0),
        c.number("retained", _SHARE, 0.0),
        c.number("velocity_feedforward", _POSITIVE, 0.0),
        c.whole("span", _SPAN, 1),
        dt,
    )


def _observer(c: Block) -> observer.Observer:
    model, gains = c.block("observer_model"), c.numbers("observer_gains", _GAIN)
    if not model.values and not gains:
        return observer.ABSENT
    if len(gains) != 3:
        raise c.refused("observer_gains", "must be the three gains [k1, k2, k3]")
    a12, a22, b1, b2 = (model.number(name, _GAIN) for name in ("a12", "a22", "b1", "b2"))
    delay = model.whole("delay", Quantity("", f"[0, {observer.LONGEST}]", "whole periods of delay"))
    share = model.number("share", Quantity("", "[0, 1]", "of the newer of two commands"))
    pole = 1.0 - (gains[0] + 1.0 - a22) / 3.0  # k1 = 3 (1 - q) - (1 - a22)
    return observer.Observer(a12, a22, b1, b2, gains[0], gains[1], gains[2], delay, share, pole, True)


def _feedforward(c: Block, dt: float) -> tuple[feedforward.Feedforward, float]:
    """The part of the command that does not depend on the feedback, and how far it looks ahead (s)."""
    modelled = [name for name in ("model_inertia", "model_viscous", "model_force_constant") if c.has(name)]
    default = "perfect tracking" if len(modelled) == 3 else "none"
    with_tracking = c.word("feedforward", ("perfect tracking", "none"), default) != "none"
    elements = nominal_model.operators(c, "friction_weight", "friction_slip")
    rubbing = c.has("friction_weight") and bool(c.values["friction_weight"])
    inertia = c.number("model_inertia", quantity(stage.Mechanics, "inertia")) if with_tracking else 1.0
    viscous = c.number("model_viscous", quantity(stage.Mechanics, "viscous")) if with_tracking else 0.0
    effort = with_tracking or rubbing or c.has("friction_compensation") or c.has("friction_bristle")
    constant = c.number("model_force_constant", quantity(stage.Motor, "force_constant")) if effort else 1.0
    plant = feedforward.held(stage.Mechanics(inertia, viscous), constant, dt)
    advance = c.number("feedforward_advance_s", _ADVANCE, 0.0) if effort else 0.0
    return feedforward.Feedforward(plant, elements, constant, with_tracking, rubbing), advance


def _bristle(c: Block) -> friction_bristle.Bristle:
    """Of a compensation by Dahl's or LuGre's law; neutral where there is none."""
    inner = c.block("friction_bristle")
    if not inner.values:
        return friction_bristle.NEUTRAL
    return nominal_model.bristle(inner, nominal_model.stribeck(inner.block("stribeck")))


def _form(c: Block) -> Any:
    """A compensation by another form than the model's, as our own export writes it."""
    inner = c.block("friction_compensation")
    if not inner.values:
        return None
    name, numbers = inner.values.get("form"), {key: value for key, value in inner.values.items() if key != "form"}
    if name not in FORMS or name == "model":
        raise inner.refused("form", f"must be one of {', '.join(form for form in FORMS if form != 'model')}")
    try:
        return recorded(name, numbers)
    except (TypeError, ValueError) as error:
        raise c.refused("friction_compensation", f"does not fit the form {name}: {error}") from error


def _effects(c: Block, file: Block, form: Any) -> stage.Stage | None:
    """The nominal model, where the controller answers its further effects; with a `form` of its own, but friction's."""
    if c.word("effect_feedforward", ("none", "nominal"), "none") == "none":
        return None
    model = nominal_model.read(file)
    return model if form is None else model_effects.rubbing_answered(model)
