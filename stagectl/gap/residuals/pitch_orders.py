"""Orders of the pitch in the residual effort: where to look for cogging, ripple and ball passes.

The periodogram runs over the angle, not over time: a machine's orders stay in place there while its speed changes.
It is taken of the effort at the instant at which it acted.  The tracker's answer comes milliseconds later: fine orders
lie elsewhere in either direction there, and cancel.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.ndimage import median_filter

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import thresholds
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.sensitivities import TrackedModel, model_residual
from stagectl.gap.residuals.tracker_response import in_time, untracked
from stagectl.gap.residuals.whitening import Whitener, whitened
from stagectl.parallel import in_parallel


class Samples(NamedTuple):
    """Samples (n,) of all runs in which the axis moves well."""

    effort: Array  # what the model lacks
    position: Array  # rad | m
    direction: Array  # sign of the velocity
    current: Array  # A


class Lines(NamedTuple):
    """A spectrum over the position, against its surroundings."""

    orders: Array  # (k,) of the pitch
    power: Array  # (k,)
    height: Array  # (k,) power over the median of the surroundings
    apart: float  # orders that the travel tells apart

    def highest(self) -> float:
        """The order of the highest line."""
        return self._order(int(np.argmax(self.height)))

    def strongest(self, least: float) -> float | None:
        """The order of the line with most power of those that are `least` high, apart from the lead's; None without."""
        lead = np.abs(self.orders[:, None] - np.array(thresholds.LEAD_ORDERS)).min(axis=1) <= self.apart
        high = np.where((self.height >= least) & ~lead, self.power, 0.0)
        return self._order(int(np.argmax(high))) if high.any() else None

    def _order(self, k: int) -> float:
        """The order of line `k`, between two of `orders`; a whole one where the travel does not part them."""
        off = 0.0
        if 0 < k < len(self.orders) - 1:
            before, at, after = np.log(self.power[k - 1 : k + 2])
            bend = before - 2.0 * at + after
            off = 0.5 * float(before - after) / float(bend) if bend < 0.0 else 0.0
        line = float(self.orders[k] + min(max(off, -0.5), 0.5) * (self.orders[1] - self.orders[0]))
        whole = float(round(line))
        return whole if whole and abs(line - whole) <= self.apart < 0.5 else line


STANDING = Samples(*np.zeros((4, 1)))


def orders(p: TrackedModel, runs: Sequence[Run], pitch: float, noise: Whitener) -> dict[str, tuple[float, ...]]:
    """Orders by effect, strongest first, in what `p` lacks along `runs`; `pitch`: the travel of a turn (rad | m)."""

    def effort(run: Run) -> Array:
        dt = run.mean.dt
        return in_time(whitened(noise, model_residual(p, run.mean), dt)[:, 0], p, dt, thresholds.KEPT)

    if all(np.ptp(run.mean.rows[:, 1]) < thresholds.COVERED * pitch for run in runs):
        return _of_no_pitch(p, runs, pitch)
    samples = _samples(runs, pitch, p.stage.encoder.delay_samples, effort)
    highest = _resolved(runs, pitch, thresholds.ORDERS)
    turns, whole = samples.position / pitch, np.arange(1, highest + 1)
    signals = np.stack([samples.effort, samples.effort * samples.current, samples.effort * samples.direction])
    cogging, ripple = power(signals[:2], turns, highest)
    balls = power(signals[2:], turns / thresholds.ORDERS_PER_WHOLE, thresholds.HIGHEST_FRACTIONAL)[0]
    steps = _fractional(pitch / _travel(runs))
    return {
        "cogging": _with_line(peaks(whole, cogging), lines(p, runs, pitch)),
        "current_ripple": peaks(whole, ripple),
        "ball_pass_ripple": peaks(steps / thresholds.ORDERS_PER_WHOLE, balls[steps - 1], thresholds.ORDERS_APART),
    }


def _fractional(told: float) -> NDArray[np.int64]:
    """Orders of a ball pass, in steps: all but the lead's, and those less than `told` orders apart from these."""
    steps = np.arange(thresholds.LOWEST_FRACTIONAL, thresholds.HIGHEST_FRACTIONAL + 1)
    lead = thresholds.ORDERS_PER_WHOLE * np.array(thresholds.LEAD_ORDERS)
    apart = max(thresholds.APART_FROM_LEAD, thresholds.ORDERS_PER_WHOLE * told)
    kept: NDArray[np.int64] = steps[np.abs(steps[:, None] - lead).min(axis=1) >= apart]
    return kept


def _with_line(orders: tuple[float, ...], found: Lines) -> tuple[float, ...]:
    """`orders`, and that of the highest line, which may be a small part of the whole."""
    order = found.highest()
    return orders if order in orders else (*orders, order)


def _of_no_pitch(p: TrackedModel, runs: Sequence[Run], pitch: float) -> dict[str, tuple[float, ...]]:
    """Orders of cogging where no run covers the `pitch`.

    A nominal model that gives no pitch has one of a whole turn, or of 2 pi m.
    """
    found = lines(p, runs, pitch)
    return {"cogging": peaks(found.orders, found.height, found.apart)}


def lines(p: TrackedModel, runs: Sequence[Run], pitch: float, by_current: bool = False) -> Lines:
    """The spectrum of what `p` lacks over the position of the longest `runs`, from a quarter of their travel down.

    `by_current`: of its product with the current, in which a ripple of what the current gives is a line.
    """

    def effort(run: Run) -> Array:
        return untracked(model_residual(p, run.mean).effort, p, run.mean.dt)[:: thresholds.KEPT]

    travel = _travel(runs)
    turn = thresholds.STEPS_PER_TRAVEL * travel
    samples = _samples(runs, travel, p.stage.encoder.delay_samples, effort)
    most = _resolved(runs, turn, thresholds.STEPS)
    grid = np.arange(thresholds.STEPS_PER_TRAVEL * thresholds.FEWEST_PERIODS, most + 1)
    signal = samples.effort * samples.current if by_current else samples.effort
    spectrum = power(signal[None], samples.position / turn, most)[0][grid - 1]
    # The stroke itself has a spectrum that falls with the order: a line must stand out of its surroundings.
    # At the lowest order these lie to one side: mirrored, as copies of the end would be those of a line there.
    around = np.maximum(median_filter(spectrum, thresholds.ORDER_SURROUNDINGS, mode="reflect"), 1e-300)
    orders: Array = grid.astype(np.float64) * (pitch / turn)
    return Lines(orders, spectrum, spectrum / around, pitch / travel)


def _travel(runs: Sequence[Run]) -> float:
    """The longest travel (rad | m)."""
    return max(float(np.ptp(run.mean.rows[:, 1])) for run in runs)


def _resolved(runs: Sequence[Run], turn: float, limits: tuple[int, int]) -> int:
    """Largest number of periods in `turn` (rad | m) that rows show at the largest speed, within `limits`.

    At one speed rows are a grid of places, on which fine periods look like coarse ones, and a constant like fine ones.
    """
    ways = [np.abs(np.diff(run.mean.rows[:: thresholds.KEPT, 1])) for run in runs]
    finest = 2.0 * max(float(np.quantile(way, thresholds.FAST_ROWS)) for way in ways)
    return int(np.clip(turn / max(finest, 1e-300), *limits))


def _samples(runs: Sequence[Run], least: float, late: int, effort: Callable[[Run], Array]) -> Samples:
    """Samples of every run that covers nearly `least` (rad | m); a single zero where none does.

    `effort` gives every `KEPT`-th sample of a run; the position is read `late` (samples).
    """
    far = [run for run in runs if np.ptp(run.mean.rows[:, 1]) >= thresholds.COVERED * least]
    parts = in_parallel(lambda run: _moving(run, effort(run), late), far)
    return Samples(*(np.concatenate(signals) for signals in zip(*parts, strict=True))) if parts else STANDING


def _moving(run: Run, effort: Array, late: int) -> Samples:
    """The samples in which the run moves."""
    rows = run.mean.rows
    position = np.pad(rows[late:, 1], (0, late), mode="edge")[:: thresholds.KEPT]
    velocity = np.gradient(position, run.mean.dt * thresholds.KEPT)
    signals = np.stack([effort, position, np.sign(velocity), rows[:: thresholds.KEPT, 0]])
    speed = np.abs(velocity)
    return Samples(*signals[:, (speed > thresholds.MOVING * speed.max(initial=0.0)) & (run.weight > 0.0)])


def power(signals: Array, turns: Array, highest: int) -> Array:
    """Periodograms (s, highest) of `signals` (s, n) over `turns` (n,), at 1 to `highest` periods a turn."""
    bins = thresholds.BINS_PER_PERIOD * highest
    place = np.floor(bins * (turns % 1.0)).astype(int) % bins
    sums = [np.bincount(place, signal - signal.mean(), bins) for signal in signals]
    spectra: Array = np.abs(fft.rfft(np.stack(sums))[:, 1 : highest + 1]) ** 2 / len(turns)
    return spectra


def peaks(grid: Array | NDArray[np.int64], strength: Array, apart: float = 0.0) -> tuple[float, ...]:
    """The `PEAKS` places on `grid` (k,) with the largest `strength` (k,) that lie more than `apart` from each other."""
    chosen: list[float] = []
    for k in np.argsort(strength)[::-1]:
        if all(abs(grid[k] - other) > apart for other in chosen):
            chosen.append(float(grid[k]))
        if len(chosen) == thresholds.PEAKS:
            break
    return tuple(chosen)
