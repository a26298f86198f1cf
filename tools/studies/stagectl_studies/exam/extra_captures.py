"""The plant runs what a diagnosis asked for: three more captures, at their place in the session."""

import re
from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stagectl_studies.exam.plan import ExamError
from stagectl_studies.exam.realised_closure import column
from stagectl_studies.machine.battery import HALF_STROKE, REPEATS, Experiment
from stagectl_studies.machine.controller import prepared
from stagectl_studies.machine.folder import entry, write_capture, write_yaml
from stagectl_studies.machine.machine import Floats
from stagectl_studies.machine.reference import PERIOD
from stagectl_studies.machine.trials import BREAK, Capture, Trial, noisy

USE = "diagnose"
LONGEST = 120.0  # s of one run
_NAME = re.compile(r"(?!held-)[a-z][a-z0-9.-]{0,60}")  # it becomes a file's name; what is held out is the exam's own


class RefusedError(ExamError):
    """An experiment that the machine does not run, or that it does not survive."""


class Wanted(NamedTuple):
    """An experiment row by row; the reference from 0 where the axis stands."""

    name: str
    time: Floats  # (n,) s
    reference: Floats  # (n,) rad
    injection: Floats  # (n,) A


def read(name: str, path: Path) -> Wanted:
    """What `gap next --samples` wrote; raises RefusedError where it is none."""
    try:
        return Wanted(name, *(column(path, column_name) for column_name in ("time_s", "reference_rad", "injection_A")))
    except (OSError, KeyError, ValueError) as error:
        raise RefusedError(f"{name}: no rows that a machine can run: {type(error).__name__}: {error}") from error


def check(wanted: Wanted, known: Collection[str]) -> None:
    """Raise RefusedError for what this machine cannot run."""
    name, n = wanted.name, wanted.time.size
    if not _NAME.fullmatch(name) or name in known:
        raise RefusedError(f"{name!r} is no name for another capture; taken are {', '.join(sorted(known))}")
    if not 8 <= n <= LONGEST / PERIOD:
        raise RefusedError(f"{name}: {n * PERIOD:g} s; must lie in [{8 * PERIOD:g}, {LONGEST:g}] s")
    if not np.abs(wanted.time - np.arange(n) * PERIOD).max() < 1e-9:
        raise RefusedError(f"{name}: rows that are not {PERIOD:g} s apart")
    if not all(np.isfinite(values).all() for values in (wanted.reference, wanted.injection)):
        raise RefusedError(f"{name}: not every row holds a number")
    farthest = float(np.abs(wanted.reference).max())
    if farthest > HALF_STROKE:
        raise RefusedError(f"{name}: {farthest:g} rad from where the axis stands; must lie in [0, {HALF_STROKE:g}] rad")


def begun(trial: Trial) -> float:
    """Where the axis stands between experiments, rad: where the first one begins."""
    return float(trial.captures[0].experiment.reference[0])


def with_experiment(trial: Trial, wanted: Wanted) -> Trial:
    """The trial whose session goes on with `wanted`, as often as each experiment for diagnosis."""
    reference = np.round(begun(trial) + wanted.reference, 12)
    experiment = Experiment(wanted.name, USE, reference, np.round(wanted.injection, 7))
    last, added = trial.captures[-1], []
    clock = last.start + last.experiment.reference.size * PERIOD + BREAK
    for repeat in range(1, REPEATS[USE] + 1):
        added.append(Capture(f"{experiment.name}-{repeat}.csv", experiment, repeat, round(clock, 4)))
        clock += reference.size * PERIOD + BREAK
    rows = {**trial.rows, experiment.name: prepared(trial.model, trial.loop, reference, experiment.injection)}
    return trial._replace(captures=(*trial.captures, *added), rows=rows)


def ran(trial: Trial, wanted: Wanted, folder: Path) -> Trial:
    """Run it and add it to the user's folder of captures; the trial with the longer session.

    Raises RefusedError where it cannot be run, or where the axis is lost in it.
    """
    check(wanted, {capture.experiment.name for capture in trial.captures})
    longer = with_experiment(trial, wanted)
    new = range(len(trial.captures), len(longer.captures))
    traces = [noisy(longer, number) for number in new]
    lost = [longer.captures[k].file for k, trace in zip(new, traces, strict=True) if trace.lost]
    if lost:
        raise RefusedError(f"{wanted.name}: the axis was lost in {', '.join(lost)}")
    for k, trace in zip(new, traces, strict=True):
        write_capture(longer.captures[k], trace, folder)
    write_yaml(folder / "captures.yaml", {"captures": [entry(capture) for capture in longer.captures]})
    return longer
