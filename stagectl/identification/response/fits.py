"""Inertia, viscous and rolling friction from the lines of a frequency response.

The effort that a line needs is ``Kt/H = J s + D + N``, N the describing function of the friction: for a sine of
velocity amplitude W and displacement amplitude X = W/w a stop operator of weight a and slip d gives

    N = (4 a/(pi W)) (1 - d/X) - j (a X/(pi d W)) (u - sin u cos u)      cos u = 1 - 2 d/X      X > d
    N = -j a X/(d W)                                                                            X <= d

so that far from presliding ``Re(Kt/H) = D + 4 Tc/(pi W)``.  Everything is linear in J, D and the weights, which are not
negative: one convex problem for each delay.  Near standstill, where the velocity is not a sine, the fundamental of its
sign replaces 4/pi (`lines.Curve.relay`).

Residuals are relative, as gains and phases are read from a Bode diagram.  Each line is weighted by its standard
deviation, but none is taken as better than half a per cent, the accuracy of a describing function.

Source: Simultaneous Identification ..., section IV.A.1 and Fig. 4; the describing function by integration of the
stop operator over a period (`kernels.friction`).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from stagectl.identification import thresholds
from stagectl.identification.capture import Array
from stagectl.identification.response.lines import Curve
from stagectl.identification.response.sampling_correction import Complex
from stagectl.identification.result import Parameter


class Lines(NamedTuple):
    """Sound lines (m,) of several curves in one row."""

    frequency: Array  # Hz
    effort: Complex  # Kt/H, N m s/rad | N s/m
    velocity: Array  # rad/s | m/s
    relay: Complex
    weight: Array  # of a line's misfit in Kt/H; its mean square times |Kt/H|^2 is 1

    @property
    def omega(self) -> Array:
        """Angular frequency (m,) rad/s."""
        return 2.0 * np.pi * self.frequency


class ResponseFit(NamedTuple):
    """A model and how it was fitted; NaN where it has no such parameter."""

    name: str
    values: Array  # (p,) inertia, viscous, then the weights of the operators
    covariance: NDArray[np.float64]  # (p + 1, p + 1) with the delay as the last one
    delay: float  # s, beyond that of the sampling
    slip: Array  # (p - 2,) rad | m
    residual: float  # rms, relative
    freedom: int  # of the residual

    @property
    def coulomb(self) -> float:
        """Sum of the weights (N m | N), NaN without friction in the model."""
        return float(np.sum(self.values[2:])) if len(self.slip) else math.nan

    def interval(self, combination: Array, unit: str) -> Parameter:
        """The linear `combination` (p + 1,) of values and delay with its 95 % interval."""
        value = float(combination @ np.append(self.values, self.delay))
        variance = max(float(combination @ self.covariance @ combination), 0.0)
        half = float(stats.t.ppf(thresholds.QUANTILE_95, max(self.freedom, 1)) * math.sqrt(variance))
        return Parameter.around(value, half, unit)


def lines(curves: list[Curve], force_constant: float) -> Lines:
    """The sound lines of all `curves`, as effort per velocity."""
    sound = [(curve, curve.sound) for curve in curves]
    response = np.concatenate([curve.response[keep] for curve, keep in sound])
    deviation = np.nan_to_num(np.concatenate([curve.deviation[keep] for curve, keep in sound])) / np.abs(response)
    share = 1.0 / np.hypot(deviation, thresholds.LINE_ACCURACY)
    return Lines(
        np.concatenate([curve.frequency[keep] for curve, keep in sound]),
        np.asarray(force_constant / response, dtype=np.complex128),
        np.concatenate([curve.velocity[keep] for curve, keep in sound]),
        np.concatenate([curve.relay[keep] for curve, keep in sound]),
        share / math.sqrt(float(np.mean(share**2))) * np.abs(response) / force_constant,
    )


def stop_operator(slip: Array, velocity: Array, omega: Array) -> Complex:
    """Describing function (m, j) per unit weight of operators that slip at `slip` (j,), for lines (m,)."""
    displacement = (velocity / omega)[:, None]
    ratio = np.minimum(slip / displacement, 1.0)
    angle = np.arccos(1.0 - 2.0 * ratio)
    loss = 4.0 / math.pi * (1.0 - ratio)
    stored = displacement / slip / math.pi * (angle - np.sin(angle) * np.cos(angle))
    return np.asarray((loss - 1j * stored) / velocity[:, None], dtype=np.complex128)


def gain_curve(p: Lines) -> ResponseFit:
    """Least squares on the logarithm of the gain alone, as a Bode gain is fitted by eye."""
    omega, size = p.omega, np.log(np.abs(p.effort))

    def residual(logs: Array) -> Array:
        return np.asarray(np.log(np.abs(1j * omega * math.exp(logs[0]) + math.exp(logs[1]))) - size)

    low, high = int(np.argmin(omega)), int(np.argmax(omega))
    solution = optimize.least_squares(residual, [size[high] - math.log(omega[high]), size[low]])
    rms = math.sqrt(float(np.mean(solution.fun**2)))
    return _without_covariance("gain curve", np.exp(solution.x), 0.0, rms)


def linear(p: Lines, lag: float = 0.0) -> ResponseFit:
    """Linear least squares on Kt/H, each line alike, with a `lag` (s) left in the response."""
    values = _linear(p, -lag, np.ones(len(p.frequency)))
    name = f"linear, {lag * 1e3:g} ms of lag left in" if lag else "linear least squares"
    misfit = p.effort * np.exp(1j * p.omega * lag) - (1j * p.omega * values[0] + values[1])
    return _without_covariance(name, values, lag, math.sqrt(float(np.mean(np.abs(misfit / p.effort) ** 2))))


def with_delay(p: Lines) -> ResponseFit:
    """Inertia, viscous friction and delay, relative residuals, no friction in the model."""
    return _searched(p, np.zeros(0), "delay")


def with_friction(p: Lines) -> ResponseFit:
    """The same with stop operators over the range of displacements of the lines."""
    displacement = p.velocity / p.omega
    slip = np.geomspace(
        thresholds.SHORTEST_RESPONSE_SLIP * np.min(displacement),
        thresholds.LONGEST_RESPONSE_SLIP * np.max(displacement),
        thresholds.RESPONSE_ELEMENTS,
    )
    return _searched(p, slip, "friction-corrected")


def _linear(p: Lines, delay: float, weight: Array) -> Array:
    effort = p.effort * np.exp(-1j * p.omega * delay)
    inertia = float(np.sum(weight * p.omega * effort.imag) / np.sum(weight * p.omega**2))
    return np.array([inertia, float(np.sum(weight * effort.real) / np.sum(weight))])


def _without_covariance(name: str, values: Array, delay: float, residual: float) -> ResponseFit:
    return ResponseFit(name, values, np.zeros((3, 3)), delay, np.zeros(0), residual, 1)


def _searched(p: Lines, slip: Array, name: str) -> ResponseFit:
    """Best delay by a bounded search, a convex problem at each."""
    model = _model(p, slip)

    def misfit(delay: float) -> float:
        return _solved(p, model, delay)[1]

    rough = np.linspace(thresholds.EARLIEST_DELAY, thresholds.LATEST_DELAY, 57)
    best = float(rough[int(np.argmin([misfit(delay) for delay in rough.tolist()]))])
    step = float(rough[1] - rough[0])
    bounds = (best - step, best + step)
    delay = float(optimize.minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 1e-10}).x)
    values, norm = _solved(p, model, delay)
    return _with_covariance(p, model, ResponseFit(name, values, np.zeros((0, 0)), delay, slip, norm, 0))


def _model(p: Lines, slip: Array) -> Complex:
    """Columns (m, 2 + j) of Kt/H over inertia, viscous friction and weights."""
    operators = stop_operator(slip, p.velocity, p.omega) * (p.relay * math.pi / 4.0)[:, None]
    return np.column_stack([1j * p.omega, np.ones(len(p.omega)), operators])


def _real(p: Lines, column: Complex) -> Array:
    """Real over imaginary part, weighted: (2 m,) or (2 m, k)."""
    scaled = (column.T * p.weight).T
    return np.concatenate([scaled.real, scaled.imag])


def _solved(p: Lines, model: Complex, delay: float) -> tuple[Array, float]:
    """Values (p,) that are not negative, and the norm of the relative residual."""
    columns = _real(p, model)
    length = np.linalg.norm(columns, axis=0)
    scaled, norm = optimize.nnls(columns / length, _real(p, p.effort * np.exp(-1j * p.omega * delay)))
    return np.asarray(scaled / length, dtype=np.float64), float(norm)


def _with_covariance(p: Lines, model: Complex, fit: ResponseFit) -> ResponseFit:
    """Covariance over the values that are not zero and the delay.

    From the residual's own size, or from the accuracy of a describing function where the residual is smaller: many
    operators fit a few lines better than their describing functions are true.
    """
    active = np.append(fit.values > 0.0, True)
    turned = p.effort * np.exp(-1j * p.omega * fit.delay)
    columns = np.column_stack([_real(p, model), _real(p, 1j * p.omega * turned)])[:, active]
    freedom = max(columns.shape[0] - columns.shape[1], 1)
    length = np.linalg.norm(columns, axis=0)
    inverse = np.linalg.pinv(columns / length) / length[:, None]
    covariance = np.zeros((len(active), len(active)))
    variance = max(fit.residual**2 / freedom, thresholds.LINE_ACCURACY**2)
    covariance[np.ix_(active, active)] = inverse @ inverse.T * variance
    return fit._replace(covariance=covariance, residual=fit.residual / math.sqrt(columns.shape[0]), freedom=freedom)
