"""What the noise of the current's sensor and the encoder's rounding leave in the rows of the regression."""

import numpy as np

from stagectl.identification.capture import Array
from stagectl.identification.simultaneous.regressors import Part, coarse
from stagectl.identification.simultaneous.windows import resolution, window


def current_noise(parts: list[Part], whitening: Array) -> tuple[float, float]:
    """Least and largest variance (A^2) that a current sensor's white noise leaves in the filtered current.

    Fourth differences hold noise, and at slow rows the motion itself.  Those over every second sample hold as much of
    the noise, twice as much of a current that jumps, and far more of one that is smooth: what does not double is noise
    at least, all of them are noise at most.

    `whitening` (p + 1,) are the weights of rows that the current has passed besides the window.  A commanded current
    has no such noise.  The controller's response to the encoder's rounding counts as such noise, too.
    """
    total = np.zeros(2)
    for p in parts:
        every, second = _differences(p.capture.current, 1), _differences(p.capture.current, 2)
        least = float(np.clip(2.0 * every - second, 0.0, every))
        total += p.rows * _passed(p, whitening) / 70.0 * np.array([least, every])
    least, most = (total / sum(p.rows for p in parts)).tolist()
    return least, most


def _differences(x: Array, step: int) -> float:
    """Mean square of the fourth differences of samples so many apart; 70 times the variance of white noise."""
    weights = np.zeros(4 * step + 1)
    weights[::step] = (1.0, -4.0, 6.0, -4.0, 1.0)
    differences = np.convolve(x, weights, "valid")
    return float(np.mean(differences * differences))


def rounding_noise(parts: list[Part], whitening: Array) -> float:
    """Variance (rad^2/s^4 | m^2/s^4) that the encoder's rounding leaves in the filtered acceleration.

    Of captures whose encoder is coarse, and as of an axis that moves by many steps a sample: of a slower one it is too
    much.  Source: B. Widrow, I. Kollar, Quantization Noise, Cambridge University Press 2008.
    """
    rounded = [p for p in parts if coarse(p)]
    total = sum(p.rows * _passed(p, whitening, 2) * resolution(p.capture) ** 2 / 12.0 for p in rounded)
    return total / sum(p.rows for p in parts)


def _passed(p: Part, whitening: Array, order: int = 0) -> float:
    """What a signal's white noise of variance 1 leaves in the rows of its derivative of this `order`."""
    spread = np.zeros((len(whitening) - 1) * p.places.step + 1)
    spread[:: p.places.step] = whitening
    weights = np.convolve(window(p.q, p.capture.dt, order), spread)
    return float(weights @ weights)
