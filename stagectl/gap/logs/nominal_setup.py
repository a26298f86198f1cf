"""The nominal setup behind a set of logs: axis, model and deployed controller."""

from pathlib import Path
from typing import Any, NamedTuple

from stagectl.config.stage_file import Setup, setup_of
from stagectl.gap.logs import deployed_controller, nominal_model
from stagectl.gap.logs.nominal_values import of_file
from stagectl.gap.logs.session import LogError
from stagectl.gap.logs.sources import RawLog
from stagectl.kernels import stage
from stagectl.kernels.law import Law
from stagectl.recording.metadata import read_law
from stagectl.recording.nominal_yaml import carried_stage, difference, nominal_of

_MODEL = (
    "nominal.yaml next to it, --stage or --model must give it: at least kind, force_constant and inertia, such as "
    "--model kind=rotary,force_constant=0.05,inertia=1e-4 (N m/A, kg m^2)"
)


_BLOCKS = ("stage", "friction", "drive", "controller", "effects")


class NominalSetup(NamedTuple):
    """Model and controller, with notes on them."""

    axis: dict[str, Any]
    stage: stage.Stage
    law: Law | None
    dt: float  # s, control period; 0: not known
    deployed: deployed_controller.DeployedController | None  # for setpoints that were not recorded
    nominal: dict[str, Any]
    notes: tuple[str, ...]


def nominal_setup(logs: list[RawLog], setup: Setup | None) -> NominalSetup:
    """Model and controller of `logs`, which must share them; the model of `setup` takes precedence.

    Raises LogError where they differ, or there is no model.
    """
    axis = _shared(logs, "axis")
    if setup is not None and setup.file.axis.kind != axis["kind"]:
        raise LogError(
            "axis",
            (logs[0].name,),
            f"{logs[0].name} is of a {axis['kind']} axis, {setup.path} is {setup.file.axis.kind}; give the stage that "
            "it was recorded on",
        )
    own = [log for log in logs if log.ours]
    if own and len(own) < len(logs):
        other = next(log for log in logs if not log.ours)
        words = f"{own[0].name} is a recording of stagectl, {other.name} is not: diagnose them separately"
        raise LogError("mixed", (own[0].name, other.name), words)
    return _of_ours(logs, axis, setup) if own else _of_others(logs, axis, setup)


def _shared(logs: list[RawLog], block: str) -> dict[str, Any]:
    """The `block` of metadata, which must be the same in all recordings."""
    first: dict[str, Any] = logs[0].recording.meta.get(block) or {}
    for log in logs[1:]:
        if differs := difference(first, log.recording.meta.get(block) or {}):
            where = f"{log.name} differs from {logs[0].name} in {block}.{differs}"
            words = f"{where}: they are not of one machine in one state; diagnose them separately"
            raise LogError("machine", (log.name, logs[0].name), words)
    return first


def _of_ours(logs: list[RawLog], axis: dict[str, Any], setup: Setup | None) -> NominalSetup:
    """Of our own recordings, which carry their stage file and their law."""
    first = logs[0].recording
    law = read_law(_shared(logs, "law"))
    texts = {log.recording.meta["files"]["stage"]["text"] for log in logs}
    if len(texts) > 1:
        raise LogError(
            "machine",
            tuple(log.name for log in logs),
            f"{logs[0].name} and others were recorded with different stage files, though with the same law: diagnose "
            "them separately",
        )
    place = Path(first.meta["files"]["stage"]["name"])
    used = setup or setup_of(place, carried_stage(first))
    notes = () if setup is None else (f"the model is that of {setup.path.name}, not the one in the recordings",)
    return NominalSetup(axis, used.stage, law, float(first.meta["dt"]), None, nominal_of(first), notes)


def _of_others(logs: list[RawLog], axis: dict[str, Any], setup: Setup | None) -> NominalSetup:
    """Of captures and logs from elsewhere, by their nominal.yaml."""
    values = _shared(logs, "nominal")
    place = logs[0].recording.path.parent / "nominal.yaml"
    if not place.is_file():  # a log that describes its machine itself, or none that does
        place = logs[0].recording.path
    file = of_file(values, place, axis["kind"])
    file.ignore_others(_BLOCKS)
    if values.get("effects"):
        file.notes.append(f"effects of {place.name} are not read: give the stage file that has them, with --stage")
    running = deployed_controller.read(file)
    if setup is None:
        if not values.get("stage"):
            raise LogError("model", (logs[0].name,), f"{logs[0].name} comes without a model of its machine; {_MODEL}")
        model = nominal_model.read(file)
    else:
        model = setup.stage
        if values:
            file.notes.append(f"the model is that of {setup.path.name}, not the one in {place.name}")
    if file.defaults:
        defaults = ", ".join(dict.fromkeys(file.defaults))
        file.notes.append(f"{place.name} does not give {defaults}: the values in brackets are taken")
    known = running.law if running else None
    notes = tuple(dict.fromkeys(file.notes))
    return NominalSetup(axis, model, known, running.dt if running else 0.0, running, values, notes)
