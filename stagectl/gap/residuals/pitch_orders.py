"""Orders of the pitch in what is left: where to look for cogging, ripple, balls that pass, and the encoder's lines.

A periodogram over the angle, not over time: a machine's orders stand still there while its speed changes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.signal import welch

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.whitening import KEPT

HIGHEST = 60  # order
PEAKS = 3  # of each kind that are tried
FINE, APART_FROM_WHOLE = 20, 2  # orders that need not be whole are in twentieths, so many of them off a whole one
LOWEST, HIGHEST_MODE = 6.0, 75.0  # Hz: where a base rings
RINGING = 2.0  # s of a spectrum's segments: a mode of a few per cent of damping rings as long
SURROUNDINGS = 6.0  # Hz, to either side, of which a line stands out
APART = 2.0  # Hz between two modes


def orders(runs: Sequence[Run], left: Sequence[list[Array]], pitch: float) -> dict[str, tuple[float, ...]]:
    """Orders by effect, strongest first, from the whitened effort that is left."""
    effort, angle, side, current = (np.concatenate(parts) for parts in _samples(runs, left, pitch))
    whole = np.arange(1, HIGHEST + 1)
    steps = np.arange(26, FINE * HIGHEST // 2)
    steps = steps[np.abs(steps - FINE * np.round(steps / FINE)) >= APART_FROM_WHOLE]
    signals = np.stack([effort, effort * current, effort * side])
    cogging, ripple, lead = power(signals, angle, whole)
    balls = power(signals[2:], angle / FINE, steps)[0]
    return {
        "cogging": peaks(whole, cogging),
        "current_ripple": peaks(whole, ripple),
        "lead_friction": tuple(n for n in peaks(whole, lead) if n in (2.0, 3.0)),
        "ball_pass_ripple": peaks(steps / FINE, balls, 0.5),
    }


def modes(runs: Sequence[Run], left: Sequence[list[Array]]) -> tuple[float, ...]:
    """Frequencies (Hz) at which what is left rings, strongest first: lines that stand out of their surroundings."""
    dt = runs[0].mean.dt * KEPT
    segment = min(round(RINGING / dt), *(len(run.weight) for run in runs))
    total = 0.0
    for run, repeats in zip(runs, left, strict=True):
        effort = run.weight * np.mean(repeats, axis=0)[:, 0]
        frequency, power = welch(effort, 1.0 / dt, nperseg=segment, nfft=4 * segment)
        total = total + power * len(effort)
    within = (frequency > LOWEST) & (frequency < HIGHEST_MODE)
    about = median_filter(total, 1 + 2 * int(np.searchsorted(frequency, SURROUNDINGS)), mode="nearest")
    frequency, prominence = frequency[within], (total / np.maximum(about, 1e-300))[within]
    return tuple(f for f in peaks(frequency, prominence, APART))


def _samples(runs: Sequence[Run], left: Sequence[list[Array]], pitch: float) -> tuple[list[Array], ...]:
    """Effort, angle (rad), direction and current (of its largest) where the axis moves well, of every run."""
    found: tuple[list[Array], ...] = ([], [], [], [])
    for run, repeats in zip(runs, left, strict=True):
        position = run.mean.rows[::KEPT, 1]
        velocity = np.gradient(position, run.mean.dt * KEPT)
        fast = (np.abs(velocity) > 0.02 * np.abs(velocity).max(initial=0.0)) & (run.weight > 0.0)
        if np.ptp(position) < pitch:
            continue
        current = run.mean.rows[::KEPT, 0]
        parts = (np.mean(repeats, axis=0)[:, 0], 2.0 * np.pi / pitch * position, np.sign(velocity), current)
        for store, part in zip(found, parts, strict=True):
            store.append(part[fast])
    return tuple(one or [np.zeros(1)] for one in found)


def power(signals: Array, angle: Array, grid: NDArray[np.int64]) -> Array:
    """Periodograms (s, k) of `signals` (s, n) over `angle` (n,) rad at the whole orders `grid` (k,), which rise.

    From one order to the next it turns by products, not by sines: 1e-12 after a thousand of them.
    """
    signals = signals - signals.mean(axis=1, keepdims=True)
    turn, turned, at = np.exp(-1j * angle), np.exp(-1j * float(grid[0]) * angle), int(grid[0])
    found: Array = np.empty((len(signals), len(grid)))
    for k, order in enumerate(grid.tolist()):
        for _ in range(order - at):
            turned *= turn
        at = order
        found[:, k] = np.abs(signals @ turned) ** 2
    found /= signals.shape[1]
    return found


def peaks(grid: Array | NDArray[np.int64], found: Array, apart: float = 0.0) -> tuple[float, ...]:
    """The `PEAKS` strongest orders that are `apart` from each other."""
    chosen: list[float] = []
    for k in np.argsort(found)[::-1]:
        if all(abs(grid[k] - other) > apart for other in chosen):
            chosen.append(float(grid[k]))
        if len(chosen) == PEAKS:
            break
    return tuple(chosen)
