"""Whether all frequencies of a record say the same: what they disagree by is in the intervals.

Each estimate is a sum over the rows, ``p + sum_k psi_k e_k``, of the residual e by the influence psi of its row.  In
bands of frequency that know equally much of p, the parts ``c_b`` of that sum are alike but for chance where the
residual is noise that the model describes.  A controller's answer to noise, rounding that is not white, or a current
that changes between the rows is in some bands and not in others: it moves the answer away from what the others say,
and no number of rows makes that smaller.  So no variance is below that of the bands,

    V = sum_b (c_b - m_b sum c)^2 / (1 - sum m_b^2)          m_b: the band's share of sum psi^2

Sources: band spectrum regression, R. F. Engle, International Economic Review 15(1), 1974; variances from the scores of
clusters, K.-Y. Liang, S. L. Zeger, Biometrika 73(1), 1986.
"""

from collections.abc import Sequence

import numpy as np

from stagectl.identification import thresholds
from stagectl.identification.capture import Array


def variance(influence: Array, residual: Array, expected: float, rows: Sequence[int]) -> float:
    """Variance of one parameter as the bands of its `influence` (n,) and the `residual` (n,) of its rows have it.

    `expected` is what noise adds to the sum by the model itself, of every frequency as much as the residual has of it;
    `rows` are those of each capture.
    """
    order = np.argsort(np.concatenate([np.fft.rfftfreq(count) for count in rows]), kind="stable")
    ends = np.cumsum(rows)[:-1]
    parts = zip(np.split(influence, ends), np.split(residual, ends), strict=True)
    known, power, products = np.concatenate([_spectra(*part) for part in parts], axis=1)[:, order]
    if not known.any():
        return 0.0
    share = known / known.sum()
    band = (thresholds.BANDS * (np.cumsum(share) - 0.5 * share)).astype(np.int64)
    sums = np.bincount(band, products + expected * power / power.sum())
    shares = np.bincount(band, share)
    freedom = 1.0 - float(shares @ shares)
    return float(np.sum((sums - shares * sums.sum()) ** 2)) / max(freedom, thresholds.LEAST_FREEDOM)


def _spectra(influence: Array, residual: Array) -> Array:
    """Powers of both and their product (3, k) at the frequencies of one capture; the sums are those over its rows."""
    first, second = np.fft.rfft(influence), np.fft.rfft(residual)
    both = np.full(len(first), 2.0 / len(influence))
    both[0] /= 2.0
    both[-1] /= 1.0 + (len(influence) % 2 == 0)
    return np.asarray(both * np.array([np.abs(first) ** 2, np.abs(second) ** 2, (first.conj() * second).real]))
