"""The stage file: one machine, from its mechanics to its bus, and what is checked before anything moves."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import yaml

from stagectl import design, learning
from stagectl.compensation.forms import FORMS, Model
from stagectl.config.effects_file import Residual, effects_that_cannot_be, table_of
from stagectl.config.friction_laws import LAWS, Dahl, Lugre, Operators, Rolling, friction_of
from stagectl.config.homing import Homing
from stagectl.config.limits import Limits
from stagectl.config.loader import ConfigError, Lengths, Reader, Tagged
from stagectl.config.machine_file import load_axis
from stagectl.config.source import node_at
from stagectl.drives import odrive
from stagectl.drives.bus import frames, slcan
from stagectl.drives.drive import Canopen, Odrive
from stagectl.drives.faults import BLOCKS
from stagectl.drives.simulated import Simulation
from stagectl.kernels import plant, stage
from stagectl.kernels.effects import Harmonic
from stagectl.kernels.plant import Reported
from stagectl.units import LINEAR, ROTARY, Quantity

OWN = Path(__file__).parents[2] / "config"  # of the checkout
WIDEST = 1e6  # of the slips of a friction's elements
OBJECTS = range(0x1000_00, 0x1_0000_00)  # index_subindex; below are the data types of CiA 301


class Axis(NamedTuple):
    """What a position is: an angle at the motor, or a length."""

    kind: Annotated[Literal["rotary", "linear"], "rotary (a ball screw is: it has a lead) or linear"]
    lead: Annotated[float, Quantity("m", "[0, 10]", "table travel per revolution; 0: none")] = 0.0

    @property
    def travel_per_unit(self) -> float:
        """Metres of table per rad (ball screw), 1 on a linear axis; 1 without a lead, then travel is in rad."""
        return self.lead / (2.0 * math.pi) if self.kind == ROTARY and self.lead else 1.0

    @property
    def travel_unit(self) -> str:
        """Unit of what the user sees as travel."""
        return "m" if self.kind == LINEAR or self.lead else "rad"


class Encoder(NamedTuple):
    """Position measurement; exactly one of `counts_per_revolution` and `step`."""

    counts_per_revolution: Annotated[int | None, Quantity("", "[1, 1e9]", "counts per revolution")] = None
    step: Annotated[float | None, Quantity("rad | m", "(0, 1]", "length or angle of one count")] = None
    delay_samples: Annotated[int, Quantity("", "[0, 7]", "control periods from latch to controller, nm")] = 0
    eccentricity: plant.Eccentricity = Harmonic()
    interpolation: plant.Interpolation = Harmonic()


class InProcess(NamedTuple):
    """No wire: the stage model runs in the loop's own process."""


class Drive(NamedTuple):
    """The servo drive and how it is reached."""

    current_lag: Annotated[float, Quantity("s", "[0, 0.1]", "time constant of the current loop")]
    current_limit: Annotated[float, Quantity("A", "(0, 1e4]", "largest current, of drive and law alike")]
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


class Realtime(NamedTuple):
    """How the loop's process asks the kernel for punctuality; what is not permitted is said, not hidden."""

    priority: Annotated[int, Quantity("", "[0, 99]", "SCHED_FIFO priority; 0: ordinary scheduling")] = 80
    cpu: Annotated[int | None, Quantity("", "[0, 4095]", "number of the CPU the loop is pinned to")] = None
    late_limit: Annotated[int, Quantity("", "[1, 1000000]", "late cycles in a row that cause a quick stop")] = 10
    spin: Annotated[float, Quantity("s", "[0, 1e-3]", "how long before each period the loop stays awake")] = 0.0
    feedback_age: Annotated[int, Quantity("", "[1, 1000]", "control periods that a position may be old")] = 3


class VirtualDrive(NamedTuple):
    """What a virtual drive does that a sound one does not; a real drive reads none of it."""

    faults: Annotated[
        tuple[Annotated[Any, Tagged("fault", BLOCKS)], ...], "what fails, counted from Operation enabled on"
    ] = ()


class StageFile(NamedTuple):
    """The whole file."""

    name: Annotated[str, "what the machine is called"]
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
    compensation: Annotated[Any, Tagged("form", FORMS)] = Model()
    realtime: Realtime = Realtime()
    simulation: Simulation = Simulation()
    learning: learning.LearningSettings = learning.LearningSettings()
    residual: Residual | None = None
    virtual_drive: VirtualDrive = VirtualDrive()


class Setup(NamedTuple):
    """A stage file, read, checked and assembled."""

    path: Path
    file: StageFile
    stage: stage.Stage  # the model: what the law is designed for, and the plant where there is no machine

    @property
    def dt(self) -> float:
        """Control period Ts (s)."""
        return self.file.control.period


def load_stage(path: Path, judged: bool = True) -> Setup:
    """Read a stage file, or an axis of one (``xy.yaml#x``); not `judged`, its loop may be one that must not run.

    Raises ConfigError with every error, and DesignError where the loop it describes is refused.
    """
    file: StageFile = load_axis(path, _read if judged else _read_unjudged)
    wire = file.drive.wire
    if isinstance(wire, Canopen):
        eds = str(_eds(wire.eds, path))
        file = file._replace(drive=file.drive._replace(wire=wire._replace(eds=eds)))
    return Setup(path, file, _assembled(file))


def _read(reader: Reader, root: yaml.Node) -> StageFile | None:
    file = _read_unjudged(reader, root)
    if file is not None and not reader.errors:
        _check_loop(reader, file, root)
    return file


def _read_unjudged(reader: Reader, root: yaml.Node) -> StageFile | None:
    first = Reader(reader.path, Lengths())
    lengths = _lengths(first, root)
    if lengths is None:
        reader.errors = first.errors
        return None
    reader.lengths = lengths
    file: StageFile = reader.value(StageFile, root, "")
    if not reader.errors:
        for wrong in (*_check_parts(file), *_check_wire(file, reader.path)):
            reader.refuse(node_at(root, wrong.split(" ")[0]), wrong)
    return file


def _lengths(reader: Reader, root: yaml.Node) -> Lengths | None:
    """How lengths and angles convert; None where the axis is wrong, as then all else would look wrong, too."""
    entries = reader.entries(root, "", StageFile._fields)
    if "axis" not in entries:
        reader.refuse(root, f"axis is missing: a block of {', '.join(Axis._fields)}")
        return None
    before = len(reader.errors)
    axis = reader.value(Axis, entries["axis"], "axis")
    return Lengths(axis.kind, axis.lead) if len(reader.errors) == before else None


def _check_loop(reader: Reader, file: StageFile, root: yaml.Node) -> None:
    """A loop that must not run is refused here, before anything moves."""
    try:
        design.design(_assembled(file), file.control)
    except design.DesignError as error:
        place = reader.place(node_at(root, str(error).split(" ")[0]))
        raise design.DesignError(f"{error} ({place})") from error


def _check_parts(file: StageFile) -> list[str]:
    wrong = []
    encoder, axis = file.encoder, file.axis
    if (encoder.counts_per_revolution is None) == (encoder.step is None):
        wrong.append("encoder needs exactly one of counts_per_revolution and step")
    if axis.kind == LINEAR and (axis.lead or encoder.counts_per_revolution):
        wrong.append("axis.kind = linear; a lead or counts_per_revolution belong to a rotary axis")
    low, high = (end * axis.travel_per_unit for end in file.limits.travel)
    if low >= high:
        wrong.append(f"limits.travel = [{low:g}, {high:g}] {axis.travel_unit}; the first must be below the second")
    if file.homing.wrong:
        wrong.append(file.homing.wrong)
    at_rest, moving = file.limits.following_error_at_rest, file.limits.following_error
    if at_rest is not None and at_rest > moving:
        wrong.append(
            f"limits.following_error_at_rest = {at_rest:g}; must be at most limits.following_error, {moving:g}"
        )
    wrong += effects_that_cannot_be(file)
    rolling = file.friction
    if isinstance(rolling, Rolling) and not rolling.shortest <= rolling.longest <= WIDEST * rolling.shortest:
        wrong.append(f"friction.longest must be 1 to {WIDEST:g} times friction.shortest")
    if isinstance(rolling, Operators) and len(rolling.weight) != len(rolling.slip):
        wrong.append(f"friction.weight has {len(rolling.weight)} entries and friction.slip {len(rolling.slip)}")
    return wrong


def _check_wire(file: StageFile, path: Path) -> list[str]:
    wire = file.drive.wire
    if isinstance(wire, Odrive):
        return [*_check_turns(file), *odrive.refused(wire, file.control.period)]
    if not isinstance(wire, Canopen):
        return []
    wrong = []
    if not _exists(_eds(wire.eds, path)):
        wrong.append(f"drive.wire.eds = {wire.eds}; no such file; the path is relative to {path.parent}")
    for name, pdo, needed in (("rpdo", wire.rpdo, wire.command_object), ("tpdo", wire.tpdo, wire.current_object)):
        wrong += _check_objects(f"drive.wire.{name}", pdo, needed)
    if wire.heartbeat_timeout <= wire.heartbeat:
        wrong.append(f"drive.wire.heartbeat_timeout = {wire.heartbeat_timeout:g} s; must exceed heartbeat")
    if 0.0 < (silence := wire.rpdo_timeout) <= file.control.period:
        wrong.append(f"drive.wire.rpdo_timeout = {silence:g} s; must exceed control.period, or be 0 s: off")
    wrong += slcan.refused(wire, file.control.period)
    load_share = frames.load(1.0 / file.control.period, wire.bitrate, (0, 8, 8))
    if load_share > wire.bus_load_limit:
        wrong.append(_overload(file, wire, load_share))
    return wrong


def _check_turns(file: StageFile) -> list[str]:
    wrong = ["axis.kind = linear; an ODrive counts turns: must be rotary"] if file.axis.kind == LINEAR else []
    return wrong if file.drive.delay_samples else [*wrong, "drive.delay_samples = 0; over a line it is at least 1"]


def _eds(name: str, stage_file: Path) -> Path:
    """Relative to the stage file; for a copy of ours that lies elsewhere, to the configuration it came with."""
    beside = stage_file.parent.resolve() / name
    return beside if _exists(beside) or not _exists(OWN / name) else OWN / name


def _exists(path: Path) -> bool:
    return os.path.isfile(path)  # unlike `Path.is_file` also for too long a name, and in a folder that is forbidden


def _check_objects(name: str, pdo: tuple[int, ...], needed: int) -> list[str]:
    strange = [number for number in pdo if number not in OBJECTS]
    if strange:
        return [f"{name} = {strange[0]:#x}; must be an index with its subindex, such as 0x6040_00"]
    if needed and needed not in pdo:
        return [f"{name} must hold the object 0x{needed >> 8:04x}_{needed & 0xFF:02x} that the cycle uses"]
    return []


def _overload(file: StageFile, wire: Canopen, share: float) -> str:
    longest = file.control.period * share / wire.bus_load_limit
    return (
        f"drive.wire.bitrate = {wire.bitrate / 1e3:g} kbit/s; SYNC and two PDOs every {file.control.period * 1e3:g} ms "
        f"take {100 * share:.0f} % of the bus, the limit is {100 * wire.bus_load_limit:.0f} %: raise the bit rate, or "
        f"take control.period of at least {longest * 1e3:.3g} ms"
    )


def _assembled(file: StageFile) -> stage.Stage:
    wire, counts = file.drive.wire, file.encoder.counts_per_revolution
    step = 2.0 * math.pi / counts if counts else file.encoder.step
    assert step is not None  # exactly one of the two, checked above
    return stage.Stage(
        stage.Drive(
            wire.command_scale if isinstance(wire, Canopen) else 0.0,
            file.drive.delay_samples,
            file.drive.current_limit,
            file.drive.current_lag,
            *(getattr(file.drive, name) for name in stage.Drive._fields[4:]),
        ),
        file.motor,
        file.mechanics,
        friction_of(file.friction),
        stage.Encoder(step, file.encoder.delay_samples, file.encoder.eccentricity, file.encoder.interpolation),
        table_of(file.residual),
    )


def carried(path: Path, file: StageFile) -> Setup:
    """The set-up of a stage file that was read before, as a recording carries it; `path` names it."""
    return Setup(path, file, _assembled(file))


__all__ = ["Axis", "ConfigError", "Limits", "Operators", "Rolling", "Setup", "StageFile", "carried", "load_stage"]
