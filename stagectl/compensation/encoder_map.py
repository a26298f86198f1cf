"""The encoder's map: what it adds to the position is no force, so it goes into the target that it is compared with.

::

    reference --> true path, in the frame in which the errors of the encoder have mean zero
                  +--> feedforward, friction and effects
                  +--> target: what the encoder shows there

An axis that gets power stands at a reading, and nobody has asked yet by how much that is off; its reference begins
there.  During its first motion the difference goes, so that the axis comes to a position at the same place from
wherever it began.  At rest the target stays as it is, and the next motion goes on from it.
"""

import numpy as np
from numpy.typing import NDArray

from stagectl.kernels import plant_with_effects, stage

Array = NDArray[np.float64]


def mapped(p: stage.Stage) -> bool:
    """Whether the encoder's readings have errors that depend on the position."""
    return any(wave.amplitude != 0.0 for wave in p.encoder[2:])


def shown(p: stage.Stage, true: Array) -> Array:
    """What the encoder shows at `true` positions (n,) rad | m."""
    seen = (plant_with_effects.seen(p.encoder, p.mechanics.pitch, x) for x in true.tolist())
    return np.fromiter(seen, np.float64, len(true))
