"""What is believed of the machine behind a set of logs: its axis, its model, its deployed controller."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from stagectl.config.stage_file import Setup, carried
from stagectl.gap.logs import deployed_controller, nominal_model
from stagectl.gap.logs.nominal_values import of_file
from stagectl.gap.logs.session import GapError
from stagectl.gap.logs.sources import Found
from stagectl.kernels import stage
from stagectl.kernels.law import Law
from stagectl.recording.metadata import read_law
from stagectl.recording.nominal_yaml import carried_stage, nominal_of

_MODEL = (
    "the folder's nominal.yaml or --stage must give the machine's model: at least stage.kind, stage.force_constant and "
    "stage.inertia"
)


class Believed(NamedTuple):
    """Model and controller, and what must be said of them."""

    axis: dict[str, Any]
    stage: stage.Stage
    law: Law | None
    dt: float  # s, control period; 0: not known
    deployed: deployed_controller.DeployedController | None  # for setpoints that are not recorded
    trusted: frozenset[str]
    nominal: dict[str, Any]
    notes: tuple[str, ...]


def believed(logs: list[Found], setup: Setup | None) -> Believed:
    """Model and controller of `logs`, which must share them; the model of `setup` goes first.

    Raises GapError where they differ, or there is no model.
    """
    axis = _shared(logs, "axis")
    if setup is not None and setup.file.axis.kind != axis["kind"]:
        raise GapError(
            f"{logs[0].name} is of a {axis['kind']} axis, {setup.path} is {setup.file.axis.kind}; give the stage that "
            "it was recorded on"
        )
    own = [log for log in logs if log.ours]
    if own and len(own) < len(logs):
        other = next(log for log in logs if not log.ours)
        raise GapError(f"{own[0].name} is a recording of ours, {other.name} is not: diagnose them apart")
    return _of_ours(logs, axis, setup) if own else _of_others(logs, axis, setup)


def _shared(logs: list[Found], what: str) -> dict[str, Any]:
    """What all recordings say alike of `what`."""
    first: dict[str, Any] = logs[0].recording.meta.get(what) or {}
    for log in logs[1:]:
        other: dict[str, Any] = log.recording.meta.get(what) or {}
        differs = next((key for key in {**first, **other} if first.get(key) != other.get(key)), None)
        if differs is not None:
            raise GapError(
                f"{log.name} has {what}.{differs} = {other.get(differs)}, {logs[0].name} has {first.get(differs)}: "
                "they are not of one machine in one state; diagnose them apart"
            )
    return first


def _of_ours(logs: list[Found], axis: dict[str, Any], setup: Setup | None) -> Believed:
    """Of our own recordings, which carry their stage file and their law."""
    first = logs[0].recording
    law = read_law(_shared(logs, "law"))
    texts = {log.recording.meta["files"]["stage"]["text"] for log in logs}
    if len(texts) > 1:
        raise GapError(
            f"{logs[0].name} and others were recorded with stage files that differ, though their law does not: "
            "diagnose them apart"
        )
    place = Path(first.meta["files"]["stage"]["name"])
    used = setup or carried(place, carried_stage(first))
    notes = [] if setup is None else [f"the model is that of {setup.path.name}, not the one that the recordings carry"]
    return Believed(axis, used.stage, law, float(first.meta["dt"]), None, frozenset(), nominal_of(first), tuple(notes))


def _of_others(logs: list[Found], axis: dict[str, Any], setup: Setup | None) -> Believed:
    """Of captures and logs from elsewhere, by their nominal.yaml."""
    values = _shared(logs, "nominal")
    place = logs[0].recording.path.parent / "nominal.yaml"
    if not place.is_file():  # a log that tells of its machine itself, or none that does
        place = logs[0].recording.path
    file = of_file(values, place, axis["kind"])
    running = deployed_controller.read(file)
    trusted: frozenset[str] = frozenset()
    if setup is None:
        if not values.get("stage"):
            raise GapError(f"{logs[0].name} comes without a model; {_MODEL}")
        model, trusted = nominal_model.read(file)
    else:
        model = setup.stage
        if values:
            file.notes.append(f"the model is that of {setup.path.name}, not the one in {place.name}")
    if file.said:
        file.notes.append(
            f"{place.name} does not give {', '.join(dict.fromkeys(file.said))}: the values in brackets are taken"
        )
    known = running.law if running else None
    return Believed(axis, model, known, running.dt if running else 0.0, running, trusted, values, tuple(file.notes))
