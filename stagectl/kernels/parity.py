"""Cut A, row by row: what the law must have answered to what was logged."""

from __future__ import annotations

from typing import Any

from stagectl.kernels import law
from stagectl.kernels.jit import kernel


@kernel
def answers(p: law.Law, x: law.State, inputs: Any) -> law.State:
    """The law over all periods of `inputs` = (rows (n, 9): setpoint and measured position; out (n,): current A).

    Fills `out`; returns the law's memory at the end.  Compiled or interpreted it gives the bits of the loop.
    """
    rows, out = inputs
    for k in range(len(rows)):
        r = rows[k]
        setpoint = law.Setpoint(r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7])
        output, x = law.step(p, x, setpoint, r[8])
        out[k] = output.current
    return x
