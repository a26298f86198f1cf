"""When a shape counts as unknown, which of several is taken, and what an error of form may leave."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.gap.inference import shape_fits, unknown, unstructured_residual
from stagectl.gap.inference.basis_functions import EVEN, INERTIAL, ODD, CoordinateBasis, hats
from stagectl.gap.inference.shape_fits import ShapeFit
from stagectl.gap.inference.unknown import Explained
from stagectl.gap.residuals import gram_matrices
from stagectl.gap.result.diagnosis import UnknownTerm
from stagectl.gap.selection import refine
from stagectl.gap.selection.linearised import Predicted
from stagectl.kernels.effects import TURN
from stagectl.kernels.stage import sliding

SPEED = CoordinateBasis("speed", lambda m: m.velocity, hats(np.array([0.0, 1.0, 2.0])), 0.0, 2.0)
PLACE = SPEED._replace(coordinate="position")
FIT = ShapeFit(SPEED, (EVEN, ODD), 100.0, 0.8, 10.0, 1e-3)
NOTHING: Any = None


@pytest.mark.parametrize(
    ("changes", "least", "clear"),
    [
        ({}, 50.0, True),
        ({"share": 0.4}, 50.0, False),  # predicts too little
        ({}, 100.0, False),  # too small
        ({"limit": 150.0}, 50.0, False),  # another friction law gives as much
    ],
)
def test_a_shape_is_clear(changes: dict[str, Any], least: float, clear: bool) -> None:
    assert FIT._replace(**changes).clear(least) is clear


def test_an_error_in_the_form_of_an_effect_is_no_unknown_over_its_coordinate() -> None:
    """What an effect over the position may leave is one over the position and over the pitch."""
    cogging = [Explained("mechanics", ("position_mod_pitch",), 125.0)]
    assert unknown._form_error("position", cogging) == unknown._form_error("position_mod_pitch", cogging) == 125.0
    assert unknown._form_error("speed", cogging) == 0.0
    over_place, over_speed = FIT._replace(basis=PLACE), FIT
    assert unknown._clear([over_place, over_speed], cogging, 50.0) == [over_speed]


@pytest.mark.parametrize(("free", "gain"), [(True, 4.0 * (2.0 - 1.0 / 3.0)), (False, 0.0)])
def test_a_bias_may_leave_a_tenth_of_what_the_rest_of_the_base_cannot_explain(
    free: bool, gain: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of an asymmetry the fit makes a bias; after a reversal it leaves a part, which is no unknown next to it."""
    names = ["inertia", *(["bias"] if free else [])]
    effort = np.array([[[3.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1.0]]])
    g = SimpleNamespace(effort=effort, places=lambda wanted: [("inertia", "bias").index(name) for name in wanted])
    monkeypatch.setattr(gram_matrices, "fold_sums", lambda *_: g)
    monkeypatch.setattr(refine, "nuisances", lambda _: names)
    base = SimpleNamespace(prior=SimpleNamespace(moved=lambda model, name: -2.0), products=None)
    e, now = (
        SimpleNamespace(base=base, runs=[SimpleNamespace(paths=[1, 2])]),
        SimpleNamespace(model=None, residuals=None),
    )
    part = unknown._asymmetry(*cast("Any", (e, now)))
    assert part.may_leave == pytest.approx(0.1 * gain / 2.0) and "displacement_since_reversal" in part.seen_over


@pytest.mark.parametrize(
    ("coordinate", "kind", "pitch", "said"),
    [
        ("position", "linear", TURN, True),
        ("speed", "linear", TURN, False),
        ("position", "linear", 0.032, False),
        ("position", "rotary", TURN, False),
    ],
)
def test_an_unknown_over_the_position_asks_for_the_pitch(coordinate: str, kind: str, pitch: float, said: bool) -> None:
    session: Any = SimpleNamespace(kind=kind, stage=SimpleNamespace(mechanics=SimpleNamespace(pitch=pitch)))
    shape = UnknownTerm(coordinate, np.zeros(2), np.zeros(2), 0.8)
    assert ["stage.pitch" in text for text in unknown.without_pitch(session, shape)] == [True] * said
    assert not unknown.without_pitch(session, None)


def test_a_shape_that_the_model_can_hold_is_taken_before_a_richer_one() -> None:
    richer = FIT._replace(parts=(EVEN, ODD, INERTIAL), gain=105.0)
    assert shape_fits.best_of([richer, FIT]) is FIT
    assert shape_fits.best_of([richer._replace(gain=120.0), FIT]).gain == 120.0


def test_the_force_of_a_shape_is_even_plus_odd_in_the_direction() -> None:
    """Even: 1 at standstill, 3 at top speed; odd: 2 at top speed."""
    amplitudes = {EVEN: np.array([1.0, 2.0, 3.0]), ODD: np.array([0.0, 1.0, 2.0])}
    grid, force = shape_fits._force(SPEED, amplitudes)
    assert grid[[0, -1]].tolist() == [-2.0, 2.0] and len(grid) % 2 == 1
    assert force[[0, len(grid) // 2, -1]] == pytest.approx([1.0, 1.0, 5.0])
    grid, force = shape_fits._force(PLACE, {EVEN: np.array([1.0, 2.0, 3.0])})
    assert grid[0] == 0.0 and force == pytest.approx(1.0 + grid)
    against = {EVEN: np.array([1.0, 2.0, 3.0]), ODD: np.array([-1.0, -2.0, -3.0])}  # nothing of it in the + direction
    assert shape_fits._force(PLACE, against)[1] == pytest.approx(2.0 + 2.0 * grid)


def test_what_is_predicted_counts_clear_shapes_and_the_clock_over_all_repeats(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shape_fits, "own_columns", lambda *_: None)
    monkeypatch.setattr(unknown, "least_gain", lambda _: 50.0)
    monkeypatch.setattr(refine, "repeated", lambda _: False)
    monkeypatch.setattr(unknown, "repeats_of", lambda _: 3.0)
    monkeypatch.setattr(shape_fits, "single_coordinate", lambda *_: [FIT, FIT._replace(gain=400.0, share=0.1)])
    course = 0.0
    monkeypatch.setattr(
        unstructured_residual, "clock_gain", lambda *given: (course if course > given[-1] else 0.0, 1.0)
    )
    assert unknown.predicted(NOTHING, NOTHING, NOTHING) == Predicted((300.0, 0.0), FIT.share)
    course = 500.0
    assert unknown.predicted(NOTHING, NOTHING, NOTHING).cuts[0] == 500.0
    course = 149.0
    monkeypatch.setattr(shape_fits, "single_coordinate", lambda *_: [])
    assert unknown.predicted(NOTHING, NOTHING, NOTHING) == Predicted()


@pytest.mark.parametrize(
    ("coordinate", "size", "matters"), [("direction", 1e-5, False), ("direction", 0.05, True), ("position", 1e-5, True)]
)
def test_a_direction_matters_as_a_shift_of_coulomb_friction_does(
    ball_screw: Setup, coordinate: str, size: float, matters: bool
) -> None:
    """On two machines whose gap was at its floor, 14 uN m and 3 mN m were unknowns that took the Coulomb friction."""
    force = np.full(3, size * sliding(ball_screw.stage.friction))
    now: Any = SimpleNamespace(model=SimpleNamespace(stage=ball_screw.stage))
    assert unknown._matters(UnknownTerm(coordinate, np.zeros(3), force, 1.0), now) is matters


@pytest.mark.parametrize("repeats", [2, 3, 10])
def test_noise_alone_leaves_no_more_above_its_floor(repeats: int) -> None:
    """In 97.5 % of cases; else a function predicts all of what is left, which is nothing."""
    rows, source, beyond = 500, np.random.default_rng(5), []
    run = SimpleNamespace(weight=np.ones(rows), paths=(None,) * repeats)
    e: Any = SimpleNamespace(runs=[run])
    for _ in range(2000):
        noise = source.standard_normal((repeats, rows))
        apart = noise - noise.mean(axis=0)
        floor = float(np.sum(apart**2)) / (repeats * (repeats - 1))
        left = float(np.sum(noise.mean(axis=0) ** 2)) - floor
        beyond.append(left > shape_fits._unsure(e, floor))
    assert 0.01 <= np.mean(beyond) <= 0.045
    assert shape_fits._unsure(e, 0.0) == 0.0  # without repeats nothing is known of the noise


def test_a_shape_predicts_what_the_folds_share() -> None:
    """Two folds with the same column in the residual; the limit is what a machine without an effect gains by it."""
    column = np.random.default_rng(1).standard_normal(2000)
    folds = []
    for _ in range(2):
        rows = np.stack([column, 2.0 * column, 3.0 * column])
        folds.append(rows @ rows.T)
    free = np.array(folds)
    power = float(9.0 * column @ column)
    gain, share, limit, _ = shape_fits._predicted(free, [0], [1], 0.5 * power)
    assert gain == pytest.approx(2.0 * power, rel=1e-2) and share == pytest.approx(2.0 / 1.5, rel=1e-2)
    assert limit == pytest.approx(gain * 4.0 / 9.0) and shape_fits._predicted(free, [0], [], 0.0)[2] == 0.0


def test_the_least_gain_is_a_share_of_what_could_be_closed() -> None:
    run = SimpleNamespace(weight=np.ones(10), paths=(1, 2))
    repeats = [np.full((10, 2), 2.0)] * 2
    e: Any = SimpleNamespace(
        runs=[run], base=SimpleNamespace(after=[repeats]), deviations=[[np.ones((10, 2)), -np.ones((10, 2))]]
    )
    assert shape_fits.floor_of(e) == pytest.approx(10.0)  # variance 2, of the mean 1 a row
    assert shape_fits.least_gain(e) == pytest.approx(0.1 * (40.0 - 10.0))
    assert shape_fits.repeats_of(e) == 2.0
