"""Identification: a minute at 2 kHz against an output-error fit of the same data, and the memory of ten minutes.

Both see the same capture, a 1.6 Hz current sine of 5 A with 0.045 A of noise, and start from nominal values that are
a fifth off.  What each computes, so that the ratio can be judged::

    simultaneous    inertia, viscous friction, 16 stop operators without a given shape, offset, delay, intervals
    output error    inertia, viscous friction, and the three parameters of the rolling friction that the plant really
                    has: a simulation with four steps a period, compiled, for each of scipy's differences

The output-error fit is told the plant's own structure and that the axis began at rest; simultaneous is not.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from measure import Row, Wanted, scaled, times_faster
from scene import STAGE
from scipy.optimize import least_squares

from stagectl.config.stage_file import Rolling, Setup, load_stage
from stagectl.identification.capture import Capture
from stagectl.identification.captures import load
from stagectl.identification.simultaneous.method import identify
from stagectl.kernels import stage
from stagectl.kernels.jit import kernel

SUBSTEPS = 4
THINNED = 20  # rows of the position error that the output-error fit looks at: every twentieth
WRONG = 1.2  # times the truth, where it starts
_MOTION = "type: current_sine\namplitude: 5 A\nfrequency: 1.6 Hz\nperiods: {periods}\n"


class Fit(NamedTuple):
    """What one of them took, and found."""

    seconds: float
    inertia: float  # kg m^2
    simulations: int


def rows(folder: Path, rounds: int, memory: bool) -> list[Row]:
    """Times, their ratio, and with `memory` the peak of the verb on ten minutes, whose simulation takes a while."""
    setup = load_stage(_noisy(folder))
    minute = load([_recorded(folder, "minute", 94)], setup)
    ours, theirs = [], []
    _simultaneous(minute, setup)  # compiles
    output_error(minute[0], setup)
    for _ in range(rounds):
        ours.append(_simultaneous(minute, setup))
        theirs.append(output_error(minute[0], setup))
    truth = setup.stage.mechanics.inertia
    errors = [100.0 * abs(fits[-1].inertia / truth - 1.0) for fits in (ours, theirs)]
    method = "60 s of a current sine at 2 kHz, elapsed time in one process, interleaved"
    seconds = [[one.seconds for one in fits] for fits in (ours, theirs)]
    told = f"output error: {theirs[-1].simulations} simulations, inertia off by {errors[1]:.3f} %"
    lines = [
        Row(
            "simultaneous, 60 s at 2 kHz",
            scaled(seconds[0], 1.0),
            "s",
            Wanted(1.0, False),
            f"{method}; inertia off by {errors[0]:.3f} %",
        ),
        Row("output error / simultaneous", times_faster(*seconds), "x", None, f"{method}; {told}"),
    ]
    return [*lines, *([_memory_row(folder)] if memory else [])]


def _memory_row(folder: Path) -> Row:
    method = "the verb in a process of its own on a recording of 600 s, its page included"
    return Row("identify: peak memory, 10 minutes", scaled([_memory(folder)], 1.0), "MiB", Wanted(500.0, False), method)


def _noisy(folder: Path) -> Path:
    path = folder / "noisy.yaml"
    path.write_text(STAGE.read_text().replace("\nsimulation:", "\nsimulation:\n  current_noise: 45 mA"))
    return path


def _recorded(folder: Path, name: str, periods: int) -> Path:
    """A capture as `simulate` records it."""
    motion, recording = folder / f"{name}.yaml", folder / f"{name}.h5"
    motion.write_text(_MOTION.format(periods=periods))
    _verb("simulate", folder / "noisy.yaml", motion, "-o", recording)
    return recording


def _verb(*arguments: object) -> None:
    subprocess.run([sys.executable, "-m", "stagectl", *map(str, arguments)], check=True, capture_output=True)


def _memory(folder: Path) -> float:
    """MiB, the largest that the verb ever had."""
    long = _recorded(folder, "long", 956)
    script = (
        "import json, resource, subprocess, sys\n"
        "subprocess.run([sys.executable, '-m', 'stagectl', *sys.argv[1:]], check=True, capture_output=True)\n"
        "print(json.dumps(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss))"
    )
    verb = ("identify", "simultaneous", folder / "noisy.yaml", long, "--report", folder / "page.html")
    told = subprocess.run([sys.executable, "-c", script, *map(str, verb)], check=True, capture_output=True, text=True)
    return float(json.loads(told.stdout)) / 1024.0


def _simultaneous(captures: list[Capture], setup: Setup) -> Fit:
    begin = time.perf_counter()
    found = identify(captures, setup.file)
    return Fit(time.perf_counter() - begin, found.parameters["inertia"].value, 0)


@kernel
def _driven(p: stage.Stage, x: stage.State, inputs: Any, dt: float, substeps: int) -> stage.State:
    """The plant under measured currents: inputs = (currents (n,) A, positions (n,) to be filled)."""
    currents, positions = inputs
    for k in range(len(currents)):
        positions[k] = x.position
        x = stage.period(p, x, currents[k], stage.SILENT, dt, substeps)
    return x


def output_error(capture: Capture, setup: Setup) -> Fit:
    """Parameters for which the simulated position is the measured one, by scipy's trust region."""
    begin = time.perf_counter()
    positions = np.empty(len(capture.current))
    friction = setup.file.friction
    assert isinstance(friction, Rolling)
    # The measured current is the motor's: no delay, no current loop.
    drive = setup.stage.drive._replace(current_quantum=0.0, delay_samples=0, current_lag=0.0)
    count = 0

    def error(logarithms: Any) -> Any:
        nonlocal count
        count += 1
        inertia, viscous, coulomb, shortest, longest = (float(value) for value in nominal * np.exp(logarithms))
        rolling = friction._replace(coulomb=coulomb, shortest=shortest, longest=max(longest, shortest))
        p = setup.stage._replace(
            drive=drive,
            mechanics=setup.stage.mechanics._replace(inertia=inertia, viscous=viscous),
            friction=setup.stage.friction._replace(operators=rolling.operators()),
        )
        _driven(p, stage.at_rest(p, capture.position[0]), (capture.current, positions), capture.dt, SUBSTEPS)
        return (positions - capture.position)[::THINNED]

    mechanics = setup.stage.mechanics
    nominal = np.array(
        [mechanics.inertia, mechanics.viscous, friction.coulomb, friction.shortest, friction.longest], dtype=np.float64
    )
    start = np.full(len(nominal), np.log(WRONG))
    solved = least_squares(error, start, x_scale=0.1, diff_step=1e-4, ftol=1e-6, xtol=1e-6)
    return Fit(time.perf_counter() - begin, float(nominal[0] * np.exp(solved.x[0])), count)
