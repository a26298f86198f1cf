"""What sampling does not resolve: friction that turns round within the window of a reversal.

There its sign is not known, and what the Coulomb friction loses the viscous one gains: the share of rows in which the
shortest element is on its way tells how much, in the force and over the rms velocity in the viscous friction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stagectl.identification.capture import Array
from stagectl.identification.result import Parameter
from stagectl.identification.simultaneous.delay_search import Fit, Problem
from stagectl.identification.simultaneous.regressors import ACCELERATION, FREE, VELOCITY

MOST = 0.5  # of the friction, in elements that sampling hides, from which the rest cannot be told
NEAR = 4.0  # times what the axis travels between two rows around a reversal: sampling hides shorter slips
TURNED = 0.99  # of an element's force: from here on it slips


UNSURE, USELESS = 0.05, 0.2  # half of an interval over its value: of a doubtful viscous friction, of any parameter
KEYS = {"inertia": "mechanics.inertia", "viscous": "mechanics.viscous", "coulomb": "friction"}  # of the stage file


class Unresolved(NamedTuple):
    """How much of the friction lies in the shortest element that carries, and what that leaves open."""

    share: float  # of the friction; 0 where the grid goes on below that element
    slip: float  # rad | m
    error: Array  # (5,) of intervals.NAMES: viscous and Coulomb friction, of one another


def unresolved(p: Problem, fit: Fit) -> Unresolved:
    """Friction in the shortest element of the grid, and what most of it between two rows leaves uncertain."""
    weight = fit.theta[FREE:]
    first, total, error = int(np.argmax(weight > 0.0)), float(weight.sum()), np.zeros(5)
    share = float(weight[first]) / total if total > 0.0 and first <= 1 else 0.0
    hidden = p.slip <= NEAR * _skipped(p)
    if float(weight[hidden].sum()) > MOST * total:
        state = np.abs(p.columns[:, FREE:][:, hidden])
        turning = np.mean(state < TURNED * state.max(axis=0), axis=0)
        error[2] = -float(turning @ weight[hidden])
        error[1] = -error[2] / float(np.sqrt(np.mean(p.columns[:, VELOCITY] ** 2)))
    return Unresolved(share, float(p.slip[first]), error)


def _skipped(p: Problem) -> float:
    """Travel (rad | m) within half a sampling time either side of a reversal, twice: to it and back."""
    dt = max(one.capture.dt for one in p.parts)
    return 0.25 * dt * dt * float(np.sqrt(np.mean(p.columns[:, ACCELERATION] ** 2)))


def withheld(parameters: dict[str, Parameter], short: Unresolved) -> dict[str, str]:
    """What is not known well enough for a stage file, by its key there, with a note that says why."""
    found = {}
    for name, key in KEYS.items():
        value, low, high, _ = parameters[name]
        half = 0.5 * (high - low)
        mixed = name == "viscous" and short.error[1] != 0.0 and half > UNSURE * abs(value)
        if low <= 0.0 or half > USELESS * abs(value):
            found[key] = (
                f"{name}: {value:.3g} ± {half:.2g} is left out of the stage file's changes; its interval must lie "
                f"above 0 and within ±{100.0 * USELESS:.0f} %"
            )
        elif name == "viscous" and KEYS["inertia"] in found:
            found[key] = (
                f"{name}: {value:.3g} ± {half:.2g} is left out of the stage file's changes, as the inertia found with "
                "it is not known: a slow log leaves both open; sample faster, or give --delay"
            )
        elif mixed:
            found[key] = (
                f"{name}: {value:.3g} ± {half:.2g} is left out of the stage file's changes, as this sampling does not "
                "tell it from friction"
            )
    return found
