"""The equation of motion as a linear model: its columns, what is known of them before the data, and its left sides.

``Kt i(t - tau) = J a + D v + b + ripple + sum_k f_k F_k(x)``, with the friction columns of `friction_columns`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from stagectl import gaussian_evidence as gaussian
from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Array
from stagectl.identification.simultaneous import captured_motion, friction_columns, laws, refinement, whitening
from stagectl.identification.simultaneous.beliefs import MECHANICAL, Beliefs, beliefs
from stagectl.identification.simultaneous.captured_motion import Motion
from stagectl.identification.simultaneous.regressors import (
    ACCELERATION,
    BEND,
    FREE,
    RIPPLE,
    VELOCITY,
    Part,
    coarse,
    currents,
    repeats,
    ripple_shares,
    stepped,
    window_correlation,
)
from stagectl.identification.simultaneous.sensor_noise import current_noise, rounding_noise
from stagectl.identification.simultaneous.whitening import Whitening
from stagectl.identification.simultaneous.windows import resolution

GROUPS = ("ripple", "bend", "operators", "bristles", "stribeck", "lag")
Scales = tuple[float, ...]  # of GROUPS, in units of the Coulomb friction


class DelayPrior(NamedTuple):
    """What is known of the delay before the data; a deviation of zero: it is given."""

    mean: float  # s
    deviation: float  # s

    @property
    def nodes(self) -> Array:
        """Delays that the search begins with."""
        if self.deviation == 0.0:
            return np.array([self.mean])
        span = thresholds.DELAY_SPAN * self.deviation
        return np.asarray(self.mean + np.linspace(-span, span, thresholds.DELAY_NODES), dtype=np.float64)

    def log_density(self, delays: Array) -> Array:
        """Up to a constant."""
        if self.deviation == 0.0:
            return np.zeros(len(delays))
        return np.asarray(-0.5 * ((delays - self.mean) / self.deviation) ** 2, dtype=np.float64)


class Forces(NamedTuple):
    """The left side at several delays, and its products with the columns."""

    delays: Array  # (k,) s
    rows: Array  # (rows, k) N m | N, as measured
    right: Array  # (m, k)
    square: Array  # (k,)


class Problem(NamedTuple):
    """Rows of all captures, and what is known before them."""

    parts: list[Part]
    shapes: friction_columns.Shapes
    columns: Array  # (rows, m): free, dense friction columns, the law's own, and its tangent
    laws: list[refinement.Refined]  # the best first: its columns are among them
    whitening: Whitening  # of the noise
    white: Array  # (n, m): the columns that it leaves
    gram: Array  # (m, m) of `white`
    before: Beliefs
    file: StageFile
    delay: DelayPrior
    gravity: bool = False  # the axis turns in gravity: sine and cosine of its angle
    acceleration_noise: float = 0.0  # sum of squares that `gram` lacks
    moved_share: float = 0.0  # of the residual's noise that lies in the acceleration
    noise_doubt: float = 0.0  # relative standard deviation of the acceleration's noise

    @property
    def coulomb(self) -> float:
        """About the Coulomb friction, N m | N."""
        return self.before.coulomb

    @property
    def stepped(self) -> bool:
        """Whether the encoder's noise is seen in an acceleration."""
        return any(stepped(p) for p in self.parts)

    @property
    def groups(self) -> dict[str, slice]:
        """Places of the groups in all columns."""
        friction = {name: slice(FREE + place.start, FREE + place.stop) for name, place in self.shapes.groups.items()}
        first = FREE + self.shapes.groups["lag"].stop
        last = first + len(self.laws[0].weights)
        forces = first + laws.LAWS[self.laws[0].name].forces
        own = {"law": slice(first, forces), "damping": slice(forces, last), "tangent": slice(last, len(self.gram))}
        return {"ripple": RIPPLE, "bend": BEND, **friction, **own}

    def forces(self, delays: Array) -> Forces:
        """Left sides at these delays (k,) s."""
        rows = self.file.motor.force_constant * currents(self.parts, delays)
        white = self.whitening(rows)
        return Forces(delays, rows, self.white.T @ white, np.sum(white * white, axis=0))

    def whitened(self, whitening: Whitening) -> Problem:
        """The same rows with another spectrum of their noise, and no noise taken out."""
        white = whitening(self.columns)
        return self._replace(
            whitening=whitening,
            white=white,
            gram=white.T @ white,
            acceleration_noise=0.0,
            moved_share=0.0,
            noise_doubt=0.0,
        )

    def noise(self, residual: Array) -> Whitening:
        """The filter that whitens the noise of a `residual` (rows,)."""
        return _noise(self.parts, residual, self.whitening.rows)

    def residual_square(self, theta: Array, forces: Forces) -> Array:
        """Sum of squares (k,) of the whitened residual at each delay with its `theta` (m, k); at least rounding's."""
        explained = np.sum(theta * (self.gram @ theta), axis=0) + self.acceleration_noise * theta[ACCELERATION] ** 2
        square = forces.square - 2.0 * np.sum(theta * forces.right, axis=0) + explained
        return np.asarray(np.maximum(square, thresholds.LEAST_RESIDUAL**2 * forces.square))

    def prior(self, scales: Scales) -> gaussian.Prior:
        """Of all columns, with these scales of the groups."""
        mean, deviation = np.zeros(len(self.gram)), np.full(len(self.gram), self.coulomb)
        mean[list(MECHANICAL)], deviation[list(MECHANICAL)] = self.before.mean, self.before.deviation
        for name, scale in zip(GROUPS, scales, strict=True):
            deviation[self.groups[name]] = max(scale, thresholds.NO_SCALE) * self.coulomb
        deviation[RIPPLE] = self.coulomb * _ripples(self.parts, self.file, scales[0], self.gravity)
        deviation[BEND] = _bends(self.before, self.shapes.fastest, scales[1])
        law, damping = self.groups["law"], self.groups["damping"]
        own = slice(law.start, damping.stop)
        mean[own], deviation[own] = laws.prior(law.stop - law.start, own.stop - own.start, self.coulomb)
        deviation[self.groups["tangent"]] = thresholds.TANGENT
        return gaussian.independent(mean, deviation)


def problem(parts: list[Part], file: StageFile, delay: DelayPrior, gravity: bool = False) -> Problem:
    """Columns of all `parts`, with the best law refined and the paths drawn by its model."""
    quiet = captured_motion.quiet(parts, gravity)
    known, shapes, seen = beliefs(quiet, file, delay.mean), quiet.shapes, captured_motion.resolved(quiet, parts)
    ranked = refinement.refined(_rough(seen, known, file, delay))
    plain = _setting(seen, known, file, delay)
    left = refinement.residual(ranked[0], plain)
    noise = _noise(parts, left, plain.whitening.rows)
    scatter = math.sqrt(thresholds.WINDOW_CORRELATION) * float(np.std(noise(left)))
    seen = seen._replace(paths=[_followed(p, x, ranked[0], seen, file) for p, x in zip(parts, seen.paths, strict=True)])
    white = _setting(seen, known, file, delay, noise)._replace(noise=scatter)
    white = white._replace(sensed=_sensed(white, parts, noise, file))
    ranked = refinement.refined_again(white, ranked)
    law, best = laws.LAWS[ranked[0].name], ranked[0]
    matrix = np.column_stack(
        [
            np.vstack(seen.free),
            np.vstack([friction_columns.columns(x, shapes) for x in seen.paths]),
            laws.columns(law, seen.paths, best.theta.tolist(), shapes),
            refinement.tangent(
                lambda theta: laws.columns(law, seen.paths, theta.tolist(), shapes) @ best.weights,
                best.theta,
                sum(p.rows for p in parts),
            ),
        ]
    )
    noise = noise._replace(rows=_spans(parts))
    return Problem(parts, shapes, matrix, ranked, noise, matrix, matrix, known, file, delay, gravity).whitened(noise)


def _rough(seen: Motion, before: Beliefs, file: StageFile, delay: DelayPrior) -> refinement.Setting:
    """What the laws are refined on before a residual is known: it counts as the path's error, or as rounding."""
    if not any(stepped(p) for p in seen.parts):
        plain = _setting(seen, before, file, delay)
        return plain._replace(sensed=math.inf) if any(coarse(p) for p in seen.parts) else plain
    rough, first = (thresholds.ROUGH_NOISE * before.coulomb) ** 2, seen.parts[0]
    row, count = first.places.step * first.capture.dt, file.mechanics.inertia * resolution(first.capture)
    power = rough * row / (2.0 * thresholds.WINDOW_BAND) / (count**2 / 12.0 * first.capture.dt)
    noise = whitening.with_corner(_spans(seen.parts), power**0.25 * row)
    scatter = math.sqrt(rough + _rounding(seen.parts, noise, file))
    return _setting(seen, before, file, delay, noise)._replace(sensed=rough, noise=scatter)


def _spans(parts: list[Part]) -> tuple[int, ...]:
    """Rows that follow each other, of all parts."""
    return tuple(count for p in parts for count in p.places.counts)


def _sensed(white: refinement.Setting, parts: list[Part], noise: Whitening, file: StageFile) -> float:
    """Variance (N m)^2 | N^2 of the noise that is not in the acceleration."""
    if any(stepped(p) for p in parts):  # what is not rounding; the controller's answer to it is in the current
        return max(0.0, white.noise**2 - _rounding(parts, noise, file))
    possible = whitening.floor(white.acceleration, noise.kept, window_correlation(parts[0]))
    return max(white.sensed, white.noise**2 - thresholds.WINDOW_CORRELATION * white.inertia**2 * possible)


def _rounding(parts: list[Part], noise: Whitening, file: StageFile) -> float:
    """Variance (N m)^2 | N^2 that a search is to assume for rounding."""
    return thresholds.WINDOW_CORRELATION * file.mechanics.inertia**2 * rounding_noise(parts, noise.response)


def _noise(parts: list[Part], residual: Array, rows: tuple[int, ...]) -> Whitening:
    """The filter that whitens the noise of a `residual` (n,)."""
    whitened = whitening.of_rounding if any(stepped(p) for p in parts) else whitening.of
    return whitened(residual, rows, window_correlation(parts[0]))


def _followed(
    p: Part, along: friction_columns.Path, law: refinement.Refined, seen: Motion, file: StageFile
) -> friction_columns.Path:
    """The path of the best law's model, where the measured one is too coarse between its rows.

    Within an encoder's count the model only knows the delay and the law that it was fitted with: it is not asked.
    """
    if not coarse(p) or (stepped(p) and p.capture.dt <= thresholds.PATH_STEP):
        return along
    time = np.clip(along.dt * np.arange(len(along.position)) - law.delay, 0.0, p.capture.time[-1])
    effort = file.motor.force_constant * CubicSpline(p.capture.time, p.capture.current)(time)
    return friction_columns.followed(p, along, refinement.acceleration(law, along, effort, seen.shapes))


def _setting(
    seen: Motion, before: Beliefs, file: StageFile, delay: DelayPrior, noise: Whitening | None = None
) -> refinement.Setting:
    """What the laws are refined on: the first rows of every capture, whitened as this `noise`; nothing bends yet."""
    rows = thresholds.LAW_STEPPED_ROWS if any(stepped(p) for p in seen.parts) else thresholds.LAW_ROWS
    most = max(1, rows // len(seen.parts))
    heads = [p._replace(places=p.places.head(most)) for p in seen.parts]
    white = whitening.none(_spans(heads))
    white = white if noise is None else noise._replace(rows=white.rows)
    free, force = white(np.vstack([one[:most, : BEND.start] for one in seen.free])), _forces(heads, file, delay)
    ripple = _ripples(heads, file, thresholds.FRICTION_SCALES[0][-1], seen.gravity)
    coulomb = before.coulomb
    return refinement.Setting(
        [x.head(most) for x in seen.paths],
        seen.shapes,
        white,
        free[:, ACCELERATION],
        free[:, VELOCITY:],
        free[:, VELOCITY:].T @ free[:, VELOCITY:],
        lambda late: white(force(late)),
        np.r_[before.mean[1], np.zeros(BEND.start - 2)],
        np.r_[before.deviation[1], coulomb, coulomb * ripple],
        coulomb,
        (delay.mean, delay.deviation),
        before.mean[0],
        before.inertia_doubt,
        math.log(before.inertia / before.mean[0]) / before.inertia_doubt,
        file.motor.force_constant**2 * float(np.mean(current_noise(heads, white.response))),
        thresholds.ROUGH_NOISE * coulomb,
    )


def _ripples(parts: list[Part], file: StageFile, scale: float, gravity: bool) -> Array:
    """Standard deviations (RIPPLE,) of the ripple's columns in Coulomb frictions; gravity is once a turn, too."""
    deviation = np.maximum(scale * ripple_shares(parts) * repeats(file), thresholds.NO_SCALE)
    deviation[:2] = thresholds.GRAVITY if gravity else deviation[:2]
    return np.asarray(deviation, dtype=np.float64)


def _bends(before: Beliefs, fastest: float, scale: float) -> Array:
    """Standard deviations (BEND,) of the bends' columns: at the `fastest` speed a share of the friction there."""
    friction = before.coulomb + abs(before.mean[1]) * fastest
    return np.asarray(max(scale, thresholds.NO_SCALE) * friction / fastest ** np.array([2.0, 3.0]))


def _forces(parts: list[Part], file: StageFile, delay: DelayPrior) -> Callable[[float], Array]:
    """The left side at any delay."""
    nodes = file.motor.force_constant * currents(parts, delay.nodes)
    return CubicSpline(delay.nodes, nodes, axis=1) if delay.deviation else lambda late: nodes[:, 0]
