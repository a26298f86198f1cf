"""A whole run in closed loop, faster than real time: the same law, the same rows as on a machine."""

import contextlib
from collections.abc import Callable
from typing import Any, SupportsFloat

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.drives.drive import Simulation
from stagectl.drives.simulated import draw
from stagectl.kernels import friction, law, plant_with_effects, rollout, stage, transmission
from stagectl.kernels.jit import interpret_first, interprets
from stagectl.kernels.law import Law
from stagectl.plan import Plan
from stagectl.units import StageError

# (velocity in rad/s | m/s, position in rad | m, step in s) -> force in N m | N, positive against positive velocity.
# It is called once for each integration step, in the order of time, so that an object can keep a memory.
FrictionLaw = Callable[[float, float, float], float]


def simulate(setup: Setup, plan: Plan, running: Law, plant: Setup | None = None, start: float = 0.0) -> NDArray[Any]:
    """Rows (n,) of the run, structured as in a recording; `plant` is the machine where it is not the model.

    It starts at `start` (s) on the session's clock, on which the machine warms up.
    """
    machine = plant or setup
    count = len(plan.setpoints)
    rows = np.zeros((count, rollout.WIDTH))
    loop = rollout.Loop(running, machine.stage)
    inputs = (plan.setpoints, noise(machine.file.simulation, count, machine.stage.drive.jitter), rows)
    plant_state = stage.at_reading(machine.stage, 0.0, start, setup.file.brake.holding(setup.stage, 0.0))
    _run(loop, plant_state, inputs, (setup.dt, machine.file.simulation.substeps))
    return structured(rows)


def _run(loop: rollout.Loop, plant: stage.State, inputs: tuple[Any, Any, Any], steps: tuple[float, int]) -> None:
    """Fill the rows: compiled, or interpreted where that is sooner done (see `kernels.jit`)."""
    if interprets(inputs):
        # What Python raises is infinity in compiled code: a loop that diverges is run again there.
        with contextlib.suppress(ArithmeticError, ValueError):
            setpoints, noises, rows = inputs
            rollout.closed_loop(_listed(loop), _listed(plant), (setpoints.tolist(), noises, rows), *steps)
            return
        interpret_first(0)
    rollout.closed_loop(loop, plant, inputs, *steps)


def _listed(block: Any) -> Any:
    """A parameter block whose arrays are lists: an interpreted kernel is slow with numpy's scalars."""
    if isinstance(block, np.ndarray):
        return block.tolist()
    return type(block)(*map(_listed, block)) if hasattr(block, "_fields") else block


def noise(p: Simulation, count: int, jitter: float = 0.0) -> NDArray[np.float64]:
    """(n, 3) of current (A), position (rad | m) and dead time (s), drawn as the virtual drive draws it."""
    if p.current_noise == 0.0 and p.encoder_noise == 0.0 and jitter == 0.0:
        return np.zeros((count, 3))
    return np.array(draw(p, count, jitter))


def structured(rows: NDArray[np.float64]) -> NDArray[Any]:
    """(n, width) as (n,) rows with named columns, without a copy."""
    return rows.view(np.dtype([(name, "<f8") for name in rollout.COLUMNS]))[:, 0]


class Work:
    """The work (J) of a friction law: what it took from the axis, and what it gave back."""

    def __init__(self) -> None:
        self.taken = self.given = 0.0

    def add(self, work: float) -> None:
        """Of one integration step, positive where it was taken."""
        self.taken += max(work, 0.0)
        self.given += max(-work, 0.0)


def simulate_with_friction(
    setup: Setup, plan: Plan, running: Law, friction_law: FrictionLaw, plant: Setup | None = None
) -> tuple[NDArray[Any], Work]:
    """Rows (n,) of the run, as `simulate` gives them, with `friction_law` in place of the plant's friction; its work.

    The loop is interpreted, some hundred times slower than `simulate`.  The force is held over one integration step
    (``simulation.substeps`` a period), so a stiff law needs short steps: ``stiffness h^2 << inertia``.

    Raises StageError for a plant that is more than one inertia with viscous friction and an even motor, and for a force
    that is not finite.
    """
    machine = plant or setup
    p = _without_friction(machine)
    noises = noise(machine.file.simulation, len(plan.setpoints), p.drive.jitter)
    rows = np.zeros((len(plan.setpoints), rollout.WIDTH))
    x, work = stage.at_reading(p, 0.0, held=setup.file.brake.holding(setup.stage, 0.0)), Work()
    memory = rollout.holding(x)
    applied = (friction_law, work)
    for k, (setpoint, drawn) in enumerate(zip(plan.setpoints.tolist(), noises.tolist(), strict=True)):
        disturbed = stage.Noise(drawn[0], drawn[1], drawn[2] if len(drawn) > 2 else 0.0)
        measured = stage.measured(p.encoder, x, disturbed)
        output, memory = law.step(running, memory, law.Setpoint(*setpoint), measured)
        seen = (measured, x.position, stage.reported(p.drive, x, setup.dt), 0.0, 0.0, 0.0, 0.0)
        rows[k] = (k * setup.dt, *setpoint, *output, *seen)
        x = stage.commanded(p.drive, x, output.current)
        x = stage.latched(p, _moved(p, x, disturbed, applied, (setup.dt, machine.file.simulation.substeps)))
    return structured(rows), work


def _without_friction(machine: Setup) -> stage.Stage:
    """The plant with stop operators of no weight and no other friction."""
    p = machine.stage
    if not (plant_with_effects.smooth(p.motor) and transmission.neutral(p.mechanics)):
        raise StageError(
            f"a friction law of your own acts on one inertia with viscous friction and an even motor; {machine.path} "
            "has more effects in `motor` or `mechanics`: remove them from the plant"
        )
    slips = list(p.friction.operators.slip)
    none = friction.bundle([0.0] * len(slips), slips)
    return p._replace(friction=stage.Friction(none, friction.Stribeck()))


def _moved(
    p: stage.Stage, x: stage.State, noise: stage.Noise, applied: tuple[FrictionLaw, Work], steps: tuple[float, int]
) -> stage.State:
    """The plant one period later; the friction acts as the motor current that gives the same force."""
    (friction_law, work), (dt, count) = applied, steps
    step = dt / count
    for _ in range(count):
        force = friction_law(x.velocity, x.position + 0.5 * step * x.velocity, step)
        if np.ndim(force) or not isinstance(force, SupportsFloat) or not np.isfinite(float(force)):
            raise StageError(
                f"the friction law gives {force} at a velocity of {x.velocity:g} and a position of {x.position:g} "
                "(SI, axis units); it must return a finite force"
            )
        against = noise.current - float(force) / p.motor.force_constant
        before = x.position
        x = stage.drifted(p, x, stage.Noise(against, noise.position, noise.delay), step, 1)
        work.add(float(force) * (x.position - before))
    return x
