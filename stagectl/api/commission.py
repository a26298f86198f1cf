"""`commission`: the guided way from a drive on the table to a compensated axis.

::

    probe --> accept --> identify --> tune --> compensate --> close --> compare
                            |           |                       |
                            +-----------+--- STAGE.yaml --------+     STAGE.versions/ keeps each earlier one

Each step is another function of this package, with its page; ``STAGE.commission.json`` lists what is done.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.api.arguments import ArgumentError, ProgressOption, Say, reported
from stagectl.api.comparison import compare, machine_of
from stagectl.api.gap_closing import close_gap
from stagectl.api.identification import identify
from stagectl.api.result import ReportedResult
from stagectl.api.stage import DesignedStage, load_stage
from stagectl.api.tuning import TunedGains, tune
from stagectl.config import stage_file
from stagectl.config.stage_file import Setup, lasting, on_channel, with_machine_of_the_day
from stagectl.gap.experiment_design.battery import battery
from stagectl.gap.experiment_design.experiment import yaml_of
from stagectl.gap.experiment_design.unseen import unseen
from stagectl.number_format import length
from stagectl.problem import Problem, ProblemKind
from stagectl.recording.hdf5 import open_recording
from stagectl.replacing import write_text
from stagectl.units import StageError
from stagectl.workflows import campaign, gap_closing, loop_trial, stage_versions
from stagectl.workflows.acceptance import page as acceptance_page
from stagectl.workflows.acceptance import protocol
from stagectl.workflows.acceptance.result import signed
from stagectl.workflows.closing_errors import REST
from stagectl.workflows.machine_of_the_day import drawn
from stagectl.workflows.motion import line_of
from stagectl.workflows.trials import Shown, TrialError, ready

SINES = ("sine-slow", "sine-medium", "sine-strong")  # what the plain model is identified from
REPEATS, ROUNDS = 2, 2  # of each comparison and experiment, and of closing: ten minutes of machine time in all


class Done(NamedTuple):
    """A step that is done."""

    words: str
    page: Path | None = None
    facts: Mapping[str, Any] = {}


class Step(NamedTuple):
    """A step, as a person is asked for it."""

    name: str
    title: str
    moves: bool
    run: Callable[[Commissioning], Done]


@dataclass
class Commissioning:
    """An axis on its way; the steps change its stage file."""

    path: Path
    simulated: bool
    person: str
    seed: int
    machine: int  # seed of a machine of the day; 0: none
    channel: str | None
    progress: ProgressOption
    say: Say
    go_ahead: Callable[[str, str], bool]  # name of a step, and what will happen: whether it may
    done: dict[str, Any] = field(default_factory=dict)  # what each step found, by its name

    @property
    def stage(self) -> DesignedStage:
        """The stage as it is now, on its machine."""
        return DesignedStage(self.running(load_stage(self.path, judged=False).setup))

    def running(self, setup: Setup) -> Setup:
        """A version of the stage as it runs on the machine."""
        if self.simulated:
            return setup
        return lasting(with_machine_of_the_day(on_channel(setup, self.channel), self.machine))

    @cached_property
    def plant(self) -> DesignedStage | None:
        """The machine of a simulation: the first version of the stage, or what is drawn around it."""
        if not self.simulated:
            return None
        setup = stage_file.load_stage(self.path, text=stage_versions.first(self.path))
        return DesignedStage(drawn(setup, self.machine)[0] if self.machine else setup)

    @property
    def where(self) -> dict[str, Any]:
        """The machine, as the other functions take it."""
        return {"simulate": self.simulated, "plant": self.plant, "progress": self.progress, "say": self.say}

    def folder(self, step: str) -> Path:
        """Where a step puts its recordings and its page."""
        return self.path.with_suffix(".commission") / step

    def shown(self) -> Shown:
        """How a workflow shows what it does."""
        return Shown(self.say, partial(reported, self.progress))

    def page(self, step: str, result: ReportedResult) -> Path:
        """Show a result; its page."""
        self.say(str(result))
        return result.save(self.folder(step) / f"{step}.html")

    def machine_time(self) -> float:
        """All motion of the machine so far (s); what was only foretold is none."""
        return moved(self.path.with_suffix(".commission"))


def moved(folder: Path) -> float:
    """Duration (s) of all recordings in a folder but those of runs that were simulated to foretell the machine's."""
    paths = (path for path in folder.rglob("*.h5") if gap_closing.FORETOLD not in path.relative_to(folder).parts)
    return sum(float(open_recording(path, only=("time",)).column("time")[-1]) for path in paths)


def _probe(p: Commissioning) -> Done:
    from stagectl.config.time_outs import axis_limits
    from stagectl.drives.canopen.probe import probe

    setup = p.stage.setup
    with line_of(setup, p.say) as (wire, line):
        answers = probe(wire, line, limits=axis_limits(setup.file))
    for name, words in answers.answers.items():
        p.say(f"  {name}: {words}")
    return Done("; ".join(answers.doubts) or "nothing needs attention", facts={"answers": answers.answers})


def _accept(p: Commissioning) -> Done:
    person = protocol.Signatory(p.person, lambda step, words: p.go_ahead(f"accept, {step.name}", words))
    result = protocol.accept(p.stage.setup, person, p.say)
    place = p.folder("accept") / time.strftime("acceptance-%Y%m%d-%H%M%S")
    _, page = acceptance_page.write_pages(result, signed(result), place)
    if not result.accepted:
        raise StageError(f"the drive is not accepted: see {page}; correct that, then run the same command")
    return Done("the drive stops by itself, the axis moves the right way", page)


def _identify(p: Commissioning) -> Done:
    place, stage = p.folder("identify"), p.stage
    machine = machine_of(stage, p.simulated, p.plant)
    experiments = campaign.chosen(battery(stage.setup), list(SINES), [])
    recorded = campaign.record(campaign.planned(machine, experiments, 1, place, p.seed), p.shown())
    if recorded["stopped"]:
        kind = ProblemKind.STOPPED if recorded["interrupted"] else ProblemKind.OTHER
        raise StageError(Problem(recorded["stopped"], kind))
    fit = identify(stage, sorted(place.glob("*.h5")), "simultaneous", progress=p.progress)
    page = p.page("identify", fit)
    _put(p, fit.apply(doubtful=not fit.implausible), page)
    return Done("inertia, viscous and rolling friction are those of the machine", page)


def _tune(p: Commissioning) -> Done:
    tuned, words = _faster(p, tune(p.stage))
    page = p.page("tune", tuned)
    _put(p, tuned.apply(), page)
    return Done(f"bandwidth {tuned.bandwidth:.3g} Hz{words}", page)


def _faster(p: Commissioning, calm: TunedGains) -> tuple[TunedGains, str]:
    """The gains that only the model's friction holds back, where they are better on the machine; words on the trial."""
    fast = tune(p.stage, at_rest=False)
    if fast.bandwidth <= calm.bandwidth:
        return calm, ""
    machine = machine_of(p.stage, p.simulated, p.plant)
    setups = {
        name: p.running(stage_file.load_stage(p.path, text=tuned.apply().text))
        for name, tuned in (("calm", calm), ("fast", fast))
    }
    try:
        rms = loop_trial.errors(machine, setups, (REPEATS, p.seed), p.shown(), p.folder("tune"))
    except TrialError as error:
        return calm, f"; {fast.bandwidth:.3g} Hz was tried and stopped: {error}"
    better, other = (fast, calm) if rms["fast"] < rms["calm"] else (calm, fast)
    low, high = (length(x, p.stage.setup.file.axis.travel_unit) for x in sorted(rms.values()))
    return better, f", error {low} rms; {other.bandwidth:.3g} Hz was tried as well: {high}"


def _compensate(p: Commissioning) -> Done:
    plain = ("off", "ptc", "ptc+friction") if "ptc" in p.stage.setup.layers else ("off", "friction")
    return _compared(p, "compensate", plain)


def _close(p: Commissioning) -> Done:
    closed = close_gap(p.stage, **p.where, rounds=ROUNDS, repeats=REPEATS, folder=p.folder("close"), seed=p.seed)
    page = p.page("close", closed)
    if closed.result["rounds"]:
        stage_versions.replaced(p.path, closed.model.read_text(encoding="utf-8"), [page])
    effects = {name: share for name, share in closed.result["shares"].items() if name != REST}
    return Done(closed.sheet().answer, page, {"effects": effects, "dropped": closed.result["dropped"]})


def _compare(p: Commissioning) -> Done:
    return _compared(p, "compare", ("off", "+".join(p.stage.setup.layers)))


def _compared(p: Commissioning, step: str, variants: tuple[str, ...]) -> Done:
    """The tracking error with more and more layers, on a motion that nothing is fitted to."""
    motion = unseen(p.stage.setup)[0]
    place = p.folder(step) / f"{motion.name}.yaml"
    write_text(place, yaml_of(motion))
    result = compare(p.stage, place, *variants, **p.where, repeats=REPEATS, seed=p.seed, folder=place.parent)
    page = p.page(step, result)
    peaks = {row["name"]: row["peak"]["mean"] for row in result.result["variants"]}
    first, last = (length(peaks[name], result.result["unit"]) for name in (variants[0], variants[-1]))
    return Done(f"peak error {first} with feedback alone, {last} with {variants[-1]}", page, {"peaks": peaks})


def _put(p: Commissioning, stage: DesignedStage, page: Path) -> None:
    stage_versions.replaced(p.path, stage.text, [page])
    for change in stage.changes:
        p.say(f"  {change}")


STEPS = (
    Step("probe", "read what the drive is", False, _probe),
    Step("accept", "try protection, polarity, limits and stops at low current", True, _accept),
    Step("identify", "three sines; inertia and friction go into the stage file", True, _identify),
    Step("tune", "gains from that model, tried where it is not sure, go into the stage file", True, _tune),
    Step("compensate", "the same motion with more and more of what is known", True, _compensate),
    Step("close", "record, diagnose, apply and compare what the model lacks", True, _close),
    Step("compare", "the same motion without and with all of it", True, _compare),
)
NAMES = tuple(step.name for step in STEPS)
_ON_A_DRIVE = ("probe", "accept")  # they have no meaning on a model


def commission(p: Commissioning, again: str = "") -> dict[str, Any]:
    """Do the steps that are not done yet, in their order, and those from `again` on once more; the state as JSON.

    Raises StageError where a step ends with a reason: what is done is kept, and the same command goes on; ArgumentError
    where there is no step `again`.
    """
    if again and again not in NAMES:
        raise ArgumentError("again", again, f"; must be one of {', '.join(NAMES)}")
    state = p.path.with_suffix(".commission.json")
    p.done = json.loads(state.read_text(encoding="utf-8"))["steps"] if state.exists() else {}
    for name in NAMES[NAMES.index(again) :] if again else ():
        p.done.pop(name, None)
    steps = [step for step in STEPS if not (p.simulated and step.name in _ON_A_DRIVE)]
    result: dict[str, Any] = {"stage": str(p.path), "steps": p.done}
    with ready(machine_of(p.stage, p.simulated, p.plant), p.shown()):
        for step in steps:
            if step.name in p.done:
                p.say(f"{step.name}: done before: {p.done[step.name]['words']}")
                continue
            _perform(p, step)
            write_text(state, json.dumps(result, indent=2) + "\n")
    return {**result, "machine_time": p.machine_time()}


def _perform(p: Commissioning, step: Step) -> None:
    moves = "; the axis moves" if step.moves else "; nothing moves"
    if not p.go_ahead(step.name, f"{step.title}{moves}"):
        raise StageError(f"{step.name} was not permitted; the same command goes on with it")
    found = step.run(p)
    p.say(f"{step.name}: {found.words}" + (f"; picture: {found.page}" if found.page else ""))
    p.done[step.name] = {**found._asdict(), "page": str(found.page or "")}
