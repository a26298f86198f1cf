"""From what a user gives to a session: logs on their control periods, with setpoints, and what cannot be told.

::

    paths --> sources --> believed --> grid --> repeats --> hygiene --> setpoints --> Session
              as found    model, law   periods  alike?      rows that   what was
                                                            count       known beforehand
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.gap.logs import row_validity, setpoints
from stagectl.gap.logs.grid import Gridded, gridded
from stagectl.gap.logs.missing_records import cannot_tell
from stagectl.gap.logs.nominal_setup import Believed, believed
from stagectl.gap.logs.repeats import Repeat, alike
from stagectl.gap.logs.session import Array, GapError, Log, Session
from stagectl.gap.logs.sources import Found, found
from stagectl.parallel import in_parallel
from stagectl.recording.columns import WITHOUT

_SAME = 1e-3  # share by which the periods of two logs may differ


def load(paths: Sequence[Path], stage: Setup | None = None) -> Session:
    """The session in a folder of captures, in recordings of ours, or in single logs; `stage` is their machine.

    Raises GapError where the logs do not belong together, or a value of theirs cannot be; RecordingError where a file
    cannot be read.
    """
    logs = found(paths, stage)
    machine = believed(logs, stage)
    dt = machine.dt or _period(logs)
    repeats, noted = alike([Repeat(log, _gridded(log, dt)) for log in logs])
    made = [_log(one, known, machine, dt) for one, known in zip(repeats, _known(repeats, machine), strict=True)]
    notes = [(one.log.name, note) for one in repeats for note in _own(one.log)]
    notes += [(log.name, note) for log, said in made for note in said]
    finished = tuple(log for log, _ in made)
    axis = machine.axis
    session = Session(
        place=paths[0],
        kind=axis["kind"],
        travel_per_unit=axis["travel_per_unit"],
        travel_unit=axis["travel_unit"],
        dt=dt,
        stage=machine.stage,
        law=machine.law,
        logs=finished,
        notes=(*machine.notes, *noted, *gathered(notes, len(finished))),
        trusted=machine.trusted,
        nominal=machine.nominal,
    )
    return session._replace(cannot_tell=cannot_tell(session, [one.log.start is not None for one in repeats]))


def gathered(notes: Iterable[tuple[str, str]], count: int) -> list[str]:
    """Notes of single logs as one each, with the logs that they are of; `count` is that of all logs."""
    by_words: dict[str, list[str]] = {}
    for name, words in notes:
        by_words.setdefault(words, []).append(name)
    return [f"{_named(list(dict.fromkeys(names)), count)}: {words}" for words, names in by_words.items()]


def _named(names: list[str], count: int) -> str:
    if len(names) == count > 2:
        return f"all {count} logs"
    shown = names if len(names) <= 3 else [*names[:2], f"{len(names) - 2} more"]
    return ", ".join(shown[:-1]) + (" and " if len(shown) > 1 else "") + shown[-1]


def _period(logs: list[Found]) -> float:
    """The sampling period (s) that all logs share, where no controller tells one.

    Raises GapError where they differ.
    """
    steps = {log.name: float(np.median(np.diff(log.time))) for log in logs if len(log.time) > 1}
    if len(steps) < len(logs):
        raise GapError(f"{next(log.name for log in logs if log.name not in steps)} has one row; record longer")
    low, high = min(steps, key=lambda name: steps[name]), max(steps, key=lambda name: steps[name])
    if steps[high] > (1.0 + _SAME) * steps[low]:
        raise GapError(
            f"{low} was sampled every {steps[low] * 1e3:.6g} ms, {high} every {steps[high] * 1e3:.6g} ms, and no "
            "controller.Ts tells the control period; diagnose them apart, or give nominal.yaml"
        )
    return steps[logs[0].name]


def _gridded(log: Found, dt: float) -> Gridded:
    try:
        grid = gridded(log.time, log.columns, dt)
    except GapError as error:
        raise GapError(f"{log.name}: {error}") from error
    if not grid.exact and log.ours:
        raise GapError(f"{log.name}: the rows of a recording of ours are not its control periods; record it again")
    return grid


def _own(log: Found) -> list[str]:
    """What the file's reader had to say, but for missing columns, which are said once."""
    absent = tuple(WITHOUT.values())
    recording = log.recording
    lost = [f"{recording.lost_rows} rows were lost while it was recorded"] if recording.lost_rows else []
    cut = [] if recording.complete else [f"it is not complete: {recording.ended}"]
    return [*(note for note in recording.meta.get("notes", []) if note not in absent), *lost, *cut]


def _known(repeats: list[Repeat], machine: Believed) -> list[Array | None]:
    """The setpoints of all `repeats`; those that were asked for the same have the same ones."""
    keys = [_key(one) for one in repeats]
    first = dict(zip(reversed(keys), reversed(repeats), strict=True))
    found = dict(zip(first, in_parallel(lambda one: _setpoints(one, machine), first.values()), strict=True))
    return [found[key] for key in keys]


def _key(one: Repeat) -> tuple[bytes, ...]:
    """What decides the setpoints of a log."""
    if one.log.setpoints is not None:
        return (one.log.name.encode(),)
    columns = one.grid.columns
    injection = columns.get("injection", np.zeros(0))
    return (str(len(columns["position"])).encode(), *(part.tobytes() for part in (*one.grid.samples, injection)))


def _log(one: Repeat, known: Array | None, machine: Believed, dt: float) -> tuple[Log, list[str]]:
    log, grid = one
    limit = min(machine.stage.drive.current_limit, machine.law.current_limit if machine.law else math.inf)
    judged = row_validity.judged(grid.columns, dt, limit, machine.stage.encoder.step)
    columns = {name: row_validity.filled(column) for name, column in grid.columns.items()}
    made = Log(
        name=log.name,
        experiment=log.experiment,
        repeat=log.repeat or 1,
        held_out=log.held_out,
        start=log.start or 0.0,
        position=columns["position"],
        command=columns.get("command"),
        current=columns.get("current"),
        reference=columns.get("reference"),
        injection=columns.get("injection"),
        valid=judged.valid,
        setpoints=known,
        exact=grid.exact,
    )
    return made, [*grid.notes, *judged.notes]


def _setpoints(one: Repeat, machine: Believed) -> Array | None:
    """As they were recorded, else as the deployed controller had them; None where they are not known."""
    log, grid = one
    rows = len(grid.columns["position"])
    if log.setpoints is not None:
        recorded = {str(j): column for j, column in enumerate(log.setpoints.T)}
        on_periods = gridded(log.time, recorded, machine.dt).columns.values()
        return np.stack([row_validity.filled(column)[:rows] for column in on_periods], axis=1)
    time, reference = grid.samples
    injection = row_validity.filled(grid.columns["injection"]) if "injection" in grid.columns else None
    if machine.deployed is None or len(time) < setpoints.LEAST:
        return None
    return setpoints.setpoint_rows(machine.deployed, setpoints.LoggedReference(time, reference, rows, injection))
