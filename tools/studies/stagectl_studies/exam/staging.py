"""A trial made ready: the user's folder, and the labels as one piece of bytes."""

import io
import json
import shutil
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stagectl_studies.exam.plan import ExamError, Planned
from stagectl_studies.exam.realised_closure import first
from stagectl_studies.machine.effects import Rig
from stagectl_studies.machine.machine import MAXWELL, Body, Floats, Law, Machine
from stagectl_studies.machine.plant import Setting, ideal, silent, simulated
from stagectl_studies.machine.stage_trial import stage_trial
from stagectl_studies.machine.trials import Options, Trial, draw

REDRAWN = 8  # times, where a trial cannot run
_STEP = 7919  # from the seed of a trial to that of its next draw
_EPOCH = (1980, 1, 1, 0, 0, 0)


def drawn(planned: Planned, short: bool) -> Trial:
    """The trial; of effects that no loop of this seed bears the next seed's.

    Raises ExamError where none of `REDRAWN` seeds bears them.
    """
    options = Options(planned.effects, planned.scale, law=planned.law, short=short, ground=planned.ground)
    for attempt in range(REDRAWN):
        try:
            return draw((planned.seed + attempt * _STEP) % 2**31, planned.drawn_as, options)
        except RuntimeError:
            continue
    raise ExamError(f"trial {planned.number}: no seed of {REDRAWN} gives a stable loop with {planned.effects}")


def staged(planned: Planned, folder: Path, short: bool) -> bytes:
    """Write `folder`/captures; the labels stay on disk nowhere.

    Raises ExamError where the trial cannot run.
    """
    trial = drawn(planned, short)
    try:
        stage_trial(trial, folder)
    except RuntimeError as error:
        raise ExamError(f"trial {planned.number}: {error}") from error
    sealed = folder / "sealed"
    answer = json.loads((sealed / "truth.json").read_text(encoding="utf-8"))
    with np.load(sealed / "truth.npz") as arrays:
        everything = {name: arrays[name] for name in arrays.files} | nominal(trial)
    shutil.rmtree(sealed)
    return packed({**answer, "stratum": planned.stratum, "exclude": list(planned.exclude)}, everything)


def nominal(trial: Trial) -> dict[str, Floats]:
    """What the user's model does in the held-out experiments, simulated by the exam's plant: ``nominal/FILE`` rad."""
    weight, slip = trial.model.weight, trial.model.slip
    law = Law(MAXWELL, weight / weight.sum(), 1.0 / slip)
    body = Body(trial.model.inertia, trial.model.viscous, float(weight.sum()), 0.0)
    rig = Rig(ideal(Machine(law, body)), trial.loop)
    held = [
        captured
        for captured in trial.captures
        if captured.experiment.use == "held-out" and captured.file == first(captured.file)
    ]
    columns = {}
    for capture in held:
        rows = trial.rows[capture.experiment.name]
        trace = simulated(rig.machine, rig.loop, rows, silent(rows.target.size), Setting(start=capture.start))
        columns[f"nominal/{capture.file}"] = trace.position
    return columns


def packed(truth: Mapping[str, Any], arrays: Mapping[str, Any]) -> bytes:
    """Truth and arrays as one zip, the same content the same bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=4) as file:
        _entry(file, "truth.json", json.dumps(truth).encode())
        for name, values in arrays.items():
            archive = io.BytesIO()
            np.save(archive, values)
            _entry(file, name, archive.getvalue())
    return buffer.getvalue()


def _entry(file: zipfile.ZipFile, name: str, content: bytes) -> None:
    info = zipfile.ZipInfo(name, _EPOCH)
    info.compress_type = zipfile.ZIP_DEFLATED
    file.writestr(info, content)


def unpacked(labels: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """Truth and arrays."""
    with zipfile.ZipFile(io.BytesIO(labels)) as file:
        answer = json.loads(file.read("truth.json"))
        arrays = {name: np.load(io.BytesIO(file.read(name))) for name in file.namelist() if name != "truth.json"}
    return answer, arrays
