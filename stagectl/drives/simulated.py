"""The stage model behind the drive protocol, in process; and the plant that the virtual node carries."""

import math
import random

from stagectl.drives.drive import Fault, Feedback, Power, Simulation
from stagectl.kernels import stage

OPERATION_ENABLED, SWITCHED_ON = 0x0027, 0x0023


def draw(p: Simulation, periods: int, jitter: float = 0.0) -> list[stage.Noise]:
    """The noise of `periods` control periods: the same sequence wherever the same seed is simulated."""
    source = random.Random(p.seed)
    return [drawn(source, p, jitter) for _ in range(periods)]


def drawn(source: random.Random, p: Simulation, jitter: float) -> stage.Noise:
    """One period's noise; a `jitter` (s) of 0 draws nothing, so that the sequence is that of a plant without one."""
    current, position = source.gauss(0.0, p.current_noise), source.gauss(0.0, p.encoder_noise)
    return stage.Noise(current, position, source.gauss(0.0, jitter) if jitter > 0.0 else 0.0)


class Plant:
    """A stage and its state: the mutable shell around the pure kernel."""

    def __init__(self, p: stage.Stage, simulation: Simulation, dt: float, holding: float = 0.0) -> None:
        """Its friction carries what the command `holding` (A), with which its brake is released, does not."""
        self.p, self.simulation, self.dt, self.holding = p, simulation, dt, holding
        self.restart()

    def restart(self) -> None:
        """At rest where the encoder reads 0, cold, without power, the noise from its beginning."""
        held = stage.at_reading(self.p, 0.0, held=self.holding)
        self.state = held._replace(commands=stage.NO_COMMANDS, current=self.p.drive.offset)
        self._random = random.Random(self.simulation.seed)
        self._powered = False
        self._noise, self._silent, self._cold = stage.SILENT, True, True

    def compile(self) -> None:
        """Compile every kernel of a period, and restart: a controller does not wait for it in a motion."""
        self.powered = True
        self.advance(0.0)
        _ = self.position, self.current
        self.restart()

    @property
    def powered(self) -> bool:
        """Whether current can flow; without power the delay line is empty, too."""
        return self._powered

    @powered.setter
    def powered(self, on: bool) -> None:
        self._powered = on
        self._noise, self._silent = stage.SILENT, True
        if not on:
            self.state = self.state._replace(commands=stage.NO_COMMANDS)

    def advance(self, command: float) -> None:
        """One control period under `command` (A)."""
        self.command(command)
        self.drift(self.dt)
        self.latch()

    def command(self, command: float) -> None:
        """Hand over the command (A) of the period that begins now."""
        self.state = stage.commanded(self.p.drive, self.state, command * self._powered)

    def drift(self, seconds: float) -> None:
        """Let time go on; a whole period in exactly `substeps` steps, any other time in steps no longer."""
        substeps = max(1, math.ceil(seconds / self.dt * self.simulation.substeps - 1e-6))
        self.state = stage.drifted(self.p, self.state, self._current_noise(), seconds, substeps)

    def arrest(self, seconds: float) -> None:
        """Let time go on while a brake holds the axis: the current alone changes, under the command that acts."""
        before = stage.copied(self.state)
        self.drift(seconds)
        after, now = self.state, self.state.memory
        memory = before.memory._replace(time=now.time, acting=now.acting, heat=now.heat, rate=now.rate)
        self.state = before._replace(current=after.current, velocity=0.0, memory=memory)

    def latch(self) -> None:
        """The end of a period: its position enters the measurement's delay line, new noise is drawn."""
        self.state = stage.latched(self.p, self.state)
        if self._powered and not self._silent:
            self._noise = self._draw()
        self._silent = False

    def hear(self) -> None:
        """Switch the measurement noise on: enabling reads the position without it."""
        self._noise, self._silent = self._draw(), False

    @property
    def position(self) -> float:
        """Measured position (rad | m)."""
        return stage.measured(self.p.encoder, self.state, self._current_noise())

    @property
    def current(self) -> float:
        """Motor current as the drive reports it (A)."""
        return stage.reported(self.p.drive, self.state, self.dt)

    @property
    def position_counts(self) -> int:
        """Measured position in encoder counts."""
        return round(self.position / self.p.encoder.step)

    def _current_noise(self) -> stage.Noise:
        return self._noise if self._powered else stage.SILENT

    def _draw(self) -> stage.Noise:
        if self._cold:  # with power a machine begins to warm, and its contacts to age, as in `simulate`
            self._cold = False
            self.state = self.state._replace(memory=self.state.memory._replace(time=0.0, rested=0.0))
        return drawn(self._random, self.simulation, self.p.drive.jitter)


class Simulated:
    """A drive whose stage is in this process and whose time advances by one period per `apply`."""

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self._begins = False  # power has come, and nobody has read yet where the axis stands

    def sample(self) -> Feedback:
        """Measured position and motor current now; after power on the first one is silent, as in `simulate`."""
        statusword, fault = (OPERATION_ENABLED, Fault.NONE) if self.plant.powered else (SWITCHED_ON, Fault.DRIVE_FAULT)
        now = Feedback(self.plant.position, self.plant.current, statusword, fault)
        if self._begins:
            self._begins = False
            self.plant.hear()
        return now

    def apply(self, current: float) -> None:
        """Hold `current` for one period; the model's own delay line adds nd periods."""
        self.plant.advance(current)

    def ask(self, power: Power) -> None:
        """Power the stage, or cut it: it has no ramp of its own, friction stops it."""
        if power is not Power.ENGAGE:
            self.plant.powered = self._begins = power is Power.ON

    def position(self) -> float:
        """Where the axis stands (rad | m)."""
        return self.plant.position

    def pending_fault(self) -> str:
        """A simulated drive has none."""
        return ""

    def reset_fault(self) -> None:
        """There is nothing to reset."""

    def describe(self) -> dict[str, str]:
        """What it is, for the recording."""
        return {"drive": "simulated in process", "substeps": str(self.plant.simulation.substeps)}

    def explain(self) -> str:
        """A simulated drive has no faults of its own."""
        return "the simulated drive reports no fault"

    def close(self) -> None:
        """Cut the power."""
        self.plant.powered = False
