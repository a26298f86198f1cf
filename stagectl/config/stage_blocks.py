"""The blocks of a stage file, from the mechanics to the bus, with unit, range and meaning of every entry."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, NamedTuple

from stagectl import design, learning
from stagectl.compensation.forms import FORMS, Compensators, Model
from stagectl.config.friction_laws import LAWS, Dahl, Lugre, Operators, Rolling
from stagectl.drives.brake import Brake
from stagectl.drives.drive import Canopen, Odrive, Simulation
from stagectl.drives.faults import BLOCKS
from stagectl.drives.homing import Homing
from stagectl.kernels import effects, plant, stage
from stagectl.kernels.effects import Harmonic
from stagectl.kernels.plant import Reported
from stagectl.number_format import Travel
from stagectl.units import LINEAR, ROTARY, Quantity, Tagged

_POSITIVE = "(0, 1e6]"


class Axis(NamedTuple):
    """The kind of axis: positions are angles of the motor, or lengths."""

    kind: Annotated[Literal["rotary", "linear"], "rotary, as is a ball screw with its lead, or linear"]
    lead: Annotated[float, Quantity("m", "[0, 10]", "table travel per revolution; 0: none")] = 0.0

    @property
    def travel_per_unit(self) -> float:
        """Metres of table per rad (ball screw), 1 on a linear axis; 1 without a lead, then travel is in rad."""
        return self.lead / (2.0 * math.pi) if self.kind == ROTARY and self.lead else 1.0

    @property
    def travel_unit(self) -> str:
        """Unit of what the user sees as travel."""
        return "m" if self.kind == LINEAR or self.lead else "rad"

    @property
    def travel(self) -> Travel:
        """How positions are shown."""
        return Travel(self.travel_per_unit, self.travel_unit, self.kind == ROTARY)


class Encoder(NamedTuple):
    """Position measurement; exactly one of `counts_per_revolution` and `step`."""

    counts_per_revolution: Annotated[int | None, Quantity("", "[1, 1e9]", "counts per revolution")] = None
    step: Annotated[float | None, Quantity("rad | m", "(0, 1]", "length or angle of one count")] = None
    delay_samples: Annotated[int, Quantity("", "[0, 7]", "control periods from latch to controller, nm")] = 0
    eccentricity: plant.Eccentricity = Harmonic()
    interpolation: plant.Interpolation = Harmonic()
    interpolation_second: plant.InterpolationSecond = Harmonic()

    @property
    def one_count(self) -> float:
        """Length or angle of one count (rad | m), whichever way it is given; 0 where it is not."""
        return self.step or (2.0 * math.pi / self.counts_per_revolution if self.counts_per_revolution else 0.0)


class InProcess(NamedTuple):
    """No wire: the stage model runs in the loop's own process."""


class Drive(NamedTuple):
    """The servo drive and how it is reached."""

    current_lag: Annotated[float, Quantity("s", "[0, 0.1]", "time constant of the current loop")]
    current_limit: Annotated[float, Quantity("A", "(0, 1e4]", "largest current of the drive and of the control law")]
    wire: Annotated[
        Canopen | Odrive | InProcess, Tagged("kind", {"canopen": Canopen, "odrive": Odrive, "simulated": InProcess})
    ]
    delay_samples: Annotated[int, Quantity("", "[0, 7]", "control periods between command and action, nd")] = 1
    dead_time: plant.DeadTime = 0.0
    jitter: plant.Jitter = 0.0
    offset: plant.CurrentOffset = 0.0
    continuous_current: plant.Continuous = math.inf
    foldback_time: plant.FoldbackTime = 1.0
    voltage_limit: plant.Voltage = math.inf
    resistance: plant.Resistance = 1.0
    back_emf: plant.BackEmf = 0.0
    telemetry: Reported = Reported()
    gain: plant.Gain = 0.0
    gain_asymmetry: plant.GainAsymmetry = 0.0
    directed_offset: plant.DirectedOffset = 0.0
    current_damping: plant.LoopDamping = math.inf


class Realtime(NamedTuple):
    """Scheduling of the loop's process; a request that the kernel refuses is reported."""

    priority: Annotated[int, Quantity("", "[0, 99]", "SCHED_FIFO priority; 0: ordinary scheduling")] = 80
    cpu: Annotated[int | None, Quantity("", "[0, 4095]", "number of the CPU the loop is pinned to")] = None
    late_limit: Annotated[int, Quantity("", "[1, 1000000]", "late cycles in a row that cause a quick stop")] = 10
    spin: Annotated[float, Quantity("s", "[0, 1e-3]", "time before each period in which the loop stays awake")] = 0.0


class VirtualDrive(NamedTuple):
    """Faults, mark and machine of a virtual drive; a real drive ignores this block."""

    faults: Annotated[
        tuple[Annotated[Any, Tagged("fault", BLOCKS)], ...], "what fails, counted from Operation enabled on"
    ] = ()
    mark: Annotated[
        float, Quantity("rad | m", "[-1e6, 1e6]", "reference mark of its homing, from where it is powered on")
    ] = 0.0
    machine_of_the_day: Annotated[
        int, Quantity("", "[0, 2147483647]", "seed of a machine drawn around the model; 0: the model itself")
    ] = 0


class Limits(NamedTuple):
    """Limits that no trajectory and no motion may exceed."""

    travel: Annotated[tuple[float, float], Quantity("rad | m", "[-1e6, 1e6]", "lowest and highest position")]
    speed: Annotated[float, Quantity("rad/s | m/s", _POSITIVE, "largest speed")]
    acceleration: Annotated[float, Quantity("rad/s^2 | m/s^2", _POSITIVE, "largest acceleration")]
    following_error: Annotated[float, Quantity("rad | m", _POSITIVE, "largest error before a quick stop")]
    following_error_at_rest: Annotated[
        float | None, Quantity("rad | m", _POSITIVE, "the same at standstill; it rises linearly up to limits.speed")
    ] = None
    following_error_time: Annotated[
        float, Quantity("s", "[0, 10]", "time for which it may be exceeded; twice the limit stops at once")
    ] = 0.0
    deceleration: Annotated[
        float | None,
        Quantity("rad/s^2 | m/s^2", _POSITIVE, "deceleration with which the axis can brake; absent: from the model"),
    ] = None
    current: Annotated[
        float | None, Quantity("A", "(0, 1e4]", "largest measured current; absent: 1.5 times drive.current_limit")
    ] = None
    current_deviation: Annotated[
        float | None,
        Quantity(
            "A",
            "(0, 1e4]",
            "largest difference of measured and commanded current in addition to 10 %; absent: 5 % of current_limit",
        ),
    ] = None
    continuous_current: Annotated[float | None, Quantity("A", "(0, 1e4]", "current that may flow forever (I2t)")] = None
    thermal_time: Annotated[float, Quantity("s", "(0, 1e4]", "time constant of the motor's warming (I2t)")] = 10.0
    encoder_jump: Annotated[
        float | None,
        Quantity("rad | m", _POSITIVE, "change that no motion explains; absent: a quarter of following_error"),
    ] = None
    encoder_freeze: Annotated[
        float | None, Quantity("rad | m", _POSITIVE, "motion without a new count; absent: half of following_error")
    ] = None
    free_distance: Annotated[
        float | None,
        Quantity(
            "rad | m",
            _POSITIVE,
            "room beyond either end of travel, which no time-out may exceed; absent: a tenth of travel or less",
        ),
    ] = None


class Residual(NamedTuple):
    """An effort that opposes the motor, as a table over one coordinate: linear between values, constant beyond."""

    coordinate: Annotated[effects.Coordinate, "quantity over which the table is given"]
    start: Annotated[float, Quantity("", "[-1e9, 1e9]", "coordinate of the first value, in its SI unit")]
    step: Annotated[float, Quantity("", "(0, 1e9]", "distance between values, in the coordinate's SI unit")]
    values: Annotated[tuple[float, ...], Quantity("N m | N", "[-1e6, 1e6]", "effort")]


class Retention(NamedTuple):
    """What a service keeps of an axis' recordings and black boxes; without an entry it removes none."""

    keep_days: Annotated[float, Quantity("", "(0, inf]", "days after which a file is removed; inf: never")] = math.inf
    keep_gib: Annotated[float, Quantity("", "(0, inf]", "GiB in all, beyond which the oldest go; inf: all stay")] = (
        math.inf
    )


class StageFile(NamedTuple):
    """The whole file."""

    name: Annotated[str, "name of the machine"]
    axis: Axis
    motor: stage.Motor
    mechanics: stage.Mechanics
    friction: Annotated[Rolling | Operators | Dahl | Lugre, Tagged("law", LAWS)]
    encoder: Encoder
    drive: Drive
    control: Annotated[
        design.Settings, Tagged("law", {"pid": design.Control, "cascade": design.CascadeControl}, default="pid")
    ]
    limits: Limits
    homing: Homing = Homing()
    brake: Brake = Brake()
    compensation: Annotated[Any, Tagged("form", FORMS)] = Model()
    compensators: Compensators = Compensators()
    realtime: Realtime = Realtime()
    simulation: Simulation = Simulation()
    learning: learning.LearningSettings = learning.LearningSettings()
    residual: Residual | None = None
    virtual_drive: VirtualDrive = VirtualDrive()
    recordings: Retention = Retention()

    def with_wire(self, **entries: Any) -> StageFile:
        """The same with other entries of its wire."""
        return self._replace(drive=self.drive._replace(wire=self.drive.wire._replace(**entries)))

    @property
    def own_ramp(self) -> float:
        """Deceleration (rad/s^2 | m/s^2) of the drive's own stop; that of the limits where it has none."""
        wire = self.drive.wire
        return wire.quick_stop_deceleration if isinstance(wire, Canopen) else self.limits.acceleration

    @property
    def in_memory(self) -> bool:
        """Whether the plant is a program on this computer: nothing real can be moved."""
        wire = self.drive.wire
        return isinstance(wire, InProcess) or (isinstance(wire, Canopen) and wire.interface == "embedded")
