"""The gap closed on the machine: record, diagnose, apply, compare; again until nothing shrinks.

::

    STAGE.yaml --> stage-0.yaml --> record --> diagnose --> stage-1.yaml --> compare on unseen motions --+
                                                  ^                                                      |
                                                  +----- it shrank: the same records, new model  <-------+
                                                  +----- else: without the effects that were found <-----+

The records are of the machine, whatever its model is: they are made once, with the controller of the first one.

A round is kept where the rms tracking error on the unseen motions shrinks, on the machine, by more than its repeats
vary, and neither the rms error of any of them nor the largest error of all grows by more than a tenth.  Each motion
counts alike, by the ratio of its errors.

At the end each effect is left out of the feedforward in turn: that gives its share, see `closing_errors`.  An effect
without which the error is smaller is dropped from the feedforward (`control.unanswered`); the model keeps it.
These runs are new ones.  A model that is no better than the first one in them was kept by chance: it goes, too.
"""

from pathlib import Path
from typing import NamedTuple

from stagectl.config.lengths import Lengths
from stagectl.config.machine_file import text_of
from stagectl.config.patch import patched
from stagectl.config.source import read_text
from stagectl.config.stage_file import Setup, lasting, load_stage
from stagectl.gap import diagnose as pipeline
from stagectl.gap.effects.library import EFFECTS, answered, coordinate_label, label
from stagectl.gap.experiment_design.battery import battery, held_out
from stagectl.gap.experiment_design.experiment import yaml_of
from stagectl.gap.experiment_design.unseen import judged, unseen
from stagectl.gap.logs import load_session
from stagectl.gap.logs.session import GapError
from stagectl.gap.result import result_json
from stagectl.gap.result.diagnosis import DiagnosisResult
from stagectl.gap.steps import in_percent
from stagectl.kernels.stage import Stage
from stagectl.number_format import length, percent
from stagectl.problem import Problem, ProblemKind
from stagectl.replacing import write_text
from stagectl.units import StageError
from stagectl.workflows import campaign as campaigns
from stagectl.workflows import closing_patch
from stagectl.workflows.closing_errors import AFTER, BEFORE, WITHOUT, Errors, foretold, level, refusal, shares, smaller
from stagectl.workflows.layer_comparison import compare
from stagectl.workflows.motion import Commanded, lay_out
from stagectl.workflows.trials import Machine, Result, Shown, ready

REPEATS = 3  # of each experiment and of each comparison; chosen: the least that shows how much chance varies them


Names = tuple[str, ...]
FORETOLD = "foretold"  # folder of the runs that are simulated next to the machine's: they take none of its time


class Closing(NamedTuple):
    """What is to be closed, and how."""

    machine: Machine
    folder: Path
    rounds: int  # at most
    seed: int
    repeats: int = REPEATS
    only: tuple[str, ...] = ()  # names of the experiments that are recorded; empty: all

    def version(self, number: int) -> Path:
        """The stage file after so many rounds."""
        return self.folder / f"stage-{number}.yaml"

    @property
    def records(self) -> Path:
        """The recordings that every round is diagnosed from."""
        return self.folder / "records"

    def setup(self, version: Path) -> Setup:
        """A version as it runs here: on the bus of the machine, with paths from the folder of its stage file."""
        machine = self.machine.setup
        setup = load_stage(machine.path, text=read_text(version))
        return setup.having(drive=setup.file.drive._replace(wire=machine.file.drive.wire))


class Round(NamedTuple):
    """One round: what was found, and what it was worth on the machine."""

    stage: Path  # with what was found, whether or not it was kept
    found: tuple[str, ...]
    where: str  # block of the loop and coordinate that hold most of it
    diagnosis: str  # its sentence
    foretold: float  # share of the squared gap that closes, in simulation
    errors: Errors  # by motion: `compare`'s variants by name
    kept: bool


def close(closing: Closing, shown: Shown) -> Result:
    """Close the gap; the result as JSON values.

    Raises StageError where a run is stopped or the machine cannot be diagnosed: what has been recorded is kept, and
    the same command goes on.
    """
    closing = closing._replace(machine=closing.machine._replace(setup=lasting(closing.machine.setup)))
    begun = closing.version(0)
    if not begun.exists():
        write_text(begun, text_of(closing.machine.setup.path))
    with ready(closing.machine, shown):  # one drive for all: a virtual one is the machine of the first model
        closing = _recorded(closing, closing.setup(begun), shown)
        rounds, ended = _rounds(closing, begun, shown)
        return _result(closing, [done for done in rounds if done.kept], ended, shown)


def _rounds(closing: Closing, begun: Path, shown: Shown) -> tuple[list[Round], str]:
    """All rounds from the version `begun` on, and why they ended."""
    rounds: list[Round] = []
    current, struck = begun, tuple[str, ...]()  # effects of models that were not kept
    while len(rounds) < closing.rounds:
        outcome = _round(closing, current, len(rounds) + 1, struck, shown)
        if isinstance(outcome, str):
            return rounds, f"without {', '.join(map(label, struck))}: {outcome}" if struck else outcome
        rounds.append(outcome)
        if outcome.kept:
            current = outcome.stage
            continue
        further = [name for name in outcome.found if not EFFECTS[name].nominal and name not in struck]
        if not further:
            return rounds, refusal(outcome.errors)
        struck = (*struck, *further)
    return rounds, refusal(rounds[-1].errors) or f"{closing.rounds} rounds were asked for"


def _round(closing: Closing, stage: Path, number: int, struck: Names, shown: Shown) -> Round | str:
    """One round from the model `stage`, `struck` effects left out; words instead where nothing more can be applied."""
    setup = closing.setup(stage)
    place = closing.folder / f"round-{number}"
    diagnosis, nominal = _diagnosed(closing, setup, place, struck, shown)
    found = diagnosis.result
    try:
        change = closing_patch.patch_of(diagnosis, nominal, closing.machine.setup.path, stage, shown.say)
    except StageError as error:
        return str(error)
    if not change.changes:
        return found.sentence.rstrip(".")
    target = closing.version(number)
    write_text(target, change.after)
    errors = _compared(closing, {BEFORE: setup, AFTER: closing.setup(target)}, place / "compared", shown)
    kept = not refusal(errors)
    before, after = (length(level(errors, name), setup.file.axis.travel_unit) for name in (BEFORE, AFTER))
    shown.say(
        f"round {number}: {found.sentence}  Tracking error on unseen motions: {before} -> {after} rms"
        f"{'' if kept else '; not kept'}"
    )
    names = tuple(effect.name for effect in found.named)
    return Round(target, names, _where(found), found.sentence.rstrip("."), found.gap.closure, errors, kept)


def _where(found: DiagnosisResult) -> str:
    """``mechanics 71 %, over the speed 55 %``; what could not be judged is left out."""
    blocks = [(share, name) for name, share in found.blocks.items() if share is not None]
    over = [(each.share, f"over the {coordinate_label(each.name)}") for each in found.coordinates]
    largest = [max(each, key=lambda pair: pair[0]) for each in (blocks, over) if each]
    return ", ".join(f"{name} {percent(share)}" for share, name in largest)


def _recorded(closing: Closing, setup: Setup, shown: Shown) -> Closing:
    """Record the session; what follows takes place at its end, on the axis as warm as it is then."""
    machine = closing.machine._replace(setup=setup)
    experiments = campaigns.chosen((*battery(setup), *held_out(setup)), [*closing.only], [])
    campaign = campaigns.planned(machine, experiments, closing.repeats, closing.records, closing.seed)
    result = campaigns.record(campaign, shown)
    if result["stopped"]:
        kind = ProblemKind.STOPPED if result["interrupted"] else ProblemKind.OTHER
        raise GapError(Problem(f"the recording was stopped: {result['stopped']}; the same command goes on", kind))
    end = result["runs"][-1]["start_s"] + campaign.runs[-1].experiment.duration
    return closing._replace(machine=closing.machine._replace(clock=end))


def _diagnosed(
    closing: Closing, setup: Setup, place: Path, struck: Names, shown: Shown
) -> tuple[pipeline.Diagnosis, Stage]:
    """What the records hold beyond the model of `setup`, and that model."""
    with shown.bar("diagnosis", 100) as update:
        session = load_session.load([closing.records], setup)
        found = pipeline.diagnose(session, pipeline.Options(struck, advice=False), in_percent(update))
        update(100, 100)
    result_json.save(found.result, place)
    return found, session.stage


def _compared(
    closing: Closing, setups: dict[str, Setup], place: Path, shown: Shown, left_out: tuple[str, ...] = ()
) -> Errors:
    """Peak and rms of each variant on each unseen motion; `left_out`: effects that the last set-up does without."""
    errors: Errors = {}
    for motion in unseen(closing.machine.setup):
        commanded = Commanded(f"{motion.name}.yaml", yaml_of(motion), motion.trajectory)
        folder = place / motion.name
        last = list(setups.values())[-1]
        variants = {name: (setup, frozenset[str]()) for name, setup in setups.items()}
        variants |= {f"{WITHOUT}{name}": (last, frozenset({name})) for name in left_out}
        motions = {}
        for name, (setup, out) in variants.items():
            laid = lay_out(setup, commanded, out, folder / "run.h5", clock=closing.machine.clock)
            motions[name] = laid._replace(meta={**laid.meta, "steady": judged(motion)})
        outcome = compare(closing.machine, motions, (closing.repeats, closing.seed), shown, folder)
        errors[motion.name] = {variant["name"]: variant for variant in outcome["variants"]}
    return errors


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
        "share_intervals": {},
        "dropped": [],
        "model": str(rounds[-1].stage if rounds else closing.version(0)),
    }
    if not rounds:
        return answer
    worth = _worth(closing, rounds, shown)
    if why := refusal(worth.errors):
        shown.say(f"new runs: {why}")
        return _result(closing, rounds[:-1], why, shown)
    errors = worth.errors
    gave = shares(worth.tried, tuple(name for name in worth.effects if name not in worth.dropped), worth.dropped)
    return {
        **answer,
        "dropped": worth.dropped,
        "model": str(worth.model),
        "errors": errors,
        "shares": {name: one.share for name, one in gave.items()},
        "share_intervals": {name: one.interval for name, one in gave.items()},
        "levels": {name: level(errors, name) for name in (BEFORE, AFTER)},
        "peaks": {name: level(errors, name, "peak") for name in (BEFORE, AFTER)},
        "foretold": _foretold(closing, worth.model, errors, shown),
    }


class Worth(NamedTuple):
    """What the last model is worth on the machine, in runs that did not decide about it."""

    effects: Names  # that its feedforward answers
    dropped: Names  # those without which the error is smaller
    model: Path  # without these
    tried: Errors  # of the model, and of itself without each effect
    errors: Errors  # of the one without those that are dropped


def _worth(closing: Closing, rounds: list[Round], shown: Shown) -> Worth:
    model, place = rounds[-1].stage, f"judged-{len(rounds)}"
    effects = tuple(dict.fromkeys(name for done in rounds for name in done.found if name in answered()))
    tried = _judged(closing, model, place, shown, effects)
    dropped = tuple(name for name in effects if smaller(tried, AFTER, f"{WITHOUT}{name}"))
    if not dropped:
        return Worth(effects, dropped, model, tried, tried)
    shown.say(f"left to the feedback, as the error is smaller without it: {', '.join(map(label, dropped))}")
    without = _unanswered(closing, model, dropped)
    return Worth(effects, dropped, without, tried, _judged(closing, without, f"{place}-again", shown, ()))


def _foretold(closing: Closing, model: Path, errors: Errors, shown: Shown) -> dict[str, float]:
    """What the last `model` says of the `errors` on the machine before they are measured: see `foretold`."""
    machine = closing.machine._replace(simulated=True, plant=closing.setup(model), elsewhere=None)
    simulated = closing._replace(machine=machine)
    return foretold(errors, _judged(simulated, model, FORETOLD, shown, ()))


def _judged(closing: Closing, model: Path, place: str, shown: Shown, effects: tuple[str, ...]) -> Errors:
    """The last `model` against the first one, and against itself without each effect."""
    setups = {BEFORE: closing.setup(closing.version(0)), AFTER: closing.setup(model)}
    return _compared(closing, setups, closing.folder / place, shown, effects)


def _unanswered(closing: Closing, model: Path, dropped: tuple[str, ...]) -> Path:
    """A version whose feedforward leaves out what these effects change."""
    setup = closing.setup(model)
    places = (*setup.file.control.unanswered, *(place for name in dropped for place in EFFECTS[name].places))
    axis = setup.file.axis
    change = patched(setup.text, {"control.unanswered": list(dict.fromkeys(places))}, Lengths(axis.kind, axis.lead))
    target = model.with_name(f"{model.stem}-dropped.yaml")
    write_text(target, change.text)
    return target
