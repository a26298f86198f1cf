"""Frequencies at which the machine's base rings: where its answer to the motion explains most of what is missing.

A line in the spectrum of the residual is no sign of a ring: whatever a multisine excites leaves lines at its tones.  A
ring is known by its answer to the acceleration.  With a moving mass that is small against the base, a rigid model needs
more effort along the path than a machine on feet of the frequency w, by (s is the Laplace variable)::

    mu J q'' s^2 / (s^2 + 2 zeta w s + w^2)
"""

from collections.abc import Sequence

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import least_squares, thresholds, tracker_response, whitening
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.pitch_orders import peaks
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.residuals.thresholds import KEPT
from stagectl.gap.residuals.whitening import Whitener
from stagectl.parallel import in_parallel

RIGID = (0, 1, 2)  # derivatives of the position whose efforts a spring, viscous friction and an inertia have


def modes(p: TrackedModel, runs: Sequence[Run], residuals: Sequence[list[Array]], noise: Whitener) -> tuple[float, ...]:
    """Frequencies (Hz) of the rings that explain most of the `residuals` of `p`, next to a rigid body; best first."""
    grid = np.geomspace(thresholds.LOWEST_MODE, thresholds.HIGHEST_MODE, thresholds.MODES_TRIED)
    pairs = list(zip(runs, residuals, strict=True))
    products = np.sum(in_parallel(lambda pair: _products(p, *pair, noise, grid), pairs), axis=0)
    explained = np.array([_explained(square) for square in products])
    higher = np.pad(explained, 1)
    summit = (explained > higher[:-2]) & (explained >= higher[2:])
    return peaks(grid[summit], explained[summit], thresholds.MODES_APART)


def _products(p: TrackedModel, run: Run, repeats: list[Array], noise: Whitener, grid: Array) -> Array:
    """(k, 5, 5) products of the rigid body's columns, the ring's at each frequency of `grid` (k,), and the residual."""
    dt, count = run.mean.dt, len(run.weight)
    lines = tracker_response.lines_of(count, dt * KEPT)
    s = 2j * np.pi * lines
    seen = tracker_response.tracking(p, lines, dt) * whitening.gains(noise, lines, dt)[0]
    seen = seen * np.exp(s * p.stage.encoder.delay_samples * dt)  # the position is logged that late
    position = run.mean.rows[::KEPT, 1] - run.mean.rows[0, 1]
    rigid = [tracker_response.filtered(position, seen * s**order) for order in RIGID]
    rows = np.stack([*rigid, np.zeros(count), np.mean(repeats, axis=0)[:, 0]]) * run.weight
    products = []
    for w in 2.0 * np.pi * grid:
        ring = s**4 / (s * s + 2.0 * thresholds.MODE_DAMPING * w * s + w * w)
        rows[-2] = tracker_response.filtered(position, seen * ring) * run.weight
        products.append(rows @ rows.T)
    return np.array(products)


def _explained(square: Array) -> float:
    """Sum of squares that the ring explains beyond the rigid body, from their products (5, 5); 0 of a negative mass."""
    inverse = least_squares.inverse(square[:-1, :-1])
    mass = float(inverse[-1] @ square[:-1, -1])
    return mass * mass / float(inverse[-1, -1]) if mass > 0.0 else 0.0
