"""The gap closed on the machine: record, diagnose, apply, compare; again until nothing shrinks.

::

    STAGE.yaml --> stage-0.yaml --> record --> diagnose --> stage-1.yaml --> compare on unseen motions --+
                        ^                                                                                |
                        +------------------------------ the error shrank: again <------------------------+

A round is kept where the rms tracking error on the unseen motions shrinks, on the machine, by more than its repeats
vary.  At the end each effect is left out of the feedforward in turn: what the error then grows by is its worth.
"""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl import paired_comparison
from stagectl.config.stage_file import Setup, load_stage
from stagectl.gap import diagnose as pipeline
from stagectl.gap.effects.library import answered
from stagectl.gap.experiment_design.battery import battery, held_out
from stagectl.gap.experiment_design.experiment import yaml_of
from stagectl.gap.experiment_design.unseen import unseen
from stagectl.gap.logs import load_session
from stagectl.gap.logs.session import GapError
from stagectl.gap.result import patch, result_json
from stagectl.gap.result.diagnosis import DiagnosisResult
from stagectl.gap.steps import in_percent
from stagectl.number_format import length
from stagectl.workflows import campaign as campaigns
from stagectl.workflows.layer_comparison import compare
from stagectl.workflows.motion import Commanded, lay_out
from stagectl.workflows.trials import Machine, Result, Shown

BEFORE, AFTER = "before", "after"
REPEATS = 3  # of each experiment and of each comparison; chosen: the least that shows how much chance varies them
_WITHOUT = "without "


class Closing(NamedTuple):
    """What is to be closed, and how."""

    machine: Machine
    folder: Path
    rounds: int  # at most
    seed: int


class Round(NamedTuple):
    """One round: what was found, and what it was worth on the machine."""

    stage: Path  # with what was found, whether or not it was kept
    found: tuple[str, ...]
    diagnosis: str  # its sentence
    foretold: float  # share of the squared gap that closes, in simulation
    errors: dict[str, dict[str, Result]]  # by motion: `compare`'s variants by name
    kept: bool


def close(closing: Closing, shown: Shown) -> Result:
    """Close the gap; the result as JSON values.

    Raises StageError where a run is stopped or the machine cannot be diagnosed: what has been recorded is kept, and
    the same command goes on.
    """
    closing.folder.mkdir(parents=True, exist_ok=True)
    begun = _version(closing.folder, 0)
    if not begun.exists():
        shutil.copy2(closing.machine.setup.path, begun)
    rounds: list[Round] = []
    ended = f"{closing.rounds} rounds were asked for"
    while len(rounds) < closing.rounds:
        current = rounds[-1].stage if rounds else begun
        outcome = _round(closing, current, len(rounds) + 1, shown)
        if isinstance(outcome, str):
            ended = outcome
            break
        rounds.append(outcome)
        if not outcome.kept:
            ended = "the last model made the error no smaller on the machine: it is not kept"
            break
    return _result(closing, [done for done in rounds if done.kept], ended, shown)


def _version(folder: Path, number: int) -> Path:
    return folder / f"stage-{number}.yaml"


def _round(closing: Closing, stage: Path, number: int, shown: Shown) -> Round | str:
    """One round from the model `stage`; words instead where there is nothing more to apply."""
    setup = load_stage(stage)
    place = closing.folder / f"round-{number}"
    _recorded(closing, setup, place, shown)
    found = _diagnosed(place, shown)
    if not found.named:
        return found.sentence.rstrip(".")
    try:
        change = patch.patch_of(found, stage)
    except patch.PatchError as error:
        return str(error)
    if not change.changes:
        return "the model says all of it already"
    target = _version(closing.folder, number)
    target.unlink(missing_ok=True)
    patch.applied(change, target)
    errors = _compared(closing, {BEFORE: setup, AFTER: load_stage(target)}, place / "compared", shown)
    kept = _smaller(errors)
    before, after = (length(_level(errors, name), setup.file.axis.travel_unit) for name in (BEFORE, AFTER))
    shown.say(
        f"round {number}: {found.sentence}  Tracking error on unseen motions: {before} -> {after} rms"
        f"{'' if kept else '; not kept'}"
    )
    names = tuple(effect.name for effect in found.named)
    return Round(target, names, found.sentence.rstrip("."), found.gap.closure, errors, kept)


def _recorded(closing: Closing, setup: Setup, place: Path, shown: Shown) -> None:
    machine = closing.machine._replace(setup=setup)
    experiments = campaigns.chosen((*battery(setup), *held_out(setup)), [], [])
    result = campaigns.record(campaigns.planned(machine, experiments, REPEATS, place, closing.seed), shown)
    if result["stopped"]:
        raise GapError(f"the recording was stopped: {result['stopped']}; the same command goes on")


def _diagnosed(place: Path, shown: Shown) -> DiagnosisResult:
    with shown.bar("diagnosis", 100) as update:
        found = pipeline.diagnose(load_session.load([place]), pipeline.Options(advice=False), in_percent(update)).result
        update(100, 100)
    result_json.save(found, place)
    return found


def _compared(
    closing: Closing, setups: dict[str, Setup], place: Path, shown: Shown, left_out: tuple[str, ...] = ()
) -> dict[str, dict[str, Result]]:
    """Peak and rms of each variant on each unseen motion; `left_out`: effects that the last set-up does without."""
    errors: dict[str, dict[str, Result]] = {}
    for motion in unseen(closing.machine.setup):
        commanded = Commanded(f"{motion.name}.yaml", yaml_of(motion), motion.trajectory)
        folder = place / motion.name
        folder.mkdir(parents=True, exist_ok=True)
        last = list(setups.values())[-1]
        variants = {name: lay_out(setup, commanded, frozenset(), folder / "run.h5") for name, setup in setups.items()}
        variants |= {
            f"{_WITHOUT}{name}": lay_out(last, commanded, frozenset({name}), folder / "run.h5") for name in left_out
        }
        outcome = compare(closing.machine, variants, (REPEATS, closing.seed), shown, folder)
        errors[motion.name] = {variant["name"]: variant for variant in outcome["variants"]}
    return errors


def _smaller(errors: dict[str, dict[str, Result]]) -> bool:
    """Whether the error after is smaller, by more than the repeats vary where they vary."""
    figures = [paired_comparison.Figures(name, *2 * (_each(errors, name),)) for name in (BEFORE, AFTER)]
    (change,) = paired_comparison.differences(figures, figures[0], "rms")
    return change.mean > 0.0 and (change.certain or math.isnan(change.adjusted))


def _each(errors: dict[str, dict[str, Result]], variant: str) -> NDArray[np.float64]:
    """Root of the mean square tracking error (m | rad) over all motions, of each repeat."""
    rms = np.array([motion[variant]["rms"]["values"] for motion in errors.values()])
    each: NDArray[np.float64] = np.sqrt(np.mean(rms**2, axis=0))
    return each


def _level(errors: dict[str, dict[str, Result]], variant: str) -> float:
    """The same over all repeats."""
    return float(np.sqrt(np.mean(_each(errors, variant) ** 2)))


def _result(closing: Closing, rounds: list[Round], ended: str, shown: Shown) -> Result:
    setup = closing.machine.setup
    answer: Result = {
        "stage": setup.file.name,
        "unit": setup.file.axis.travel_unit,
        "folder": str(closing.folder),
        "ended": ended,
        "rounds": [{**done._asdict(), "stage": str(done.stage)} for done in rounds],
        "simulated": closing.machine.simulated,
        "errors": {},
        "shares": {},
        "model": str(rounds[-1].stage if rounds else _version(closing.folder, 0)),
    }
    if not rounds:
        return answer
    final = load_stage(rounds[-1].stage)
    effects = tuple(dict.fromkeys(name for done in rounds for name in done.found if name in answered()))
    setups = {BEFORE: load_stage(_version(closing.folder, 0)), AFTER: final}
    errors = _compared(closing, setups, closing.folder / "judged", shown, effects)
    levels = {name: _level(errors, name) for name in next(iter(errors.values()))}
    return {**answer, "errors": errors, "shares": _shares(levels, effects), "levels": levels}


def _shares(levels: dict[str, float], effects: tuple[str, ...]) -> dict[str, float]:
    """What the squared error grows by without each effect, over what all that was found takes from it."""
    after = levels[AFTER] ** 2
    gained = levels[BEFORE] ** 2 - after
    if gained <= 0.0:
        return {}
    return {name: (levels[f"{_WITHOUT}{name}"] ** 2 - after) / gained for name in effects}
