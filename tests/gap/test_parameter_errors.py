"""Parameters that are off: what a force constant that is off would explain as well."""

import pytest

from stagectl.gap.inference.parameter_errors import Shift, common, shared
from stagectl.gap.result.diagnosis import Value


def shift(name: str, change: float, sure: bool = True) -> Shift:
    return Shift(name, change, 1e-3, 0.3, Value(1.0, 0.9, 1.1, ""), sure)


def test_one_common_shift_is_the_force_constant() -> None:
    found = common([shift("inertia", 0.05), shift("viscous", 0.052), shift("coulomb", 0.049)])
    assert found is not None and found.name == "force_constant" and found.change == pytest.approx(1.0 / 1.05 - 1.0)


def test_two_that_agree_may_be_the_force_constant() -> None:
    """While the third has changed by itself, as an inertia whose value was off."""
    off = [shift("inertia", 0.091), shift("viscous", -0.0912), shift("coulomb", -0.0905)]
    assert common(off) is None and shared(off) == {"viscous", "coulomb"}


@pytest.mark.parametrize(
    "found",
    [
        [shift("inertia", 0.09), shift("viscous", -0.09), shift("coulomb", 0.02)],
        [shift("inertia", 0.05), shift("viscous", 0.05, sure=False)],
        [shift("inertia", 0.05), shift("bias", 0.05)],
        [],
    ],
)
def test_otherwise_it_is_no_candidate(found: list[Shift]) -> None:
    assert shared(found) == frozenset()
