"""Parameters that are off: what a force constant that is off would explain as well."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

import stagectl as sc
from stagectl.gap.inference import estimates, parameter_errors
from stagectl.gap.inference.estimates import Estimate, Joint
from stagectl.gap.inference.parameter_errors import Shift, common, shared
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.result.diagnosis import Value
from stagectl.gap.selection import refine
from tests.gap.captured import CONFIG, as_csv

NOTHING: Any = None


def shift(name: str, change: float, sure: bool = True) -> Shift:
    return Shift(name, change, 1e-3, 0.3, Value(1.0, 0.9, 1.1, ""), 0.99 if sure else 0.2)


def test_one_common_shift_is_the_force_constant() -> None:
    shifts = common([shift("inertia", 0.05), shift("viscous", 0.052), shift("coulomb", 0.049)])
    assert shifts is not None and shifts.name == "force_constant" and shifts.change == pytest.approx(1.0 / 1.05 - 1.0)


def test_two_that_agree_may_be_the_force_constant() -> None:
    """While the third has changed by itself, as an inertia whose value was off."""
    off = [shift("inertia", 0.091), shift("viscous", -0.0912), shift("coulomb", -0.0905)]
    assert common(off) is None and shared(off) == {"viscous", "coulomb"}


def test_a_force_constant_makes_no_friction_of_nothing() -> None:
    """Both were 0 in the model, so both have changed by all of themselves."""
    new = [shift(name, 1.0)._replace(from_nothing=True) for name in ("viscous", "coulomb")]
    assert shared([shift("inertia", 0.01), *new]) == frozenset()
    assert common([shift("inertia", 1.0), *new]) is None


@pytest.mark.parametrize(
    "shifts",
    [
        [shift("inertia", 0.09), shift("viscous", -0.09), shift("coulomb", 0.02)],
        [shift("inertia", 0.05), shift("viscous", 0.05, sure=False)],
        [shift("inertia", 0.05), shift("bias", 0.05)],
        [],
    ],
)
def test_otherwise_it_is_no_candidate(shifts: list[Shift]) -> None:
    assert shared(shifts) == frozenset()


@pytest.mark.parametrize(
    ("value", "deviation", "share", "sure"),
    [
        (1.05, 0.01, 0.3, True),
        (1.28, 0.15, 0.3, False),  # p 0.64 by its size, and 95 % hold the nominal value
        (1.012, 0.002, 0.3, True),
        (1.009, 0.002, 0.3, False),
        (1.005, 0.0, 0.3, False),
        (1.05, 0.01, 0.001, False),
        (1.0, 0.3, 0.3, False),  # the data say nothing
        (1.1, 0.2, 0.3, False),  # and next to nothing
    ],
)
def test_a_shift_is_sure_large_and_material(value: float, deviation: float, share: float, sure: bool) -> None:
    changed = parameter_errors._shift("inertia", [Estimate(value, 1.0, deviation, 1.0, 0.3)], share, "rotary")
    assert changed.sure is sure and changed.value.unit == "kg m^2"
    assert changed.change == pytest.approx(value - 1.0) and changed.value.high == pytest.approx(
        value + 1.96 * deviation
    )


def test_a_shift_is_no_surer_than_by_the_least_sure_division_of_the_data() -> None:
    alone, beside = Estimate(1.1, 1.0, 0.01, 1.0, 0.3), Estimate(1.02, 1.0, 0.1, 1.0, 0.3)
    found, turned = (parameter_errors._shift("inertia", views, 0.3, "rotary") for views in ([alone, beside], [beside]))
    assert found.probability == turned.probability < 0.5
    assert found.change == pytest.approx(0.1) and found.deviation == pytest.approx(np.hypot(0.1, 0.08))
    assert parameter_errors._shift("inertia", [beside, alone], 0.3, "rotary").probability == found.probability


def test_a_value_that_can_only_be_larger_still_is_as_far_off_as_it_seems() -> None:
    """Jitter of a position makes an inertia too small: one above the nominal value is off all the more."""
    above, below = (Estimate(value, 1.0, 0.02, 1.0, 0.3, larger=0.5) for value in (1.3, 0.7))
    assert parameter_errors._probability("inertia", above) > 0.99
    assert parameter_errors._probability("inertia", below) < 0.5
    found = parameter_errors._shift("inertia", [above], 0.3, "rotary").value
    assert (found.low, found.high) == pytest.approx((1.3 - 1.96 * 0.02, 1.8 + 1.96 * 0.02), rel=1e-3)


@pytest.mark.parametrize(("value", "expected"), [(0.02, 0.5), (0.021, 0.841), (-0.019, 0.159)])
def test_a_sure_shift_is_as_probable_as_that_it_exceeds_what_matters(value: float, expected: float) -> None:
    """Two per cent of the friction matter, for a bias; its deviation is a thousandth."""
    found = parameter_errors._probability("bias", Estimate(value, 0.0, 1e-3, 1.0, 0.3))
    assert found == pytest.approx(expected, abs=1e-3)


def test_of_a_parameter_that_was_not_excited_nothing_is_said() -> None:
    """Its interval is as wide as what was known before, and so beyond everything that matters."""
    assert parameter_errors._probability("inertia", Estimate(2.0, 2.0, 0.6, 2.0, 0.6)) < 0.5


def test_what_is_known_of_a_friction_is_what_is_known_of_all_its_forces() -> None:
    """Each may be off by 0.3 N m before the data, so that their sum may by the root of three times as much."""
    names = ("inertia", "weight_0", "weight_1", "weight_2", "cogging.sine")
    prior = SimpleNamespace(width=lambda name: 0.1 if name == "inertia" else 0.3)
    base = SimpleNamespace(directions=[SimpleNamespace(name=name) for name in names[:4]], prior=prior)
    rows = np.array([estimates._functional(name, names, 0.0) for name in ("inertia", "coulomb")])
    width = estimates._width(rows, cast("Any", SimpleNamespace(base=base)), names)
    assert width == pytest.approx([0.1, 0.3 * 3.0**0.5])


def grams(names: tuple[str, ...], columns: NDArray[np.float64]) -> Grams:
    """Of `columns` (k, m), with a residual of zero."""
    rows = np.vstack([columns, np.zeros(columns.shape[1])])
    square, nothing = (rows @ rows.T)[None], np.zeros(1, dtype=np.int64)
    return Grams(names, square, np.zeros_like(square), np.zeros((1, 2)), nothing, nothing)


def test_the_misfit_that_returns_is_what_the_others_cannot_take() -> None:
    """The column of the inertia is half that of another: moved by 2, all but what that one takes comes back."""
    g = grams(("inertia", "bias"), np.array([[1.0, 1.0], [1.0, 0.0]]))
    found = parameter_errors._materials(g, ["inertia", "bias"], {"inertia": {"inertia": 2.0}}, 1e-3)
    assert found["inertia"].misfit == pytest.approx(4.0 * (2.0 - 1.0)) and found["inertia"].given == ()


def test_two_that_stand_in_for_each_other_are_material_together() -> None:
    """At one speed viscous and Coulomb friction are nearly one column: neither alone is missed, but one of them is."""
    columns = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.1]])
    moves = {name: {name: 1.0} for name in ("viscous", "coulomb")}
    found = parameter_errors._materials(grams(tuple(moves), columns), list(moves), moves, 0.05)
    assert found["viscous"].misfit + found["coulomb"].misfit > 7.9
    first, second = sorted((found["viscous"], found["coulomb"]), key=lambda part: -part.misfit)
    assert len(first.given) == len(first.alike) == 1 and second.misfit < 0.05


def test_a_parameter_given_another_is_what_the_fit_would_say_without_that_one() -> None:
    """Errors that go against each other: put one back by 0.2, and the other follows by as much."""
    known = {name: Estimate(0.8 if name == "viscous" else 0.2, 0.0, 0.5, 1.0, 1.0) for name in ("viscous", "coulomb")}
    joint = Joint(known, np.array([[0.25, -0.24], [-0.24, 0.25]]))
    alone = joint.given("viscous", ["coulomb", "inertia"])
    assert alone.value == pytest.approx(0.8 + 0.24 / 0.25 * 0.2)
    assert alone.deviation == pytest.approx((0.25 - 0.24**2 / 0.25) ** 0.5)
    assert joint.given("viscous", []).deviation == pytest.approx(0.5)


def test_the_friction_of_a_nominal_bristle_that_is_off(tmp_path: Path) -> None:
    """Its force counts in shares of the nominal one: a fifth more is found, with an interval that holds it."""
    law = {"law": "dahl", "coulomb": 1.0, "range": 9e-4, "exponent": 1.0}
    stage = sc.load_stage(CONFIG / "ball-screw.yaml").changed({"friction": law})
    machine = stage.changed({"friction.coulomb": 1.2, "simulation.current_noise": 20e-3})
    motions = [CONFIG / "trajectories" / f"{name}.yaml" for name in ("sine-0.8hz", "sine-3.2hz")]
    logs = [as_csv(sc.simulate(stage, path, plant=machine), tmp_path / f"{path.stem}.csv") for path in motions]
    (found,) = (one for one in sc.diagnose(logs, stage=stage, advice=False).named if one.name == "coulomb")
    value = found.parameters["coulomb"]
    assert value.low < 1.2 < value.high and value.value == pytest.approx(1.2, abs=0.02) and value.low > 1.05


@pytest.mark.parametrize(
    ("before", "left", "scale"),
    [
        (1000.0, 100.0, 100.0),  # another error is large
        (150.0, 100.0, 60.0),  # nearly all is noise
        (80.0, 100.0, 1e-300),  # nothing is to close: any shift would be material, and none is probable
    ],
)
def test_what_a_shift_is_worth_counts_next_to_the_gap_or_to_what_is_left(
    monkeypatch: pytest.MonkeyPatch, before: float, left: float, scale: float
) -> None:
    monkeypatch.setattr(refine, "total", lambda _, residuals: residuals[0])
    monkeypatch.setattr(refine, "floor", lambda _: 90.0)
    evidence: Any = SimpleNamespace(base=SimpleNamespace(before=[before]))
    assert parameter_errors._scale(evidence, cast("Any", SimpleNamespace(residuals=[left]))) == scale


def test_a_small_error_is_found_next_to_a_large_one(tmp_path: Path) -> None:
    """An inertia two thirds too small makes nearly all of the gap; a friction off by 5 % counts all the same."""
    stage = sc.load_stage(CONFIG / "ball-screw.yaml")
    machine = stage.changed({"mechanics.inertia": 0.03, "friction.coulomb": 1.05, "simulation.current_noise": 20e-3})
    motions = [CONFIG / "trajectories" / f"{name}.yaml" for name in ("sine-1.6hz", "sine-3.2hz")]
    logs = [as_csv(sc.simulate(stage, path, plant=machine), tmp_path / f"{path.stem}.csv") for path in motions]
    found = {one.name: one for one in sc.diagnose(logs, stage=stage, advice=False).named}
    assert {"inertia", "coulomb"} <= set(found)
    assert found["coulomb"].parameters["coulomb"].value == pytest.approx(1.05, rel=0.01)
