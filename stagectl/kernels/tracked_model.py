"""The stage model tied to a measured path: the further current with which it moves as the machine did.

::

    logged command --> drive model --> i ----(+)--> plant model --> position of the model
                                       |      ^                          |
    logged current ------------->(-)---+--> missing current              v
                                              ^                         (-)<-- logged position
                                              +---- correction <-- PID --+

The correction, times Kt, is the unexplained effort.  The model stays on the measured path, so every
friction force is that of the motion that was really made, and the unexplained effort enters almost linearly: two
candidates add up.  It is no open-loop replay, in which position would be a double integral of every error.  The
same estimator with the same delays runs over data and over every candidate, so its own bias cancels.

How closely the PID can hold the model depends on its rate, and a log may be slow: a period then has many ticks.

At rest, friction carries what acts on the axis.  Vibrations smaller than an encoder step work a bristle there, so that
its state at the end of a rest does not follow from the path: the current tells it.  At rest, therefore, the bristle
takes over what the correction has to hold, as far as it can.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from stagectl.kernels import feedback, friction_bristle, plant_with_effects, stage
from stagectl.kernels.jit import kernel
from stagectl.kernels.plant import Contact
from stagectl.kernels.transmission import sprung


class Tied(NamedTuple):
    """The model and what ties it."""

    stage: stage.Stage
    tracker: feedback.Pid  # A per rad | m: pulls the model onto the measured path


class State(NamedTuple):
    """Memory of the tied model."""

    plant: stage.State
    tracker: feedback.State


@kernel
def step(
    p: Tied, x: State, row: tuple[float, float, float], path: Any, dt: float, c: stage.Steps
) -> tuple[float, float, State]:
    """One period under `row`, along `path` (m,): positions of m ticks.

    `row` = (command A, current A; NaN: not measured, share of the correction that the bristle takes over: 0 in motion).
    It lasts `dt` (s), and a tick goes in the steps `c`.  Of a single tick the position is that which the encoder
    reports at its begin, of many that where the machine is.
    Returns the mean correction (A), the current that the drive gives (A), and the state at the end of the period.
    """
    command, current, share = row
    given = stage.reported(p.stage.drive, x.plant, dt)
    # Measured: a deviation of the drive from its model is not one of the mechanics.
    missing = current - given if current == current else 0.0
    plant, tracker, corrections, ticks = stage.commanded(p.stage.drive, x.plant, command), x.tracker, 0.0, len(path)
    for tick in range(ticks):
        reached = stage.measured(p.stage.encoder, plant, stage.SILENT) if ticks == 1 else stage.seen(p.stage, plant)
        terms, tracker = feedback.step(p.tracker, tracker, path[tick] - reached)
        correction = terms.proportional + terms.integral + terms.derivative
        plant = stage.stepped(p.stage, plant, stage.Noise(correction + missing, 0.0, 0.0), c)
        corrections += correction
    x = State(stage.latched(p.stage, plant), tracker)
    return corrections / ticks, given, x if share == 0.0 else _carried(p, x, share)


@kernel
def _carried(p: Tied, x: State, share: float) -> State:
    """`x` where the bristle carries a `share` of the tracker's integral term, as far as it holds."""
    bristle, constant = p.stage.friction.bristle, p.stage.motor.force_constant
    if bristle.coulomb == 0.0:
        return x
    plant, mechanics, held = x.plant, p.stage.mechanics, share * constant * x.tracker.integral
    after = friction_bristle.settled(bristle, bristle.stiffness * plant.bristle - held)
    moved = bristle.stiffness * (after - plant.bristle)
    memory, carried = plant.memory, moved
    if sprung(mechanics):  # the same at the load, unless it rests within a gap
        at_load, behind = mechanics.transmission.load_friction, memory.behind
        carried = (1.0 - at_load) * moved
        if abs(plant.position - memory.load) >= 0.5 * mechanics.transmission.backlash:
            settled = friction_bristle.settled(bristle, bristle.stiffness * behind.bristle - held)
            more = bristle.stiffness * (settled - behind.bristle)
            carried += at_load * more
            memory = plant_with_effects.rubbing(
                memory, Contact(behind.force + more, settled, behind.lagged, behind.rested)
            )
    tracker = feedback.State(x.tracker.error, x.tracker.integral + carried / constant, x.tracker.derivative)
    plant = stage.State(
        plant.commands, plant.latched, plant.current, plant.position, plant.velocity, plant.force + moved, plant.stops,
        after, memory,
    )  # fmt: skip
    return State(plant, tracker)


@kernel
def follow(p: Tied, x: State, inputs: Any, dt: float, substeps: int) -> State:
    """All periods of `inputs` = (rows (n, 3), as `step` has them; path (n, m); out (n, 2)).

    `out`: correction and model's current.

    `substeps` are those of a tick.  Fills `out`; returns the state at the end.
    """
    rows, path, out = inputs
    steps = stage.steps(p.stage, dt / path.shape[1], substeps)
    for k in range(len(rows)):
        out[k, 0], out[k, 1], x = step(p, x, (rows[k, 0], rows[k, 1], rows[k, 2]), path[k], dt, steps)
    return x
