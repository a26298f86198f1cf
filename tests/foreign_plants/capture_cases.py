"""Captures of machines drawn at random: a seed gives the machine, its motion, the log, and what is true of it.

What is drawn, relative to the nominal axis where it has a value:

* inertia and viscous friction within 15 %, Coulomb friction within 30 %, offset up to 0.2 N m;
* noise of the current that flows, 0 to 2.5 % of the rated current (rms, bandwidth of the current loop); the sensor
  of a measured current adds half as much;
* a delay (see the package) of up to 1.5 ms, at any place between two samples; lag of the current loop 0.05 to 0.3 ms;
* ripple of the torque up to 0.5 % of it, cogging up to 0.02 N m, friction that differs by up to 1 % between directions;
* 2^20 counts a revolution in half of the captures, 20,000 and 4,096 in a quarter each;
* rows every 0.5, 1, 5 or 10 ms of a controller that runs every 0.5, 0.25 or 0.1 ms; captures of 1 s have 1 ms at most;
* the log begins at rest, or 0.7 s into the motion; three of four have the reference, half a measured current.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from tests.foreign_plants import friction, machine, motions
from tests.foreign_plants.friction import Friction
from tests.foreign_plants.machine import NOISE_PERIOD, Plant, Trace
from tests.foreign_plants.nominal import Nominal, nominal

Array = NDArray[np.float64]
STEP = 10e-6  # s
LONGEST_DELAY = 1.5e-3  # s


class Setting(NamedTuple):
    """What a table of results is sorted by."""

    seed: int
    law: str
    motion: str
    counts: int  # a revolution
    row: float  # s
    duration: float  # s
    column: str  # "command", or "measured" where the log holds both
    noise: float  # A rms, of the current that flows
    reference: bool
    lead_in: float  # s


class Truth(NamedTuple):
    """What an identification should find; the package defines each."""

    inertia: float
    viscous: float
    coulomb: float
    delay: float


class Capture(NamedTuple):
    """A log, and everything that it came from."""

    setting: Setting
    plant: Plant
    trace: Trace
    truth: Truth
    columns: dict[str, Array]  # by their header, (n,)


def setting_of(seed: int, only: str = "") -> Setting:
    """The conditions of a capture; the laws and motions take turns."""
    rng = np.random.default_rng([20, seed])
    law = only or friction.LAWS[seed % len(friction.LAWS)]
    motion = tuple(motions.MOTIONS)[(seed + seed // 12) % len(motions.MOTIONS)]  # all pairs in 24 seeds
    row = float(rng.choice([0.5e-3, 1e-3, 5e-3, 10e-3], p=[0.4, 0.2, 0.2, 0.2]))
    duration = 1.0 if row <= 1e-3 and rng.uniform() < 0.5 else 10.0
    counts = int(rng.choice([2**20, 20_000, 4_096], p=[0.5, 0.25, 0.25]))
    noise = nominal().rated_current * rng.uniform(0.0, 0.025)
    column = "measured" if rng.uniform() < 0.5 else "command"
    reference, lead_in = bool(rng.uniform() < 0.75), float(rng.choice([0.0, 0.7]))
    return Setting(seed, law, motion, counts, row, duration, column, noise, reference, lead_in)


def friction_of(rng: Generator, law: str, axis: Nominal) -> Friction:
    """A law with random parameters, of the size of the nominal rolling friction."""
    coulomb = axis.coulomb * rng.uniform(0.7, 1.3)
    count = int(rng.integers(20, 31))
    shares = rng.dirichlet(np.full(count, 2.0))
    slips = np.exp(rng.uniform(math.log(axis.rolling_zone / 30.0), math.log(1.3 * axis.rolling_zone), count))
    exponent = 1.0 if rng.uniform() < 0.5 else rng.uniform(0.6, 1.6)
    zone = math.exp(rng.uniform(math.log(1e-3), math.log(3e-3)))  # rad, of one bristle
    return Friction(
        friction.LAWS.index(law),
        coulomb,
        coulomb * rng.uniform(1.05, 1.5),
        math.exp(rng.uniform(math.log(0.5), math.log(5.0))),
        coulomb / zone,
        rng.uniform(0.02, 0.2),
        rng.uniform(0.3, 1.0),
        exponent,
        rng.uniform(0.3, 0.9),
        coulomb / rng.uniform(2e-3, 10e-3),
        math.exp(rng.uniform(math.log(0.05), math.log(0.3))),
        rng.uniform(-0.01, 0.01),
        slips,
        shares,
    )


def plant_of(rng: Generator, setting: Setting) -> Plant:
    """A machine around the nominal one, and a controller that suits its encoder."""
    axis = nominal()
    mechanics = machine.Mechanics(
        axis.inertia * rng.uniform(0.85, 1.15),
        axis.viscous * rng.uniform(0.85, 1.15),
        rng.uniform(-0.2, 0.2),
        rng.uniform(0.0, 0.005),
        float(rng.choice([6, 12])),
        rng.uniform(0.0, 2.0 * math.pi),
        rng.uniform(0.0, 0.02),
        float(rng.choice([2, 4, 8])),
    )
    controller = _controller(rng, axis, setting.counts)
    drive, age = _timing(rng, axis, setting, controller.period)
    encoder = machine.Encoder(2.0 * math.pi / setting.counts, rng.uniform(), age)
    return Plant(mechanics, drive, encoder, controller, friction_of(rng, setting.law, axis), STEP)


def _controller(rng: Generator, axis: Nominal, counts: int) -> machine.Controller:
    """PD, or PID in half of the cases; slower the coarser the encoder."""
    slow, fast = {2**20: (9.0, 18.0), 20_000: (7.0, 12.0), 4_096: (5.0, 8.0)}[counts]
    pole = 2.0 * math.pi * rng.uniform(slow, fast)
    integral = 0.15 * pole * axis.inertia * pole**2 if rng.uniform() < 0.5 else 0.0
    proportional, derivative = axis.inertia * pole**2, 2.0 * axis.inertia * pole
    period = float(rng.choice([0.5e-3, 0.25e-3, 0.1e-3]))
    return machine.Controller(period, proportional, derivative, integral, 8.0 * pole)


def _timing(rng: Generator, axis: Nominal, setting: Setting, period: float) -> tuple[machine.Drive, float]:
    """The drive and the position's age (s), so that the delay of the logged column is uniform up to 1.5 ms."""
    lag, wanted = rng.uniform(0.05e-3, 0.3e-3), rng.uniform(0.0, LONGEST_DELAY)
    late, age = rng.uniform(0.0, 0.5e-3), 0.0
    if setting.column == "command":
        late = max(wanted - lag - 0.5 * period, 0.0)
    drive = machine.Drive(axis.force_constant, late, lag, 1e-3 * axis.rated_current, axis.current_limit)
    if setting.column == "measured":
        age = max(wanted - current_delay(drive, period), 0.0)
    return drive, age


def command_delay(drive: machine.Drive, period: float) -> float:
    """From a command's sample to its torque (s), on average over slow motions."""
    return drive.delay + 0.5 * period + drive.lag


def current_delay(drive: machine.Drive, period: float) -> float:
    """From a sample of the current to the torque's smooth course (s); the sample sees the staircase at one phase.

    Of a command that rises by 1 A/s: the current follows each stair by the lag, periodically.
    """
    since = -drive.delay % period  # from the last stair to the sample
    fall = math.exp(-period / drive.lag)
    behind = period / (1.0 - fall) * math.exp(-since / drive.lag)  # what the current lacks of the stair
    return command_delay(drive, period) - (drive.delay + since + behind)


def capture_of(setting: Setting) -> Capture:
    """The machine of a setting, moved and logged."""
    return moved(setting, plant_of(np.random.default_rng([21, setting.seed]), setting))


def moved(setting: Setting, plant: Plant) -> Capture:
    """A machine that makes the motion of a setting, and the log of it."""
    rng, axis, period = np.random.default_rng([22, setting.seed]), nominal(), plant.controller.period
    extent = motions.Extent(setting.lead_in + setting.duration + period, setting.duration, period)
    path = motions.MOTIONS[setting.motion](rng, extent)
    path = motions.scaled(path, period, axis, axis.coulomb * rng.uniform(3.0, 8.0))
    trace = machine.run(plant, path, _noise(rng, setting, plant, len(path)))
    columns = _logged(rng, setting, plant, trace, path)
    late = command_delay(plant.drive, period) if setting.column == "command" else current_delay(plant.drive, period)
    m, coulomb = plant.mechanics, plant.friction.coulomb
    return Capture(setting, plant, trace, Truth(m.inertia, m.viscous, coulomb, late + plant.encoder.age), columns)


def _noise(rng: Generator, setting: Setting, plant: Plant, rows: int) -> Array:
    """What disturbs the current loop (A), one value a `NOISE_PERIOD`; the loop's lag filters it to what flows."""
    cycles = math.ceil(rows * plant.controller.period / NOISE_PERIOD) + 1
    fall = math.exp(-NOISE_PERIOD / plant.drive.lag)
    return rng.normal(0.0, setting.noise * math.sqrt((1.0 + fall) / (1.0 - fall)), cycles)


def logged_rows(setting: Setting, plant: Plant) -> NDArray[np.int64]:
    """The samples of the controller that are logged, as indices."""
    each = round(setting.row / plant.controller.period)
    begin = round(setting.lead_in / plant.controller.period)
    count = round(setting.duration / setting.row)
    return begin + each * np.arange(count)


def _logged(rng: Generator, setting: Setting, plant: Plant, trace: Trace, path: Array) -> dict[str, Array]:
    rows = logged_rows(setting, plant)
    columns: dict[str, Array] = {
        "time_s": np.asarray(setting.row * np.arange(len(rows)), dtype=np.float64),
        "position_rad": trace.measured[rows],
        "current_command_A": trace.command[rows],
    }
    if setting.reference:
        columns["reference_rad"] = path[rows]
    if setting.column == "measured":
        steps = rows * round(plant.controller.period / plant.step)
        sensed = trace.current[steps] + rng.normal(0.0, 0.5 * setting.noise, len(rows))
        columns["current_A"] = np.round(sensed / plant.drive.quantum) * plant.drive.quantum
    return columns


def write(path: Path, columns: dict[str, Any]) -> None:
    """The log as a CSV with units in its header."""
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.12g")
