"""`diagnose`: where the gap between model and machine lies, which effect causes it, and how far it shrinks."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from stagectl.api.arguments import ArgumentError, PathLike, ProgressOption, paths_of, reported
from stagectl.api.checked import checked
from stagectl.api.record import named_columns
from stagectl.api.result import ReportedResult, Sheet, drawn, frame
from stagectl.api.stage import DesignedStage, StageLike, as_stage
from stagectl.extras import require
from stagectl.gap import diagnose as pipeline
from stagectl.gap.effects.library import UnknownEffectError, excluded
from stagectl.gap.logs import load_session
from stagectl.gap.logs.nominal_model import STAGE_KEYS, STAGE_WORDS
from stagectl.gap.logs.nominal_values import quantity
from stagectl.gap.logs.session import LogError, Session
from stagectl.gap.logs.sources import Description
from stagectl.gap.logs.unit_check import check_units, inertia_doubt
from stagectl.gap.result import patch, result_json
from stagectl.gap.result.diagnosis import Coordinate, DiagnosisResult, FoundEffect, Gap, NextExperiment, Spans
from stagectl.gap.steps import in_percent
from stagectl.kernels.stage import Mechanics, Motor
from stagectl.problem import meant
from stagectl.units import LINEAR, ROTARY, StageError, parse

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stagectl.config.stage_file import Setup
    from stagectl.kernels.stage import Stage
    from stagectl.report.page import Page

_KINDS = (ROTARY, LINEAR, "ball-screw")  # of a model; the last is rotary, with travel_per_unit_mm
DiagnosisFigure = Literal["shares", "coordinates", "spans", "run"]


class GapLocation(NamedTuple):
    """Where the gap is: in the loop (`blocks`), over the motion (`coordinates`), and in time (`spans`)."""

    blocks: dict[str, float | None]  # share of controller, drive, mechanics and sensor; None: not judged
    coordinates: tuple[Coordinate, ...]  # what it follows: speed, position, ...
    spans: tuple[Spans, ...]  # when it is open, in each log


@dataclass(frozen=True, repr=False, eq=False)
class GapDiagnosis(ReportedResult):
    """The verdict, what it rests on, and the model that it leads to."""

    place: Path
    diagnosis: DiagnosisResult
    session: Session
    improved: Stage  # the nominal model with all that was found
    stage: Path = Path("STAGE.yaml")  # the file of the nominal model, where the user named one

    @property
    def verdict(self) -> str:
        """One of none, parameters, effects, effects+unknown, unknown, controller, not-identifiable."""
        return self.diagnosis.verdict

    @property
    def sentence(self) -> str:
        """The verdict in words, with the gap before and after."""
        return self.diagnosis.sentence

    @property
    def effects(self) -> tuple[FoundEffect, ...]:
        """Effects and shifted parameters, with probability, share and values; `named` are those that count."""
        return self.diagnosis.effects

    @property
    def named(self) -> tuple[FoundEffect, ...]:
        """The effects that count as found."""
        return self.diagnosis.named

    @property
    def where(self) -> GapLocation:
        """Where the gap is: in the loop, over the motion, and in time."""
        return GapLocation(self.diagnosis.blocks, self.diagnosis.coordinates, self.diagnosis.captures)

    @property
    def gap(self) -> Gap:
        """How far it shrinks: the gap on held-out runs, before and after, with its noise floor."""
        return self.diagnosis.gap

    @property
    def next_experiment(self) -> NextExperiment | None:
        """The experiment that separates what is ambiguous; its `text` is a trajectory file."""
        return self.diagnosis.next_experiment

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the logs, and what they cannot show."""
        return (*self.diagnosis.doubts, *self.diagnosis.notes, *self.diagnosis.cannot_tell)

    def to_json(self) -> dict[str, Any]:
        """Everything as JSON values."""
        return result_json.as_json(self.diagnosis)

    def to_arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """Name, probability and share of each effect, all (n,)."""
        return {
            name: np.array([getattr(effect, name) for effect in self.effects])
            for name in ("name", "probability", "share")
        }

    def to_frame(self) -> Any:
        """One parameter of an effect a row."""
        rows = [(effect, name, value) for effect in self.effects for name, value in effect.parameters.items()]
        columns: dict[str, list[Any]] = {
            "effect": [effect.name for effect, _, _ in rows],
            "probability": [effect.probability for effect, _, _ in rows],
            "share": [effect.share for effect, _, _ in rows],
            "parameter": [name for _, name, _ in rows],
        }
        columns |= {part: [getattr(value, part) for _, _, value in rows] for part in ("value", "low", "high", "unit")}
        return frame(columns, {"share": "of the closable gap"})

    def sheet(self) -> Sheet:
        """The sentence, the effects with their values, and the gap before and after."""
        from stagectl.gap.result import remarks_text
        from stagectl.report.tables.gap import tables

        return Sheet(self.verdict, self.sentence, tables(self.diagnosis), remarks_text.lines(self.diagnosis))

    def plot(self, what: DiagnosisFigure = "shares") -> Figure:
        """Shares of the squared gap, what it follows, when it is open, or the held-out run that shows most.

        Raises ArgumentError where the diagnosis holds nothing of the kind.
        """
        require("report", "plot")
        from stagectl.report.gap.figures import drawings

        return drawn(drawings(self.diagnosis), what)

    def page(self, command: str = "", folder: PathLike | None = None) -> Page:
        """The page with all figures; `folder` holds the stored answer, where that is not the folder of the logs."""
        from stagectl.report.gap.page import page

        others = 0 if self.place.is_dir() else len(self.session.logs) - 1
        logs = f"{self.place} and {others} more" if others else str(self.place)
        return page(self.diagnosis, logs, [command] if command else [], str(folder or self.place), str(self.stage))

    @checked
    def patch(self, stage: StageLike, *, only: Sequence[str] = (), unknown: bool = False) -> patch.Patch:
        """The change of the stage file, with its `diff` and why each line changes; nothing is written.

        `only` takes these effects, named or not; `unknown` adds what has no name as a data-based term.
        Raises GapError where there is nothing to write.
        """
        target = as_stage(stage)
        return patch.patch_of(self.diagnosis, target.path, only, unknown, target.text)

    @checked
    def apply(self, stage: StageLike, *, only: Sequence[str] = (), unknown: bool = False) -> DesignedStage:
        """The stage with what was found, in memory; see `patch`.

        Raises GapError where there is nothing to apply, ConfigError or DesignError where the result would be refused.
        """
        target = as_stage(stage)
        return target.changed(self.patch(target, only=only, unknown=unknown).values)

    def save_predictions(self, folder: PathLike) -> None:
        """Write a CSV for each held-out capture, from the improved model."""
        from stagectl.gap.validation.rollouts import write_predictions

        write_predictions(self.session, self.improved, Path(folder))


@checked
def diagnose(
    session: PathLike | Sequence[PathLike],
    *,
    stage: StageLike | None = None,
    columns: Mapping[str, str] | str | None = None,
    model: Mapping[str, float | str] | PathLike | None = None,
    exclude: Iterable[str] = (),
    full: bool = False,
    advice: bool = True,
    doubtful: bool = False,
    progress: ProgressOption = False,
) -> GapDiagnosis:
    """Say where the gap between model and machine lies, which effect causes it, and how far it shrinks.

    `session` is a folder of recordings or captures, or one or several logs.  `stage` is the model, if the logs contain
    none.  Instead of a stage file, `model` takes the block ``stage`` of a ``nominal.yaml``: kind, force_constant,
    inertia, ... (SI), or a MuJoCo model: ``FILE.xml``, ``FILE.xml#JOINT``.  `columns` names the columns of logs,
    see `load_log`.  `exclude` names effects that must not be candidates; `full` takes a larger null ensemble; without
    `advice` no next experiment is sought.  `doubtful` diagnoses logs that fit the model only in another unit or with
    the other sign.

    Raises GapError where the logs cannot be diagnosed, RecordingError where they cannot be read.
    """
    if stage is not None and model is not None:
        raise ArgumentError("model", "", "and stage both give the model: leave one of them out")
    places = paths_of(session)
    options = pipeline.Options(_excluded(exclude), full, advice)
    said = _described(named_columns(columns), model)
    setup = None if stage is None else as_stage(stage, judged=False).setup
    logs = load_session.load(places, setup, said)
    if not doubtful:
        _check(logs, model, setup)
    with reported(progress, "diagnosis", 100) as update:
        outcome = pipeline.diagnose(logs, options, in_percent(update))
        update(100, 100)
    answer = GapDiagnosis(places[0], outcome.result, logs, outcome.improved)
    return answer if setup is None else replace(answer, stage=setup.path)


def _excluded(words: Iterable[str]) -> tuple[str, ...]:
    try:
        return excluded(list(words))
    except UnknownEffectError as error:
        raise ArgumentError("exclude", error.value, error.reason) from error


def _check(logs: Session, model: Mapping[str, float | str] | PathLike | None, setup: Setup | None) -> None:
    """Raises LogError, or ArgumentError about `model`, where logs or inertia cannot be in the units that they say."""
    check_units(logs)
    if not (doubt := inertia_doubt(logs)):
        return
    if setup is None and isinstance(model, Mapping):
        raise ArgumentError("model", "inertia", doubt)
    place = "inertia of the nominal model" if setup is None else f"mechanics.inertia of {setup.path}"
    raise LogError("model", tuple(log.name for log in logs.logs), f"{place}{doubt}")


def _check_model(model: Mapping[str, float | str]) -> None:
    """Raises ArgumentError for a name that is not known or missing, and for a text where a number in SI belongs."""
    for name, value in model.items():
        if name not in STAGE_KEYS:
            raise ArgumentError("model", name, f" is not known: {meant(name, STAGE_KEYS)}")
        if isinstance(value, str) and name not in STAGE_WORDS:
            reason = f"; must be a number in SI, without its unit{_in_si(name, value, str(model.get('kind')))}"
            raise ArgumentError("model", f"{name} = {value}", reason)
    kind = model.get("kind", ROTARY)
    if kind not in _KINDS:
        raise ArgumentError("model", f"kind = {kind}", f"; must be one of {', '.join(_KINDS)}")
    missing = next((name for name in ("kind", "force_constant", "inertia") if model and name not in model), None)
    if missing:
        raise ArgumentError("model", missing, " is missing; must have kind, force_constant and inertia (SI)")


def _in_si(name: str, value: str, kind: str) -> str:
    """The number to write for a text with a unit."""
    owner = next((owner for owner in (Motor, Mechanics) if name in owner._fields), None)
    with contextlib.suppress(StageError):
        return f": write {name}={parse(value, quantity(owner, name).unit_for(kind)):g}" if owner else ""
    return ""


def _described(columns: Mapping[str, str] | None, model: Mapping[str, float | str] | PathLike | None) -> Description:
    """What the user says of the logs; a path is that of a MuJoCo model."""
    if model is None or isinstance(model, Mapping):
        _check_model(model or {})
        return Description(columns, model)
    require("mujoco", "a MuJoCo model as the nominal one")
    from stagectl.interchange.mujoco_nominal import nominal

    read = nominal(str(model))
    others = {name: block for name, block in read.blocks.items() if name != "stage"}
    return Description(columns, read.blocks["stage"], others, read.notes)
