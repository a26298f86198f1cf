"""What the noise of the current's sensor and the encoder's rounding leave in the rows of the regression."""

import numpy as np

from stagectl.identification import thresholds
from stagectl.identification.capture import Array
from stagectl.identification.simultaneous.regressors import Part, coarse, stepped
from stagectl.identification.simultaneous.windows import resolution, window


def current_noise(parts: list[Part], whitening: Array) -> float:
    """Variance (A^2) that a current sensor's white noise leaves in the filtered current, as fourth differences show it.

    `whitening` (p + 1,) are the weights of rows that the current has passed besides the window.  A commanded current
    has no such noise.  The controller's response to the encoder's rounding counts as such noise, too.
    """
    total = 0.0
    for p in parts:
        differences = np.diff(p.capture.current, 4)
        total += p.rows * _passed(p, whitening) * float(np.mean(differences * differences)) / 70.0
    return total / sum(p.rows for p in parts)


def rounding_noise(parts: list[Part], whitening: Array) -> float:
    """Variance (rad^2/s^4 | m^2/s^4) that the encoder's rounding leaves in the filtered acceleration.

    Of captures whose encoder is coarse, and as of an axis that moves by many steps a sample: of a slower one it is too
    much.  Source: B. Widrow, I. Kollar, Quantization Noise, Cambridge University Press 2008.
    """
    rounded = [p for p in parts if coarse(p)]
    total = sum(p.rows * _passed(p, whitening, 2) * resolution(p.capture) ** 2 / 12.0 * _moving(p) for p in rounded)
    return total / sum(p.rows for p in parts)


def _moving(p: Part) -> float:
    """Share of the samples of a stepped part on which rounding is noise: an axis at rest stays at one count."""
    if not stepped(p):
        return 1.0
    edges = np.flatnonzero(np.diff(p.capture.position))
    runs = np.diff(np.concatenate([[-1], edges, [len(p.capture.position) - 1]]))
    return float(np.minimum(runs, thresholds.ROUNDING_RUN).sum()) / len(p.capture.position)


def _passed(p: Part, whitening: Array, order: int = 0) -> float:
    """What a signal's white noise of variance 1 leaves in the rows of its derivative of this `order`."""
    spread = np.zeros((len(whitening) - 1) * p.places.step + 1)
    spread[:: p.places.step] = whitening
    weights = np.convolve(window(p.q, p.capture.dt, order), spread)
    return float(weights @ weights)
