"""Compensators of rolling friction with a memory of the way: the ball-screw paper's table, GMS and rheology models.

Each runs its law along the reference, from rest, half a period ahead of the command; nothing is left for the cycle::

    table       F = way T(s), s since the last reversal, straight between the rows, T_c beyond the last
    gms         stop operators that slip at weight_j (1 + rise exp(-(|v| / velocity)^shape))
    rheology    a nonlinear spring from each reversal on, held at +-T_c, and a creeping spring next to it

What a reversal inside the rolling zone does (an inner loop) tells them apart::

    table       ``restart`` looks the table up and no more, which is all that the paper says: it begins at -T_c, so the
                force jumps by what was missing to T_c.  On motions smaller than the last row that can make the error
                larger than without compensation.  ``continue`` begins at the force that was reached, within +-T_c
    rheology    continues in the same way; both forget the loop around the inner one
    gms         continues, and joins the outer loop again where the inner one closes (Masing's rules)

Where reversals are further apart than the last row, both rules of the table are the same to the last bit.

Source: Simultaneous Identification ..., section V (table, after its reference [5]) and section I (GMS [1], rheology
[2]); the laws themselves are in `kernels.friction` and `kernels.friction_memory`.
"""

from typing import Annotated, Literal, NamedTuple

import numpy as np

from stagectl.compensation.legs import Array, Legs
from stagectl.kernels import friction, friction_memory, friction_path
from stagectl.kernels.jit import table
from stagectl.units import Quantity


class ReversalTable(NamedTuple):
    """Friction over the displacement since the last reversal, as it was measured: the paper's data-based model.

    A start from rest follows half the curve, at twice the displacement; a stop without a reversal changes nothing.
    """

    displacement: Annotated[
        tuple[float, ...], Quantity("rad | m", "[0, 1e3]", "since the last reversal; the first is 0, and they rise")
    ]
    force: Annotated[
        tuple[float, ...], Quantity("N m | N", "[-1e6, 1e6]", "friction there; from -T_c to T_c, and never falling")
    ]
    inner_loops: Annotated[
        Literal["continue", "restart"],
        "at a reversal before the last row: continue from the force, or restart at -T_c, as the paper's table",
    ] = "continue"

    def along(self, cut: Legs) -> Array:
        """Friction (n,) N m | N along legs that are known."""
        out = np.empty(len(cut.leg) + 1)
        p = friction_memory.Table(table(self.displacement), table(self.force), self.inner_loops == "continue")
        friction_path.table(p, cut.path, out)
        return out[1:]


class GeneralisedMaxwell(NamedTuple):
    """Stop operators whose slip forces follow Stribeck's curve: the generalised Maxwell-slip (GMS) model."""

    weight: Annotated[tuple[float, ...], Quantity("N m | N", "[0, 1e6]", "force at which each element slips")]
    slip: Annotated[tuple[float, ...], Quantity("rad | m", "(0, 1e3]", "displacement at which each element slips")]
    stribeck: friction.Stribeck = friction.Stribeck()

    def along(self, cut: Legs) -> Array:
        """Friction (n,) N m | N along legs that are known."""
        p = friction.Gms(friction.bundle(self.weight, self.slip), self.stribeck)
        out = np.empty(len(cut.leg) + 1)
        friction_path.gms(p, friction.relaxed(p.operators), cut.path, cut.period, out)
        return out[1:]


class RheologySpring(friction_memory.Rheology):
    """A nonlinear spring from each reversal on, and a creeping one: the rheology model, as reconstructed here."""

    __slots__ = ()

    def along(self, cut: Legs) -> Array:
        """Friction (n,) N m | N along legs that are known."""
        out = np.empty((len(cut.leg) + 1, 2))
        friction_path.rheology(friction_memory.Rheology(*self), cut.path, cut.period, out)
        return np.asarray(out[1:, 0] + out[1:, 1])


FORMS: dict[str, type[ReversalTable | GeneralisedMaxwell | RheologySpring]] = {
    "table": ReversalTable,
    "gms": GeneralisedMaxwell,
    "rheology": RheologySpring,
}
