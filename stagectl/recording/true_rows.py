"""Stretches of the rows of a record for which something holds."""

import numpy as np
from numpy.typing import NDArray


def stretches(rows: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end (beyond) of all stretches of true rows."""
    edges = np.flatnonzero(np.diff(rows.astype(np.int8), prepend=0, append=0))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
