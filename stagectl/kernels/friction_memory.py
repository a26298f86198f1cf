"""Friction as a function of the displacement since the last reversal: the data-based table, and the rheology model.

Both follow one branch from reversal to reversal, with Masing's half curve for the start from rest, and forget all
reversals but the last: a small loop inside a large one leaves a trace, where stop operators leave none.  A table that
is looked up and no more even jumps to +-T_c at a partial reversal, and so gives out energy on small loops; one that
continues begins where the force is, as the rheology model does.  Both are for compensation, and no plant has them.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

from stagectl.kernels.constants import EXPONENT_OF_TWO
from stagectl.kernels.jit import kernel
from stagectl.units import Quantity


class Table(NamedTuple):
    """Force over displacement since reversal (the data-based model of Simultaneous Identification ..., section V)."""

    displacement: Any  # (m,) rad | m, from 0 up
    force: Any  # (m,) N m | N, from -T_c to T_c
    continues: bool = False  # from the force at the reversal; False: from -T_c, as the table is looked up


class Branch(NamedTuple):
    """Where on its branch a law of displacement since reversal is."""

    travelled: float  # rad | m, since the reversal, or since rest
    direction: float  # -1, 0 before any motion, or 1
    virgin: float  # 1.0 until the first reversal: the half curve
    origin: float  # N m | N, force at the reversal
    force: float  # N m | N


class Rheology(NamedTuple):
    """A nonlinear spring with hysteresis, and next to it a spring and a dashpot in series, which creep.

    From a reversal at the force F_0, with ``xi = s / range`` up to 1 and never beyond +-T_c::

        F = F_0 + sgn(v) 2 T_c g(xi) + F_m              dF_m/dt = k v - F_m / tau
        g(xi) = (xi^(n-1) - (n-1) xi) / (2 - n),   n != 2;         xi (1 - ln xi),   n = 2

    **Reconstruction.**  Y. Maeda, M. Iwasaki, IECON 2010 (reference [2] of the ball-screw paper) describe a nonlinear
    spring over the displacement since reversal, called rheology-based for its elastic, plastic and viscous elements.
    Their text is not public.  Here g is the family of curves after T. Koizumi, H. Shibazaki, Wear 93, 1984, for n = 2
    the well-known ``xi (1 - ln xi)``; the branch rule and the one relaxing element are our reading.
    """

    coulomb: Annotated[float, Quantity("N m | N", "[0, 1e6]", "friction beyond the range, T_c")]
    range: Annotated[float, Quantity("rad | m", "(0, 1e3]", "displacement since a full reversal at which it slips")]
    exponent: Annotated[float, Quantity("", "(1, 6]", "n, the shape of the spring; large is soft")] = 2.0
    stiffness: Annotated[float, Quantity("N m/rad | N/m", "[0, 1e15]", "of the creeping spring, k; 0 is neutral")] = 0.0
    relaxation: Annotated[float, Quantity("s", "(0, 1e3]", "time constant of the creep, tau")] = 1.0


class Creep(NamedTuple):
    """Memory of the rheology model."""

    branch: Branch
    relaxing: float  # N m | N, F_m


BRANCH = Branch(0.0, 0.0, 1.0, 0.0, 0.0)
CREEP = Creep(BRANCH, 0.0)


@kernel
def table(p: Table, x: Branch, dx: float) -> tuple[float, Branch]:
    """Force of the table after a move of `dx`; a stop, and going on in the same direction, changes nothing."""
    x = moved(x, dx)
    if x.direction == 0.0:
        return 0.0, x
    if x.virgin == 1.0:
        force = 0.5 * x.direction * (_interpolated(p, 2.0 * x.travelled) - p.force[0])
    elif p.continues:
        reached = x.origin + x.direction * (_interpolated(p, x.travelled) - p.force[0])
        force = min(max(reached, p.force[0]), -p.force[0])
    else:
        force = x.direction * _interpolated(p, x.travelled)
    return force, Branch(x.travelled, x.direction, x.virgin, x.origin, force)


@kernel
def rheology(p: Rheology, x: Creep, v: float, dx: float, dt: float) -> tuple[float, Creep]:
    """Force after a move of `dx` at velocity `v` during `dt`; exact in the creep while v is held."""
    branch = moved(x.branch, dx)
    scale = 1.0 if branch.virgin == 1.0 else 2.0
    reached = branch.origin + branch.direction * scale * p.coulomb * _spring(
        p.exponent, 2.0 * branch.travelled / (scale * p.range)
    )
    force = min(max(reached, -p.coulomb), p.coulomb)
    branch = Branch(branch.travelled, branch.direction, branch.virgin, branch.origin, force)
    decay = math.exp(-dt / p.relaxation)
    relaxing = x.relaxing * decay + p.stiffness * v * p.relaxation * (1.0 - decay)
    return force + relaxing, Creep(branch, relaxing)


@kernel
def moved(x: Branch, dx: float) -> Branch:
    """The branch after a move of `dx`: further on, or a new one."""
    if dx == 0.0:
        return x
    direction = 1.0 if dx > 0.0 else -1.0
    if direction == x.direction:
        return Branch(x.travelled + abs(dx), direction, x.virgin, x.origin, x.force)
    virgin = 1.0 if x.direction == 0.0 else 0.0
    return Branch(abs(dx), direction, virgin, x.force, x.force)


@kernel
def _spring(exponent: float, xi: float) -> float:
    """``g(xi)`` of the rheology model: 0 at 0, 1 with slope 0 from 1 on."""
    if xi <= 0.0:
        return 0.0
    if xi >= 1.0:
        return 1.0
    if abs(exponent - 2.0) < EXPONENT_OF_TWO:
        return xi * (1.0 - math.log(xi))
    return float((xi ** (exponent - 1.0) - (exponent - 1.0) * xi) / (2.0 - exponent))


@kernel
def _interpolated(p: Table, s: float) -> float:
    """The table at `s`, straight between its rows, its last force beyond them."""
    last = len(p.displacement) - 1
    if s >= p.displacement[last]:
        return float(p.force[last])
    j = 0
    while p.displacement[j + 1] <= s:
        j += 1
    share = (s - p.displacement[j]) / (p.displacement[j + 1] - p.displacement[j])
    return float(p.force[j] + share * (p.force[j + 1] - p.force[j]))
