"""From what a user gives to a session: logs on their control periods, with setpoints.

::

    paths --> sources --> nominal_setup --> grid --> repeats --> row_validity --> deployed_setpoints --> Session
              as in       model, law        periods  one length,  rows that       their setpoints
              their files                            one reference count
"""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from stagectl.config.stage_file import Setup
from stagectl.gap.logs import deployed_setpoints, nominal_model, row_validity
from stagectl.gap.logs.current_order import drive_doubts, order_doubts
from stagectl.gap.logs.grid import GriddedLog, on_control_periods
from stagectl.gap.logs.nominal_setup import NominalSetup, nominal_setup
from stagectl.gap.logs.repeats import Repeat, reconciled
from stagectl.gap.logs.session import Array, Log, LogError, Session
from stagectl.gap.logs.sources import Description, RawLog, read_logs, unknown_keys
from stagectl.gap.logs.thresholds import LEAST_SPLINE, SAME_PERIOD, SAME_STEP, SLIP_OF_TRAVEL, SLIP_STEPS, SLOWER_LOG
from stagectl.kernels import friction
from stagectl.kernels.stage import NO_COMMANDS, Drive, Stage
from stagectl.number_format import duration
from stagectl.parallel import once_for_each
from stagectl.recording.columns import WITHOUT
from stagectl.recording.replay import carried

NOTHING_SAID = Description()
MOST_ROWS_LATE = len(NO_COMMANDS) - 1  # that the model's delay lines hold


def load(paths: Sequence[Path], stage: Setup | None = None, said: Description = NOTHING_SAID) -> Session:
    """The session in a folder of captures, in recordings of ours, or in single logs; `stage` is their machine.

    `said` describes logs that do not say what their columns are, or which machine they are of.

    Raises LogError where the logs do not belong together, NominalValueError where a value of the nominal model cannot
    be used, RecordingError where a file cannot be read.
    """
    raw = read_logs(paths, stage, said)
    machine = nominal_setup(raw, stage)
    dt, period_notes = (machine.dt, []) if machine.dt else _period(raw)
    repeats, repeat_notes = reconciled([Repeat(log, _gridded(log, dt)) for log in raw])
    period = stage.file.control.period if stage is not None and not machine.dt else dt
    known = _known_setpoints(repeats, machine, dt)
    held = dt < SLOWER_LOG * period
    finished = [_finished(repeat, rows, machine, dt, held) for repeat, rows in zip(repeats, known, strict=True)]
    machine = machine._replace(stage=_as_logged(machine.stage, repeats, [log for log, _ in finished], (period, dt)))
    notes = [(repeat.log.name, note) for repeat in repeats for note in _file_notes(repeat.log)]
    notes += [(log.name, note) for log, log_notes in finished for note in log_notes]
    of_drive = order_doubts if held else drive_doubts
    both = [(log.name, log.command, log.current) for log, _ in finished]
    doubts = [(name, doubt) for name, x, y in both if x is not None and y is not None for doubt in of_drive(x, y, dt)]
    axis = machine.axis
    session = Session(
        place=paths[0],
        kind=axis["kind"],
        travel_per_unit=axis["travel_per_unit"],
        travel_unit=axis["travel_unit"],
        dt=dt,
        stage=machine.stage,
        law=machine.law,
        logs=tuple(log for log, _ in finished),
        notes=(*said.notes, *machine.notes, *period_notes, *repeat_notes, *gathered(notes, len(finished))),
        nominal=machine.nominal,
        doubts=tuple(gathered(doubts, len(finished))),
    )
    unseen = any(log.command is not None and not log.held for log in session.logs)
    missing = [_between_rows(period, dt)] if unseen else []
    started = [repeat.log.start is not None for repeat in repeats]
    return session._replace(cannot_tell=(*missing, *undetermined(session, started)))


def _between_rows(period: float, dt: float) -> str:
    return (
        f"the logs have a row every {duration(dt)}, the loop of the stage file a command every {duration(period)}: "
        "what the drive makes of a command between two rows is not known, so the drive's effects cannot be judged; "
        "log every period, or correct control.period if the loop was slower"
    )


def _as_logged(p: Stage, repeats: Sequence[Repeat], logs: Sequence[Log], periods: tuple[float, float]) -> Stage:
    """`p` as far as the logs go, its delays in their rows; `periods` (s) are those of the loop and of the rows.

    A measured current that stands in the place of a command has been through the drive already.
    """
    if all(log.current is not None and not log.commanded for log in logs):
        p = p._replace(drive=Drive(0.0, 0, math.inf, 0.0))
    return _with_zone(_delayed_in_rows(p, *periods), repeats)


def _delayed_in_rows(p: Stage, period: float, dt: float) -> Stage:
    """`p` with the delay of its drive in rows of `dt` (s) and a rest in seconds, instead of in control periods."""
    if abs(dt - period) < SAME_STEP * period:
        return p
    late = min(p.drive.delay_samples * period + p.drive.dead_time, MOST_ROWS_LATE * dt)
    rows = math.floor(late / dt)
    drive = p.drive._replace(delay_samples=rows, dead_time=late - rows * dt)
    samples = min(round(p.encoder.delay_samples * period / dt), MOST_ROWS_LATE)
    return p._replace(drive=drive, encoder=p.encoder._replace(delay_samples=samples))


def _with_zone(p: Stage, repeats: Sequence[Repeat]) -> Stage:
    """`p`; where it does not say how far its friction moves before it slips, a share of the travel that was logged."""
    if p.friction is not nominal_model.FREE:
        return p
    travel = max(
        float(np.nanmax(repeat.grid.columns["position"]) - np.nanmin(repeat.grid.columns["position"]))
        for repeat in repeats
    )
    slip = max(SLIP_OF_TRAVEL * travel, SLIP_STEPS * p.encoder.step)
    return p._replace(friction=p.friction._replace(operators=friction.bundle([0.0], [slip or 1.0])))


def gathered(notes: Iterable[tuple[str, str]], count: int) -> list[str]:
    """Equal notes on several logs as one, with the names of these logs; `count` is the number of all logs."""
    by_words: dict[str, list[str]] = {}
    for name, words in notes:
        by_words.setdefault(words, []).append(name)
    return [f"{_named(list(dict.fromkeys(names)), count)}: {words}" for words, names in by_words.items()]


def _named(names: list[str], count: int) -> str:
    if len(names) == count > 2:
        return f"all {count} logs"
    shown = names if len(names) <= 3 else [*names[:2], f"{len(names) - 2} more"]
    return ", ".join(shown[:-1]) + (" and " if len(shown) > 1 else "") + shown[-1]


def _period(logs: list[RawLog]) -> tuple[float, list[str]]:
    """The sampling period (s) of all logs where no controller gives one: the longest, where they differ; and a note.

    Raises LogError where a log has a single row.
    """
    steps = {log.name: float(np.median(np.diff(log.time))) for log in logs if len(log.time) > 1}
    if len(steps) < len(logs):
        name = next(log.name for log in logs if log.name not in steps)
        raise LogError("short", (name,), f"{name} has one row; record longer")
    low, high = min(steps, key=lambda name: steps[name]), max(steps, key=lambda name: steps[name])
    if steps[high] <= (1.0 + SAME_PERIOD) * steps[low]:
        return steps[logs[0].name], []
    words = f"{low} was sampled every {duration(steps[low])}, {high} every {duration(steps[high])}"
    return steps[high], [f"{words}, and no controller.Ts gives the control period: the longest period is taken for all"]


def _gridded(log: RawLog, dt: float) -> GriddedLog:
    grid = on_control_periods(log.name, log.time, log.columns, dt)
    if not grid.exact and log.ours:
        words = f"{log.name}: the rows of this recording are not its control periods; record it again"
        raise LogError("period", (log.name,), words)
    return grid


def _file_notes(log: RawLog) -> list[str]:
    """Notes of the file's reader, without those on missing columns, which the session itself reports."""
    absent = tuple(WITHOUT.values())
    recording = log.recording
    lost = [f"{recording.lost_rows} rows were lost while it was recorded"] if recording.lost_rows else []
    cut = [] if recording.complete else [f"it is not complete: {recording.ended}"]
    strange = unknown_keys(log)
    return [*(note for note in recording.meta.get("notes", []) if note not in absent), *strange, *lost, *cut]


def _known_setpoints(repeats: list[Repeat], machine: NominalSetup, dt: float) -> list[Array | None]:
    """The setpoints of all `repeats`; those with the same reference and injection share them."""
    return once_for_each(lambda repeat: _setpoints(repeat, machine, dt), repeats, [*map(_setpoint_key, repeats)])


def _setpoint_key(repeat: Repeat) -> tuple[bytes, ...]:
    """What decides the setpoints of a log."""
    log, grid = repeat
    if log.setpoints is not None:
        return (log.name.encode(),)
    injection = grid.columns.get("injection", np.zeros(0))
    return (str(grid.rows).encode(), *(part.tobytes() for part in (*grid.reference, injection)))


def _finished(
    repeat: Repeat, known: Array | None, machine: NominalSetup, dt: float, held: bool
) -> tuple[Log, list[str]]:
    """A log of the session, and the notes on it; `held` where no command comes between two rows."""
    log, grid = repeat
    limit = min(machine.stage.drive.current_limit, machine.law.current_limit if machine.law else math.inf)
    valid, notes = row_validity.row_validity(grid.columns, dt, limit, machine.stage.encoder.step)
    columns = {name: row_validity.filled(column) for name, column in grid.columns.items()}
    finished = Log(
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
        valid=valid,
        setpoints=known,
        exact=grid.exact,
        held=held,
    )
    return finished._replace(carried=_carried(repeat, finished, machine)), [*grid.notes, *notes]


def _carried(repeat: Repeat, log: Log, machine: NominalSetup) -> float:
    """The current (A) under which the axis stands as one of our recordings begins; 0 where it is not known."""
    ours = repeat.log.setpoints is not None and log.exact and bool(log.valid[0])
    if not ours or machine.law is None or log.setpoints is None or log.command is None:
        return 0.0
    return carried(machine.law, log.setpoints, log.position, "command", log.command)


def _setpoints(repeat: Repeat, machine: NominalSetup, dt: float) -> Array | None:
    """As they were recorded, else as the deployed controller had them; None where they are not known."""
    log, grid = repeat
    if log.setpoints is not None:
        recorded = {str(j): column for j, column in enumerate(log.setpoints.T)}
        on_periods = on_control_periods(log.name, log.time, recorded, dt).columns.values()
        return np.stack([row_validity.filled(column)[: grid.rows] for column in on_periods], axis=1)
    if machine.deployed is None or len(grid.reference.time) < LEAST_SPLINE:
        return None
    injection = row_validity.filled(grid.columns["injection"]) if "injection" in grid.columns else None
    return deployed_setpoints.setpoints_of(machine.deployed, grid.reference, grid.rows, injection)


def undetermined(session: Session, started: Sequence[bool]) -> tuple[str, ...]:
    """A sentence for each thing that is missing; `started` holds for each log whether its session clock is known."""
    logs = session.logs
    current, command, reference = (
        _in_logs([log for log in logs if getattr(log, name) is None]) for name in ("current", "command", "reference")
    )
    without_force = any(log.command is None and log.current is None for log in logs)
    sentences = {
        f"no measured current{current}: effects of the drive (delay, gain, limits) cannot be separated from those of "
        "the mechanics, nor current_gain from force_constant": current,
        f"no command{command}: neither the controller nor the drive can be checked": command,
        f"no reference{reference}: the loop cannot be simulated, and its tracking error is not known": reference,
        "neither current nor command: no force is known, and so no effect of the mechanics": without_force,
        "no stage.encoder_step: effects of the encoder's steps cannot be separated from noise": (
            session.stage.encoder.step == 0.0
        ),
        "no deployed controller is known: the command cannot be recomputed, and the gap is that of the effort, not of "
        "the position": session.law is None,
        (once := _recorded_once([log for log in logs if not log.held_out])): once,
        "no capture is marked `use: held-out`: results are not checked on runs that they do not come from": (
            not any(log.held_out for log in logs)
        ),
        "the session clock (start_s) is not known: warming up and wear from run to run cannot be determined": (
            not all(started)
        ),
    }
    return tuple(sentence for sentence, missing in sentences.items() if missing)


def _in_logs(without: Sequence[Log]) -> str:
    """In which logs, in words; empty where in none."""
    names = [log.name for log in without]
    more = f" and {len(names) - 2} more" if len(names) > 2 else ""
    return f" in {', '.join(names[:2])}{more}" if names else ""


def _recorded_once(logs: Sequence[Log]) -> str:
    counted = Counter(log.experiment for log in logs)
    single = [name for name, count in counted.items() if count < 2]
    if single and len(single) == len(counted):
        return "each experiment was recorded once: there is no noise floor, so random variation is not known"
    return f"{', '.join(single)} was recorded once: its noise floor is that of the other experiments" if single else ""
