"""Which model is taken: the richest one whose loop is nearly as close to the logs as the closest."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.gap.result.diagnosis import FoundEffect
from stagectl.gap.selection import refine
from stagectl.gap.validation import closure, held_out_gap, rollouts, validate
from stagectl.kernels.stage import scaled_friction, sliding, stretched_friction

RICH, PLAIN, NOMINAL = (SimpleNamespace(name=name) for name in ("rich", "plain", "nominal"))
STAGES: Any = [RICH, PLAIN, NOMINAL]


@pytest.mark.parametrize(
    ("squares", "taken"),
    [
        ((1.0, 1.0, 9.0), RICH),
        ((1.04, 1.0, 9.0), RICH),
        ((1.06, 1.0, 9.0), PLAIN),
        ((3.0, 2.0, 1.0), NOMINAL),
        ((float("nan"), 1.0, 1.0), PLAIN),  # it diverged
    ],
)
def test_a_richer_model_must_not_lead_away(
    monkeypatch: pytest.MonkeyPatch, squares: tuple[float, ...], taken: SimpleNamespace
) -> None:
    remaining = dict(zip((stage.name for stage in STAGES), squares, strict=True))
    nothing: Any = None
    monkeypatch.setattr(held_out_gap, "judged_logs", lambda *_: [])
    monkeypatch.setattr(rollouts, "simulated_logs", lambda session, stage, logs: stage)
    monkeypatch.setattr(held_out_gap, "remaining", lambda judged, stage: remaining[stage.name])
    assert validate.closest(nothing, STAGES, []) is taken


@pytest.mark.parametrize(("squares", "taken"), [((1.0, 1.0, 9.0), RICH), ((3.0, 2.0, 1.0), NOMINAL)])
def test_without_a_known_loop_the_effort_decides(
    monkeypatch: pytest.MonkeyPatch, squares: tuple[float, ...], taken: SimpleNamespace
) -> None:
    """A fit that makes the gap of the effort larger is refused as one that makes that of the loop larger."""
    remaining = dict(zip((stage.name for stage in STAGES), squares, strict=True))
    session: Any = SimpleNamespace(law=None, logs=(), dt=5e-4)
    model = SimpleNamespace(_replace=lambda stage: stage)
    e: Any = SimpleNamespace(runs=(), base=SimpleNamespace(model=model, noise=None))
    monkeypatch.setattr(validate, "effort", lambda model, *_: SimpleNamespace(squares=np.array(remaining[model.name])))
    assert validate._best_model(session, e, STAGES) is taken


@pytest.mark.parametrize(("named", "probability"), [("presliding", 0.9), ("presliding", 0.1), ("inertia", 0.9)])
def test_a_fitted_curve_of_the_friction_has_to_bring_the_loop_closer(
    ball_screw: Setup, named: str, probability: float
) -> None:
    """Before each model comes itself with the nominal curve; where the curve's length is named, it has been judged."""
    nominal = ball_screw.stage
    bent = stretched_friction(scaled_friction(nominal.friction, 1.3), 2.0)
    fitted = nominal._replace(mechanics=nominal.mechanics._replace(inertia=0.02), friction=bent)
    session: Any = SimpleNamespace(stage=nominal)
    said: Any = SimpleNamespace(models=[fitted], shifts=[SimpleNamespace(name=named, probability=probability)])
    *before, last = validate._models(session, said)
    assert last is fitted and not closure.keeps_form(fitted, nominal)
    assert len(before) == (0 if (named, probability) == ("presliding", 0.9) else 1)
    for plain in before:
        assert plain.mechanics == fitted.mechanics and closure.keeps_form(plain, nominal)
        assert sliding(plain.friction) == pytest.approx(1.3 * sliding(nominal.friction))


@pytest.mark.parametrize(
    ("effects", "probability", "alone"),
    [(("cable_spring",), 0.2, True), (("cable_spring",), 0.9, False), ((), 0.2, False)],
)
def test_what_is_not_named_is_not_moved(
    monkeypatch: pytest.MonkeyPatch, ball_screw: Setup, effects: tuple[str, ...], probability: float, alone: bool
) -> None:
    """On a machine of the exam whose nominal values are exact, the fit moved them: 24 urad where the effect left 5."""
    monkeypatch.setattr(refine, "at_values", lambda e, model, effects: (model.stage, effects))
    session: Any = SimpleNamespace(stage=ball_screw.stage, dt=5e-4)
    selected: Any = SimpleNamespace(fitted=SimpleNamespace(effects=effects))
    said: Any = SimpleNamespace(shifts=[SimpleNamespace(name="inertia", probability=probability)])
    nothing: Any = None
    found = validate._effects_alone(session, nothing, selected, said)
    assert found == ([(ball_screw.stage, effects)] if alone else [])


@pytest.mark.parametrize(
    ("unexplained", "share", "beside", "named"),
    [
        (True, 0.0, False, False),
        (True, 0.3, False, True),
        (False, 0.0, False, True),
        (True, 0.0, True, True),  # the gap is that of the function next to it
    ],
)
def test_what_takes_nothing_of_a_gap_that_is_not_explained_is_not_what_is_missing(
    unexplained: bool, share: float, beside: bool, named: bool
) -> None:
    effect = FoundEffect("current_saturation", (), 1.0, share, {}, block="drive")
    others = {effect.name} if beside else set()
    assert (validate.confirmed(effect, unexplained, others).probability > 0.5) is named
