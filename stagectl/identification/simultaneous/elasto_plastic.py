"""The elasto-plastic law along a path: a bristle that only bends up to a share of its deflection, and then slips.

::

    dz/dt = v - alpha(z, v) |v| z / z_max(v)        alpha rises from 0 at `elastic` z_c to 1 at z_max

Source: P. Dupont, V. Hayward, B. Armstrong, F. Altpeter, IEEE Trans. Automatic Control 47(5), 2002.
"""

from __future__ import annotations

import math
from typing import Any

from stagectl.kernels.jit import kernel


@kernel
def _plastic_share(z: float, dx: float, first: float, last: float) -> float:
    """Share of a move that is slip: 0 up to the deflection `first`, 1 from `last` on."""
    if z * dx <= 0.0 or abs(z) <= first:
        return 0.0
    if abs(z) >= last:
        return 1.0
    return 0.5 + 0.5 * math.sin(math.pi * (abs(z) - 0.5 * (last + first)) / (last - first))


@kernel
def _deflected(z: float, dx: float, last: float, share: float) -> float:
    """Deflection after a move `dx` with the share of slip held: exact."""
    if share == 0.0:
        return z + dx
    end = math.copysign(last / share, dx)
    return end + (z - end) * math.exp(-abs(dx / end))


@kernel
def run(x: Any, dt: float, theta: Any, out: Any) -> None:
    """Fill `out` (n, 2): force of unit size, and rate of the deflection; the midpoint rule in the share of slip."""
    span, rise, speed, elastic = theta
    z = 0.0
    out[0, 0], out[0, 1] = 0.0, 0.0
    for k in range(1, len(x)):
        dx, before = x[k] - x[k - 1], z
        if dx != 0.0:
            last = span * (1.0 + rise * math.exp(-((dx / dt / speed) ** 2)))
            share = _plastic_share(z, dx, elastic * span, last)
            middle = _deflected(z, 0.5 * dx, last, share)
            z = _deflected(z, dx, last, _plastic_share(middle, dx, elastic * span, last))
        out[k, 0], out[k, 1] = z / span, (z - before) / dt
