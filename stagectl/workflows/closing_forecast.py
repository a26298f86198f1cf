"""What the simulation says beforehand that a new controller will leave of the tracking error.

::

    foretold error(t) = error on the machine with the old controller(t) + simulated(new - old controller)(t)

Both controllers are simulated on the new model.  What that model does not know, noise among it, is in the measured
error already: it acts through the same loop under either controller, so that it stays.  A simulation alone knows none
of it and foretells an error that no machine reaches.
"""

from __future__ import annotations

import numpy as np

from stagectl.workflows.closing_errors import AFTER, BEFORE, Errors
from stagectl.workflows.closing_shares import traces


def foretold(machine: Errors, simulated: Errors) -> dict[str, float]:
    """Tracking error (m | rad rms) before, as measured, and after, as foretold: geometric means over the motions."""
    each: dict[str, list[float]] = {BEFORE: [], AFTER: []}
    for name, motion in machine.items():
        old, new = (np.mean(traces(simulated[name][variant]["recordings"]), axis=0) for variant in (BEFORE, AFTER))
        measured = traces(motion[BEFORE]["recordings"])
        for variant, errors in ((BEFORE, measured), (AFTER, measured + (new - old))):
            each[variant].append(float(np.mean(errors**2)))
    return {variant: float(np.exp(0.5 * np.mean(np.log(squares)))) for variant, squares in each.items()}
