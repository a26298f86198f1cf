"""What is known before the data: traces of everything, sizes of effects, and parameters around their nominal values."""

from __future__ import annotations

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.gap.effects.effect import Amplitude, Definition
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.selection import constants, usual_sizes
from stagectl.gap.selection.candidates import Form
from stagectl.gap.selection.priors import Prior, believed
from stagectl.kernels import feedback

COLUMNS = ("inertia", "bias", "a1", "a2", "b", "gap")


def places(names: object) -> list[int]:
    return [COLUMNS.index(name) for name in names]  # type: ignore[attr-defined]


def form(effect: str, column: str, size: float, low: float = -np.inf, nonlinear: bool = False) -> Form:
    amplitudes = (Amplitude("size", "", (size,), low),)
    definition = Definition(effect, "mechanics", "none", amplitudes, (), lambda p, _: p, nonlinear=nonlinear)
    return Form(definition, {}, (size,), (column,))


FORMS = [
    form("a", "a1", 0.2),
    form("a", "a2", 0.2),
    form("b", "b", -3.0, 0.0),
    form("backlash", "gap", 1e-6, 0.0, True),
]


def test_a_trace_of_everything_is_spread_over_the_grid_of_each_effect() -> None:
    prior = usual_sizes.immaterial(FORMS, places)
    assert prior.places == (2, 3, 4) and not prior.mean.any()  # a column that bends has no trace
    assert prior.deviation == pytest.approx(constants.IMMATERIAL * np.array([0.2 / 2**0.5, 0.2 / 2**0.5, 3.0]))


def test_the_trace_of_a_wider_form_is_that_of_the_effect_that_it_holds() -> None:
    """Cogging with its multiples is large on a bare motor; on a screw, such a trace would explain all cogging away."""
    forms = [form("cogging", "a1", 0.02), form("cogging_map", "a2", 0.6)]
    assert usual_sizes.immaterial(forms, places).deviation == pytest.approx([constants.IMMATERIAL * 0.02] * 2)
    assert usual_sizes.immaterial(forms[1:], places).deviation == pytest.approx([constants.IMMATERIAL * 0.6])


def test_the_forms_and_scales_of_an_effect_share_its_prior() -> None:
    tried = usual_sizes.of_effects(FORMS, places)
    for name in ("a", "b", "backlash"):
        assert sum(candidate.share for candidate in tried if candidate.effect == name) == pytest.approx(1.0)
    assert {float(c.prior.deviation[0]) for c in tried if c.form == 0} == {0.2 * s for s, _ in constants.SCALES}
    assert [candidate.positive for candidate in tried if candidate.effect == "a"] == [False] * (
        2 * len(constants.SCALES)
    )
    assert all(candidate.positive for candidate in tried if candidate.effect == "b")


def test_a_column_that_bends_with_its_size_is_believed_near_it() -> None:
    (candidate,) = (c for c in usual_sizes.of_effects(FORMS, places) if c.effect == "backlash")
    assert candidate.prior.mean == [1e-6] and candidate.prior.deviation == pytest.approx([constants.BENT * 1e-6])


def test_the_base_is_known_around_its_nominal_values(ball_screw: Setup) -> None:
    """A fit that has moved the inertia up by a tenth is a tenth above what is most probable."""
    nominal = TrackedModel(ball_screw.stage, feedback.Pid(*[0.0] * len(feedback.Pid._fields)))
    mechanics = nominal.stage.mechanics
    heavier = nominal._replace(
        stage=nominal.stage._replace(mechanics=mechanics._replace(inertia=1.1 * mechanics.inertia))
    )
    known = Prior(nominal, effort=1.0, largest=2.0, speed=10.0, dt=5e-4, strokes=8, force=0.3, viscous=0.3)
    prior = usual_sizes.of_base(known, heavier, ["inertia", "bias"], places)
    assert prior.mean == pytest.approx([-0.1 * mechanics.inertia, 0.0])
    assert prior.deviation[0] == pytest.approx(constants.INERTIA * mechanics.inertia)


@pytest.mark.parametrize(("missing", "kept"), [(0.0, True), (0.3, True), (50.0, False)])
@pytest.mark.parametrize(("name", "width", "wide"), [("bias", "force", 60.0), ("viscous", "viscous", 6.0)])
def test_a_friction_that_cannot_be_right_is_no_knowledge(
    ball_screw: Setup, name: str, width: str, wide: float, missing: float, kept: bool
) -> None:
    """The logs hold `missing` times the friction of the file besides its own: it then counts up to their effort."""
    rows = np.random.default_rng(3).standard_normal((400, 2))
    z = np.column_stack([rows[:, 0], missing * rows[:, 0] + 0.1 * rows[:, 1]])
    square = np.stack([z[:200].T @ z[:200], z[200:].T @ z[200:]])
    g = Grams((name,), square, np.zeros_like(square), np.zeros((2, 2)), np.zeros(2, int), np.arange(2))
    nominal = TrackedModel(ball_screw.stage, feedback.Pid(*[0.0] * len(feedback.Pid._fields)))
    prior = Prior(nominal, effort=60.0, largest=90.0, speed=10.0, dt=5e-4, strokes=40, force=0.3, viscous=0.3)
    assert getattr(believed(g, [name], prior), width) == (0.3 if kept else wide)
