"""A parameter that an effect changes is not off where the machine has its nominal value elsewhere."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.gap.inference import swept_parameters
from stagectl.gap.result.diagnosis import UNEXPLAINED, FoundEffect, Part, UnknownTerm, Value
from stagectl.kernels.stage import scaled_friction, sliding

WARMING = FoundEffect("thermal_viscous", (), 0.99, 0.2, {}, fields=(("mechanics.viscous_warming.rise", 0.4),))


def shift(change: float, name: str = "viscous") -> FoundEffect:
    values = {name: Value.around(0.19, 0.01, "N m s/rad"), "change": Value.around(change, 0.01, "")}
    return FoundEffect(name, (), 1.0, 0.6, values, fields=((f"mechanics.{name}", 0.19),), parameter=True)


@pytest.mark.parametrize(
    ("change", "alone"),
    [
        (-0.1, False),  # nominal 1.11 of the fitted one, which the machine has on its way from 1.4 to 1.1
        (0.14, False),  # nominal 0.88: it falls by 0.3 in the logs, and may fall by 0.22 more
        (0.6, True),  # nominal 0.62
        (-0.5, True),  # nominal 2.0
        (-1.0, True),  # nothing is left of it
    ],
)
def test_a_nominal_value_within_what_the_effect_changes_is_not_off(change: float, alone: bool) -> None:
    factors = {"thermal_viscous": {"viscous": (1.1, 1.4)}}
    together = swept_parameters.merged([WARMING, shift(change), shift(change, "inertia")], factors)
    found = together.effects
    assert [effect.name for effect in found] == ["thermal_viscous", *(["viscous"] if alone else []), "inertia"]
    if not alone:
        assert found[0].share == pytest.approx(0.8) and found[0].parameters["viscous"].value == 0.19
        gap = together.of_gap({"parameters": 0.6, "thermal_viscous": 0.3, "noise": 0.1})
        assert gap == pytest.approx(
            {"parameters": 0.3, "thermal_viscous": 0.6, "noise": 0.1}
        )  # half of the parameters'
        parts = [Part("parameters", "mechanics", "speed", 0.8), Part("thermal_viscous", "mechanics", "time", 0.2)]
        assert [part.share for part in together.of_effort(parts)] == pytest.approx([0.4, 0.6])
        assert dict(found[0].fields) == {"mechanics.viscous_warming.rise": 0.4, "mechanics.viscous": 0.19}


def test_an_effect_that_is_not_named_owns_nothing() -> None:
    doubted = WARMING._replace(probability=0.3)
    found = swept_parameters.merged([doubted, shift(0.1)], {"thermal_viscous": {"viscous": (1.1, 1.4)}})
    assert found.effects == [doubted, shift(0.1)] and not found.taken_over


@pytest.mark.parametrize(
    ("coordinate", "left"),
    [("speed", ["inertia"]), ("acceleration", ["viscous"]), ("current", []), ("position", ["viscous", "inertia"])],
)
def test_a_parameter_that_an_unknown_may_hold_is_not_off(coordinate: str, left: list[str]) -> None:
    """Beside a friction that was left out, viscous friction was said to be off by 11 %, P 1.00, on a right model."""
    term = (("residual.coordinate", coordinate),)
    unknown = UnknownTerm(coordinate, np.zeros(2), np.zeros(2), 0.9, term)
    found = swept_parameters.merged([shift(0.1), shift(0.1, "inertia")], {}, unknown)
    assert [effect.name for effect in found.effects] == left
    gone = [name for name in ("viscous", "inertia") if name not in left]
    assert found.unknown is not None
    assert found.unknown.fields == (*((f"mechanics.{name}", 0.19) for name in gone), *term)
    gap = found.of_gap({"parameters": 0.6, UNEXPLAINED: 0.4})
    assert gap["parameters"] == pytest.approx(0.3 * len(left)) and sum(gap.values()) == pytest.approx(1.0)


def test_an_unknown_current_has_no_parameters_of_the_mechanics() -> None:
    unknown = UnknownTerm("speed", np.zeros(2), np.zeros(2), 0.9, block="drive")
    assert swept_parameters.merged([shift(0.1)], {}, unknown).effects == [shift(0.1)]


def test_an_unknown_without_a_term_in_a_stage_file_keeps_no_fields() -> None:
    unknown = UnknownTerm("speed", np.zeros(2), np.zeros(2), 0.9)
    assert swept_parameters.merged([shift(0.1)], {}, unknown).unknown == unknown


def test_the_factors_are_those_of_the_logs(ball_screw: Setup) -> None:
    """A drift from 1.4 to 1 + 0.4 / e^2; a friction that is 3 to 12 % off at the ends of the travel; one that
    rises; one that the load adds to."""
    log = SimpleNamespace(
        start=0.0, rows=1000, position=np.array([-3.0, 0.0, 3.0]), valid=np.array([True, True, False]),
        current=np.array([0.0, -5.0, 90.0]), command=None,
    )  # fmt: skip
    logs = [log, SimpleNamespace(**{**vars(log), "start": 99.0})]
    session: Any = SimpleNamespace(logs=logs, dt=1e-3)
    decay = SimpleNamespace(of={"rise": "viscous"}, factor=lambda v, t: np.exp(-t / v["time"]))
    warming = SimpleNamespace(name="thermal_viscous", time_variation=decay)

    def along(p: Any, _: Any) -> Any:
        sloped = p.friction.along._replace(slope=0.015, bow=-0.025 / 3.0, centre=0.0)
        return p._replace(friction=p.friction._replace(along=sloped))

    place = SimpleNamespace(name="position_friction", time_variation=None, apply=along)
    now: Any = SimpleNamespace(
        model=SimpleNamespace(stage=ball_screw.stage),
        effects=[SimpleNamespace(effect=warming, values={"rise": 0.4, "time": 50.0}),
                 SimpleNamespace(effect=place, values={}),
                 SimpleNamespace(effect=SimpleNamespace(name="stribeck", time_variation=None), values={"rise": 0.2}),
                 SimpleNamespace(effect=SimpleNamespace(name="load_friction", time_variation=None),
                                 values={"share": 0.03})],
    )  # fmt: skip
    found = swept_parameters.swept(session, now)
    assert found["thermal_viscous"]["viscous"] == pytest.approx((1.0 + 0.4 * np.exp(-2.0), 1.4))
    assert found["position_friction"]["coulomb"] == pytest.approx((0.88, 1.0))
    assert found["stribeck"]["coulomb"] == pytest.approx((1.0, 1.2))
    pressed = 0.03 * 5.0 * ball_screw.stage.motor.force_constant / sliding(ball_screw.stage.friction)
    assert found["load_friction"]["coulomb"] == pytest.approx((1.0, 1.0 + pressed))
    fitted = now.model.stage
    cold = fitted.mechanics._replace(viscous=1.2 * fitted.mechanics.viscous)
    session.stage = fitted._replace(mechanics=cold, friction=scaled_friction(fitted.friction, 2.0))
    own = swept_parameters.own_parameters(session, now)
    assert own["thermal_viscous"] == ["viscous"]  # the nominal value is one on its way
    assert own["stribeck"] == own["position_friction"] == []  # twice the friction is none of theirs
