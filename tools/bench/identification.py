"""Identification: a minute at 2 kHz against an output-error fit of the same data, and the memory of ten minutes.

Both see the same capture, a 1.6 Hz current sine of 5 A with 0.045 A of noise, and start from nominal values that are
a fifth off.  What each computes, so that the ratio can be judged::

    simultaneous    inertia, viscous friction, 16 stop operators without a given shape, offset, delay, intervals
    output error    inertia, viscous friction, and the three parameters of the rolling friction that the plant really
                    has: a simulation with four steps a period, compiled, for each of scipy's differences

The output-error fit (fits.py) is told the plant's own structure and that the axis began at rest; simultaneous is not.
"""

import importlib.util
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from fits import Fit, cma_es, output_error, simultaneous
from measure import Against, Row, Wanted, scaled, times_faster, versus
from scene import STAGE

from stagectl.config.stage_file import load_stage
from stagectl.identification.captures import opened, prepared

_MOTION = "type: current_sine\namplitude: 5 A\nfrequency: 1.6 Hz\nperiods: {periods}\n"


def rows(folder: Path, rounds: int, memory: bool) -> list[Row]:
    """Times, their ratio, and with `memory` the peak of the verb on ten minutes, whose simulation takes a while."""
    setup = load_stage(_noisy(folder))
    minute = prepared(opened([_recorded(folder, "minute", 94)], setup), setup)
    ours, theirs = [], []
    simultaneous(minute, setup)  # compiles
    output_error(minute[0], setup)
    for _ in range(rounds):
        ours.append(simultaneous(minute, setup))
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


def against(folder: Path, rounds: int) -> tuple[list[Against], dict[str, str]]:
    """Time and error of the inertia beside both simulating fits, and what could not be compared."""
    setup = load_stage(_noisy(folder))
    minute, truth = prepared(opened([_recorded(folder, "minute", 94)], setup), setup), setup.stage.mechanics.inertia
    peers = {"scipy, output error": output_error, "CMA-ES over rollouts, as BAM": cma_es}
    skipped = {}
    if importlib.util.find_spec("cma") is None:
        del peers["CMA-ES over rollouts, as BAM"]
        skipped["identification against CMA-ES"] = "cma is not installed: pip install -e '.[bench]'"
    simultaneous(minute, setup)  # compiles
    output_error(minute[0], setup)
    ours, theirs = [], {name: list[Fit]() for name in peers}
    for _ in range(rounds):
        ours.append(simultaneous(minute, setup))
        for name, fit in peers.items():
            theirs[name].append(fit(minute[0], setup))
    lines = []
    for name, fits in theirs.items():
        method = (
            f"{name}: {fits[-1].simulations} simulations of 60 s of a current sine at 2 kHz with noise, which ours "
            f"sees, too; in turn, rounds: {rounds}, elapsed time; theirs starts a fifth off and knows the friction's "
            "form, ours does not"
        )
        seconds = [fit.seconds for fit in ours], [fit.seconds for fit in fits]
        lines.append(versus(("Identification", name, "time of a fit"), seconds, ("s", 1.0), method))
        errors = _errors(ours, truth), _errors(fits, truth)
        lines.append(versus(("Identification", name, "error of the inertia"), errors, ("%", 1.0), method))
    return lines, skipped


def _errors(fits: Sequence[Fit], inertia: float) -> list[float]:
    """Error of the inertia of each fit (%)."""
    return [100.0 * abs(fit.inertia / inertia - 1.0) for fit in fits]


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
