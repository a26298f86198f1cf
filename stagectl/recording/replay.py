"""Replay: the recorded feedback through the recorded law must give the recorded commands, bit for bit."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl.kernels import law, rollout
from stagectl.problem import ProblemKind
from stagectl.recording.hdf5 import Recording, RecordingError
from stagectl.recording.metadata import read_law


def recomputed(
    p: law.Law, setpoints: NDArray[np.float64], measured: NDArray[np.float64], held: float = 0.0
) -> NDArray[np.float64]:
    """The terms (n, 7) of `law.Output` that the law gives for setpoints (n, 8) and positions (n,).

    It begins at rest, with `held` (A) in its integral.
    """
    out, begins = np.zeros((len(measured), len(law.Output._fields))), law.carrying(law.AT_REST, held)
    rollout.answers(p, begins, (np.ascontiguousarray(setpoints), np.ascontiguousarray(measured), out))
    return out


def carried(
    p: law.Law, setpoints: NDArray[np.float64], measured: NDArray[np.float64], term: str, recorded: NDArray[np.float64]
) -> float:
    """What the law held the axis with (A) before the first row: the `recorded` term there, less that of a law at rest.

    `term` is its name in `law.Output`.
    """
    again = recomputed(p, setpoints[:1], measured[:1])[:, law.OUTPUT_COLUMNS[term]]
    return float(np.sum(recorded[:1] - again))


def check_ran(recording: Recording, what: str) -> None:
    """Raise RecordingError where a recording was imported: it holds no `what`."""
    if "law" not in recording.meta:
        words = "`run` and `simulate` record one; `identify` and `gap diagnose` take what was imported"
        reason = f"{recording.path} was imported: it holds no {what}; {words}"
        raise RecordingError(reason, recording.path, ProblemKind.MISSING)


def outputs(recording: Recording) -> NDArray[np.float64]:
    """What the law answers to the recorded setpoints and positions: (n, terms of law.Output).

    Raises RecordingError where rows are missing or the recording holds no law of ours.
    """
    check_ran(recording, "law to replay")
    if not {"cascade", "observer"} <= set(recording.meta["law"]):
        reason = f"{recording.path} was recorded by a version whose law was another: run it again"
        raise RecordingError(reason, recording.path, ProblemKind.CONFLICT)
    if recording.lost_rows:
        reason = f"{recording.path} has lost {recording.lost_rows} rows: the law's state cannot be followed"
        raise RecordingError(reason, recording.path, ProblemKind.MISSING)
    recording.filled("replay")
    setpoints = np.stack([recording.column(name) for name in law.Setpoint._fields], axis=1)
    running, measured = read_law(recording.meta["law"]), recording.column("measured")
    held = carried(running, setpoints, measured, "integral", recording.column("integral"))
    return recomputed(running, setpoints, measured, held)


def replay(recording: Recording) -> dict[str, Any]:
    """Compare; the result as JSON values."""
    again = outputs(recording)
    recorded = np.stack([recording.column(name) for name in law.Output._fields], axis=1)
    differs = np.flatnonzero(np.any(again != recorded, axis=1))
    cycles = len(recorded)
    words = f"{cycles} cycles replayed: every command is the same, bit for bit"
    if differs.size:
        first = int(differs[0])
        term = int(np.flatnonzero(again[first] != recorded[first])[0])
        words = (
            f"{differs.size} of {cycles} cycles differ, the first at {recording.samples['time'][first]:.6g} s in "
            f"{law.Output._fields[term]}: recorded {recorded[first][term]!r}, now {again[first][term]!r}; "
            f"recorded with kernels {recording.meta['versions']['kernels']}"
        )
    return {"identical": not differs.size, "cycles": cycles, "words": words}
