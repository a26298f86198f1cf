"""What an estimate keeps back from the stage file: parameters that a motion ties to each other go there together."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from stagectl.identification.result import Parameter
from stagectl.identification.simultaneous.notes import withheld
from stagectl.identification.thresholds import NORMAL_95
from stagectl.units import ROTARY

VALUES = {"inertia": 0.01, "viscous": 0.1, "coulomb": 1.0, "offset": 0.0, "delay": 0.0}


def kept_back(viscous: float, coulomb: float, correlation: float) -> set[str]:
    """Keys that are withheld where the halves (of their values) and the correlation of these two are such."""
    halves = np.array([0.01, viscous, coulomb, 0.0, 0.0]) * [*VALUES.values()]
    covariance = np.diag((halves / NORMAL_95) ** 2)
    covariance[1, 2] = covariance[2, 1] = correlation * halves[1] * halves[2] / NORMAL_95**2
    parameters = {
        name: Parameter.named(name, ROTARY, value, float(half))
        for (name, value), half in zip(VALUES.items(), halves, strict=True)
    }
    return set(withheld(cast(Any, SimpleNamespace(parameters=parameters, covariance=covariance))))


@pytest.mark.parametrize(
    ("viscous", "coulomb", "correlation", "expected"),
    [
        (0.05, 0.05, 0.0, set()),
        (0.05, 0.3, 0.0, {"friction"}),
        (0.05, 0.3, -0.8, set()),  # beside a known viscous friction within 18 %
        (0.05, 0.4, -0.8, {"friction"}),
        (0.25, 0.3, -0.97, set()),
        (0.3, 1.2, -0.97, {"friction", "mechanics.viscous"}),  # its interval reaches 0, and what is tied to it stays
        (1.2, 0.1, 0.97, {"friction", "mechanics.viscous"}),
        (1.2, 0.3, -0.8, {"friction", "mechanics.viscous"}),  # beside the old value it is known to 30 %
        (1.2, 0.1, -0.8, {"mechanics.viscous"}),
        (0.3, 0.3, 1.0, set()),
        (0.0, 0.0, 0.0, set()),
    ],
)  # fmt: skip
def test_tied_parameters_are_written_together_or_not_at_all(
    viscous: float, coulomb: float, correlation: float, expected: set[str]
) -> None:
    assert kept_back(viscous, coulomb, correlation) == expected
