"""A function of one coordinate with free amplitudes beside every fit: what is missing that no effect of the library is.

It is a nuisance like the friction's form.  Its amplitudes are integrated out where sets are compared, and projected out
where values are refined (variable projection).  What it may explain is no effect's.

Source: G. H. Golub, V. Pereyra, SIAM Journal on Numerical Analysis 10(2), 1973.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import compress
from typing import NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices
from stagectl.gap.residuals.gram_matrices import Columns, Products
from stagectl.gap.selection.evidence import Prior


class FreeFunction(NamedTuple):
    """The columns of a function of one coordinate, and what is known of their amplitudes."""

    columns: Columns  # of each run
    products: Products  # of these columns alone
    deviation: float  # N m | N, of each amplitude before the data
    power: float  # of the likelihood

    @property
    def names(self) -> tuple[str, ...]:
        """Of the columns."""
        return self.products.names

    def prior(self, places: Callable[[Sequence[str]], list[int]]) -> Prior:
        """What is known of the amplitudes, whose columns stand at `places`."""
        count = len(self.names)
        return Prior(tuple(places(self.names)), np.zeros(count), np.full(count, self.deviation))

    def on(self, chosen: Array) -> FreeFunction:
        """The same on the `chosen` runs alone."""
        parts = tuple(compress(self.products.parts, chosen))
        return self._replace(columns=list(compress(self.columns, chosen)), products=self.products._replace(parts=parts))

    def explained(self, residuals: Sequence[Sequence[Array]]) -> float:
        """What it takes of the sum of squares of `residuals` (m, 2) of each run and repeat."""
        g = gram_matrices.fold_sums(self.products, residuals).both.sum(axis=0)
        known = g[:-1, :-1] + np.eye(len(self.names)) / (self.power * self.deviation**2)
        return float(g[:-1, -1] @ np.linalg.solve(known, g[:-1, -1]))
