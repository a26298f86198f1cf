"""Parameters that are off: what a force constant that is off would explain as well."""

import numpy as np
import pytest

from stagectl.gap.inference import parameter_errors
from stagectl.gap.inference.parameter_errors import Estimate, Shift, common, shared
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.result.diagnosis import Value
from stagectl.kernels import friction, stage


def shift(name: str, change: float, sure: bool = True) -> Shift:
    return Shift(name, change, 1e-3, 0.3, Value(1.0, 0.9, 1.1, ""), sure)


def test_one_common_shift_is_the_force_constant() -> None:
    shifts = common([shift("inertia", 0.05), shift("viscous", 0.052), shift("coulomb", 0.049)])
    assert shifts is not None and shifts.name == "force_constant" and shifts.change == pytest.approx(1.0 / 1.05 - 1.0)


def test_two_that_agree_may_be_the_force_constant() -> None:
    """While the third has changed by itself, as an inertia whose value was off."""
    off = [shift("inertia", 0.091), shift("viscous", -0.0912), shift("coulomb", -0.0905)]
    assert common(off) is None and shared(off) == {"viscous", "coulomb"}


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
    [(1.05, 0.01, 0.3, True), (1.05, 0.02, 0.3, False), (1.005, 0.0, 0.3, False), (1.05, 0.01, 0.001, False)],
)
def test_a_shift_is_sure_large_and_material(value: float, deviation: float, share: float, sure: bool) -> None:
    changed = parameter_errors._shift("inertia", Estimate(value, 1.0, deviation, 1.0), share, "rotary")
    assert changed.sure is sure and changed.value.unit == "kg m^2"
    assert changed.change == pytest.approx(value - 1.0) and changed.value.high == pytest.approx(
        value + 1.96 * deviation
    )


def test_the_misfit_that_returns_is_what_the_others_cannot_take() -> None:
    """The column of the inertia is half that of another: moved by 2, all but what that one takes comes back."""
    rows = np.array([[1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    square = (rows @ rows.T)[None]
    nothing = np.zeros(1, dtype=np.int64)
    g = Grams(("inertia", "bias"), square, np.zeros_like(square), np.zeros((1, 2)), nothing, nothing)
    returned = parameter_errors._returned(g, ["inertia", "bias"], {"inertia": {"inertia": 2.0}, "coulomb": {"w": 1.0}})
    assert returned == pytest.approx({"inertia": 4.0 * (2.0 - 1.0)})


def test_half_of_the_friction_turns_round_in_half_its_length() -> None:
    """One stop operator of 3 um: straight to its end, after twice its slip."""
    p = stage.Friction(friction.bundle([2.0], [3e-6]), friction.Stribeck())
    assert parameter_errors.half_way(p) == pytest.approx(3e-6, rel=0.02)
