"""The pipeline's own decisions: its steps, its verdict, its shares, and what it refuses to begin."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.gap import diagnose
from stagectl.gap.inference.conclusions import Conclusions
from stagectl.gap.inference.patch_fields import fields_of
from stagectl.gap.result.diagnosis import FORM, NOISE, UNORDERED, FoundEffect, Value
from stagectl.gap.steps import Step, StepTimer
from stagectl.gap.validation import shares as shares_of
from stagectl.kernels.stage import scaled_friction, stretched_friction

DWELL = FoundEffect("dwell", (), 0.9, 0.0, {})
INERTIA, BIAS = (
    FoundEffect(name, (), 0.9, share, {}, parameter=True) for name, share in (("inertia", 3.0), ("bias", 1.0))
)


def test_the_timer_reports_each_step_and_measures_it() -> None:
    reported = list[str]()
    clock = iter([0.0, 2.0, 5.0])
    timer = StepTimer(reported.append, lambda: next(clock))
    timer.begin(Step.CONTROLLER)
    timer.begin(Step.BASELINE)
    assert timer.seconds == ((Step.CONTROLLER.value, 2.0), (Step.BASELINE.value, 3.0))
    assert reported == [Step.CONTROLLER, Step.BASELINE] and all(isinstance(message, Step) for message in reported)


@pytest.mark.parametrize(
    ("named", "shape", "verdict"),
    [
        ([], None, "none"),
        ([INERTIA], None, "parameters"),
        ([INERTIA], UNORDERED, "unknown"),
        ([INERTIA, DWELL], None, "effects"),
        ([DWELL], UNORDERED, "effects+unknown"),
    ],
)
def test_the_verdict(named: list[FoundEffect], shape: Any, verdict: str) -> None:
    assert diagnose.verdict_of(named, shape) == verdict


def test_shares_are_of_the_closable_gap_and_parameters_divide_theirs() -> None:
    shares = {"parameters": 0.2, "dwell": 0.4, NOISE: 0.2}
    dwell, inertia, bias = shares_of.of_effects([DWELL, INERTIA, BIAS], shares)
    assert (dwell.share, inertia.share, bias.share) == pytest.approx((0.5, 0.1875, 0.0625))
    assert shares_of.of_effects([DWELL], {})[0].share == 0.0


def test_a_parameter_that_takes_nothing_raises_the_share_of_no_other() -> None:
    inertia, bias = shares_of.of_effects([INERTIA, BIAS._replace(share=-0.9 * INERTIA.share)], {"parameters": 0.2})
    assert (inertia.share, bias.share) == pytest.approx((0.2, 0.0))


def test_the_length_of_the_rolling_zone_has_the_share_of_the_friction_s_form() -> None:
    zone = FoundEffect("presliding", (), 0.9, 2.0, {}, parameter=True)
    inertia, length = shares_of.of_effects([INERTIA, zone], {"parameters": 0.1, FORM: 0.7, NOISE: 0.2})
    assert (inertia.share, length.share) == pytest.approx((0.125, 0.875))


def test_a_coulomb_friction_is_written_with_the_curve_of_the_improved_model(ball_screw: Setup) -> None:
    """The fitted curve may lead the loop away, and the improved model has the nominal one then."""
    nominal = ball_screw.stage
    size, bent = scaled_friction(nominal.friction, 1.2), stretched_friction(nominal.friction, 2.0)
    fitted = FoundEffect(
        "coulomb", (), 0.9, 1.0, {}, fields=fields_of(nominal, nominal._replace(friction=bent)), parameter=True
    )
    inertia, coulomb = shares_of.as_improved([INERTIA, fitted], nominal, nominal._replace(friction=size))
    assert inertia is INERTIA
    assert dict(coulomb.fields) == dict(fields_of(nominal, nominal._replace(friction=size)))
    assert shares_of.as_improved([fitted], nominal, nominal) == [fitted]


def session(*logs: dict[str, Any]) -> Any:
    plain = {"held_out": False, "command": 1, "current": 1, "position": np.array([0.0, 12e-6])}
    stage = SimpleNamespace(encoder=SimpleNamespace(step=1e-6))
    return SimpleNamespace(logs=[SimpleNamespace(**{**plain, **log}) for log in logs], stage=stage, dt=5e-4)


@pytest.mark.parametrize(
    ("logs", "token"),
    [
        ([{"held_out": True}], "use: diagnose"),
        ([{"command": None, "current": None}], "current"),
        ([{"position": np.array([0.0, 8e-6])}], "10 encoder steps"),
        ([{"command": None}], ""),
        ([{}, {"command": None, "current": None}], ""),
    ],
)
def test_what_nothing_can_be_identified_from(logs: list[dict[str, Any]], token: str) -> None:
    reason = diagnose.unidentifiable(session(*logs))
    assert bool(reason) is bool(token) and token in reason


def test_effects_come_first_then_signatures_and_parameters() -> None:
    jitter = FoundEffect("jitter", (), 0.98, 0.0, {"rms": Value(1e-4, 0.0, 0.0, "s")})
    conclusions = Conclusions((DWELL,), (INERTIA,), (jitter,), None, ())
    assert conclusions.effects == [DWELL, jitter, INERTIA]


def test_a_wrong_controller_holds_the_whole_gap() -> None:
    said: dict[str, Any] = {"doubts": (), "notes": (), "cannot_tell": (), "logs": ()}
    said["stage"] = SimpleNamespace(motor=SimpleNamespace(force_constant=35.0))
    empty: Any = SimpleNamespace(kind="linear", travel_per_unit=1.0, travel_unit="m", **said)
    result = diagnose._unsearched(empty, "controller", "the integral gain")
    assert (result.verdict, result.reason, result.blocks["controller"]) == ("controller", "the integral gain", 1.0)
    assert result.gap.unit == "m" and result.effects == ()
