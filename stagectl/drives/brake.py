r"""A holding brake: the block `brake` of a stage file, and what its times mean.

::

    power   ____/~~~~~~~~~~~~~~~~~~~~~~~~~~~\____     torque before release, and after engagement
    brake   ========\_______________/===========     = holds
    motion  ____________/~~~~~~~\________________     release before motion
                    |<->|       |   |<--->|
                   release            engage

The brake is applied by springs: without current it holds.  It is no safety function: see `docs/faults.md`.
"""

from typing import Annotated, Literal, NamedTuple

from stagectl.kernels import stage
from stagectl.units import Quantity


class Brake(NamedTuple):
    """A brake that holds the axis where it has no power."""

    control: Annotated[
        Literal["none", "drive", "output"],
        "none: no brake; drive: the drive works it by itself; output: we do, by bit 0 of its digital outputs (0x60FE)",
    ] = "none"
    release: Annotated[float, Quantity("s", "[0, 5]", "from the order to release it to the first motion")] = 0.0
    engage: Annotated[float, Quantity("s", "[0, 5]", "from the order to engage it to the end of the torque")] = 0.0
    holding_current: Annotated[
        float | None,
        Quantity("A", "[-1e4, 1e4]", "current that carries the axis as the brake is released; absent: from the model"),
    ] = None

    @property
    def present(self) -> bool:
        """Whether there is one."""
        return self.control != "none"

    def holding(self, p: stage.Stage, measured: float) -> float:
        """Command (A) with which the brake is released where the encoder reads `measured` (rad | m): the whole load.

        So friction is left unloaded, and carries what the model does not know, to either side.  0 without a brake.
        """
        if not self.present:
            return 0.0
        given = self.holding_current
        return stage.released(p, measured) if given is None else stage.rounded(p.drive, given)

    def beyond(self, p: stage.Stage, measured: float) -> float | None:
        """What that is beyond the whole load (A): friction carries it, to the other side; None without a brake."""
        return self.holding(p, measured) - stage.released(p, measured) if self.present else None


NO_BRAKE = Brake()
