"""Law and stage in closed loop: a whole run inside compiled code, row for row what the real loop records."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

from stagectl.kernels import law, stage
from stagectl.kernels.jit import kernel
from stagectl.units import Quantity


class Observed(NamedTuple):
    """Signals of the machine in one period, in addition to the law's terms."""

    measured: Annotated[float, Quantity("rad | m", "[-inf, inf]", "position reported by the encoder")]
    true_position: Annotated[float, Quantity("rad | m", "[-inf, inf]", "position of the model; NaN on a machine")]
    measured_current: Annotated[float, Quantity("A", "[-inf, inf]", "current reported by the drive")]
    lateness: Annotated[float, Quantity("s", "[-inf, inf]", "how late the period began; 0 in simulation")]
    late: Annotated[float, Quantity("", "[0, 1]", "1: the command left after the period had ended")]
    statusword: Annotated[float, Quantity("", "[0, 65535]", "CiA 402 statusword; 0 in simulation")]
    fault: Annotated[float, Quantity("", "[0, 255]", "reason to stop, see drives.drive.Fault")]


COLUMNS: tuple[str, ...] = ("time", *law.Setpoint._fields, *law.Output._fields, *Observed._fields)
WIDTH = len(COLUMNS)
SETPOINTS = len(law.Setpoint._fields)
_OUTPUT = 1 + SETPOINTS  # columns before the law's output
_OBSERVED = _OUTPUT + len(law.Output._fields)


class Loop(NamedTuple):
    """Both halves of a closed loop."""

    law: law.Law
    stage: stage.Stage


@kernel
def holding(plant: stage.State) -> law.State:
    """The law as it begins: it gives what holds a plant that stands, see `equilibrium.standing`."""
    if plant.velocity != 0.0 or plant.commands[0] == 0.0:
        return law.AT_REST
    return law.carrying(law.AT_REST, plant.commands[0])


@kernel
def closed_loop(p: Loop, plant: stage.State, inputs: Any, dt: float, substeps: int) -> stage.State:
    """Run all periods of `inputs` = (setpoints (n, 8), noise (n, 2 or 3), rows (n, WIDTH) to be filled).

    A plant at rest is held by the law, which has stood there before.
    Returns the plant at the end.  Position and current are latched at the start of each period, then the law
    runs, then the plant takes its command: with `delay_samples` = nd this is the order of the real cycle.
    """
    setpoints, noises, rows = inputs
    x, steps = holding(plant), stage.steps(p.stage, dt, substeps)
    for k in range(len(setpoints)):
        r = setpoints[k]
        setpoint = law.Setpoint(r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7])
        noise = stage.Noise(noises[k, 0], noises[k, 1], noises[k, 2] if noises.shape[1] > 2 else 0.0)
        measured = stage.measured(p.stage.encoder, plant, noise)
        output, x = law.step(p.law, x, setpoint, measured)
        rows[k, 0] = k * dt
        for j, wanted in enumerate(setpoint):
            rows[k, 1 + j] = wanted
        for j, term in enumerate(output):
            rows[k, _OUTPUT + j] = term
        rows[k, _OBSERVED] = measured
        rows[k, _OBSERVED + 1] = plant.position
        rows[k, _OBSERVED + 2] = stage.reported(p.stage.drive, plant, dt)
        plant = stage.period_of(p.stage, plant, output.current, noise, steps)
    return plant


@kernel
def carried(p: stage.Stage, x: stage.State, currents: Any, dt: float, substeps: int) -> tuple[float, float, float]:
    """Lowest and highest position (rad | m) and largest speed while `currents` (n,) A drive the stage in open loop."""
    low, high, speed, steps = x.position, x.position, abs(x.velocity), stage.steps(p, dt, substeps)
    for k in range(len(currents)):
        x = stage.period_of(p, x, currents[k], stage.SILENT, steps)
        low, high, speed = min(low, x.position), max(high, x.position), max(speed, abs(x.velocity))
    return low, high, speed


@kernel
def answers(p: law.Law, x: law.State, inputs: Any) -> law.State:
    """The law over `inputs` = (setpoints (n, 8), measured (n,), out (n, 7) to be filled with its output).

    Begins with the memory `x`; returns the memory at the end.  Compiled or interpreted it gives the bits of the loop.
    """
    setpoints, measured, out = inputs
    for k in range(len(setpoints)):
        r = setpoints[k]
        output, x = law.step(p, x, law.Setpoint(r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7]), measured[k])
        for j, term in enumerate(output):
            out[k, j] = term
    return x
