"""The steps in their order, each with a person's go-ahead; nothing moves after the first one that fails."""

import hashlib
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from stagectl.config.stage_file import Setup, canopen
from stagectl.recording.metadata import versions
from stagectl.units import StageError
from stagectl.workflows.acceptance import steps
from stagectl.workflows.acceptance.limits import LONGEST_NAME
from stagectl.workflows.acceptance.result import Acceptance, Outcome, StepResult
from stagectl.workflows.acceptance.workbench import Found, StepError, Workbench
from stagectl.workflows.motion import Say, drive_present


class Step(NamedTuple):
    """One step, as a person is asked for it."""

    name: str
    title: str
    moves: bool  # under power
    run: Callable[[Workbench], Found]


STEPS = (
    Step("identity", "the drive is the one that EDS and stage file are for", False, steps.identity),
    Step("protection", "the drive notices a lost controller, and then stops", False, steps.protection),
    Step("polarity", "a small current moves the axis the right way", True, steps.polarity),
    Step("current-limit", "no more current flows than the limit", True, steps.current_limit),
    Step("kill", "kill -9 of the real-time process: the drive stops by itself", True, steps.killed),
    Step("silence", "silence on the bus: the drive stops by itself", True, steps.silent),
    Step("quick-stop", "the drive's quick stop", True, steps.quick_stop),
    Step("travel", "the loop stops at the limits of the travel", True, steps.travel_limits),
)

GoAhead = Callable[[Step, str], bool]  # the step, and what will happen: whether it may


class Signatory(NamedTuple):
    """Who lets the steps happen."""

    name: str
    go_ahead: GoAhead


def accept(setup: Setup, person: Signatory, say: Say, current: float | None = None) -> Acceptance:
    """Try the drive of the stage step by step; `current` (A) is the largest of all tests.

    A step that fails is a result, not an exception; those after it are skipped.  Raises DriveError where the stage has
    no CANopen drive, its bus is not there or its axis cannot be tried like this, and StageError without a name.
    """
    name = " ".join(person.name.split())
    if not name or len(name) > LONGEST_NAME or not name.isprintable():
        raise StageError(
            f"--person {person.name!r}; must be a name with 1 to {LONGEST_NAME} characters, as in "
            '--person "A. Turing": the page is signed'
        )
    wire = canopen(setup)
    bench = Workbench.of(setup, current)
    with drive_present(setup, say):
        steps = _performed(bench, person, say)
    file = setup.path.with_name(setup.path.name.split("#")[0])
    return Acceptance(
        stage=setup.file.name,
        stage_file=str(setup.path),
        stage_sha256=_hash(file),
        eds_sha256=_hash(Path(wire.eds)),
        person=name,
        date=datetime.now().astimezone().isoformat(timespec="seconds"),
        virtual=virtual(setup),
        unit=setup.file.axis.travel_unit,
        drive=bench.drive,
        software=versions(),
        steps=steps,
    )


def virtual(setup: Setup) -> bool:
    """Whether the drive is a program on this computer: nothing can be hurt, and nobody need stand by."""
    return canopen(setup).interface == "embedded"


def _performed(bench: Workbench, person: Signatory, say: Say) -> tuple[StepResult, ...]:
    results: list[StepResult] = []
    ended = ""
    for step in STEPS:
        if not ended and not person.go_ahead(step, _announced(bench, step)):
            ended = f"{step.name} was not permitted"
        result = StepResult(step.name, step.title, Outcome.SKIPPED, ended) if ended else _done(bench, step)
        if result.outcome is Outcome.FAILED:
            ended = f"{step.name} failed"
        say(f"{result.outcome.value}: {step.name}: {result.words}")
        results.append(result)
    return tuple(results)


def _done(bench: Workbench, step: Step) -> StepResult:
    bench.traces.clear()
    try:
        found = step.run(bench)
    except StepError as error:
        found = error.found
    except (StageError, OSError) as error:  # the drive refused, or the bus failed
        found = Found(Outcome.FAILED, str(error))
    return StepResult(step.name, step.title, *found, traces=tuple(bench.traces))


def _announced(bench: Workbench, step: Step) -> str:
    if not step.moves:
        return f"{step.title}: no power, nothing moves"
    return (
        f"{step.title}: POWER ON, at most {bench.current:.3g} A; the axis moves up to {bench.words(bench.window)} from"
        " where it stands. Keep that free, and a hand on the emergency stop"
    )


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
