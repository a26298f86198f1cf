"""On a poor battery a diagnosis gets what it asks for, and answers again.

::

    answer -> sealed -> next experiment? -> `gap next --samples` -> running.py -> captures -> answer-1 -> sealed -> ...

It ends after `ROUNDS`, or where nothing is asked for that a motion can do.  All answers are sealed before the labels
are opened.  Each is judged as on a full battery: what the sines alone leave alike is told apart by what was asked for.
"""

import shutil
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from stagectl_studies.exam import scoring
from stagectl_studies.exam.extra_captures import RefusedError, Wanted, ran, read
from stagectl_studies.exam.plan import Planned
from stagectl_studies.exam.question import ANSWER, CAPTURES, Manner, Place, asked, diagnosed
from stagectl_studies.exam.sealing import Seal
from stagectl_studies.exam.staging import drawn

ROUNDS = 2
STRATA = ("poor",)  # whose diagnosis may ask
EXPERIMENT = "experiment"

Record = dict[str, Any]


class Round(NamedTuple):
    """An answer, and the experiment that was run for it."""

    experiment: str  # empty: none yet
    out: str  # where the answer lies, below the trial's folder
    failure: str  # why there is none, empty where there is


class Said(NamedTuple):
    """All answers of a trial."""

    rounds: tuple[Round, ...]
    refused: str = ""  # why what the last one asked for was not run; empty where it was, or nothing was asked for
    beside: str | None = None  # why the baselines failed, empty where they did not; None: they were not asked


def held(place: Place, planned: Planned, manner: Manner, seal: Seal) -> Said:
    """The rounds after the first answer; each answer is sealed when it is in."""
    trial = drawn(planned, manner.short)
    rounds: list[Round] = []
    for number in range(1, ROUNDS + 1):
        try:
            wanted = asked_for(place, manner, number)
            if wanted is None:
                break
            trial = ran(trial, wanted, place.folder / CAPTURES)
        except RefusedError as error:
            return Said(tuple(rounds), f"experiment {number} was not run: {error}")
        place = place._replace(out=f"{ANSWER}-{number}")
        failure = diagnosed(place, planned, manner)
        seal.answered(place.folder / place.out)
        rounds.append(Round(wanted.name, place.out, failure))
        if failure:
            break
    return Said(tuple(rounds))


def asked_for(place: Place, manner: Manner, number: int) -> Wanted | None:
    """The experiment of the answer in `place`, row by row; None where there is none that a motion can do.

    Raises RefusedError where the proposal cannot be laid out.
    """
    answer = place.folder / place.out / "answer.json"
    name = proposed(scoring.read(answer) or {})
    if not name:
        return None
    there = place._replace(out=f"{EXPERIMENT}-{number}")
    folder = there.folder / there.out
    folder.mkdir()
    copy, rows = shutil.copy(answer, folder), folder / "samples.csv"
    words = ["gap", "next", str(copy), "-o", str(folder / "trajectory.yaml"), "--samples", str(rows)]
    failure = asked(there, manner.module, words, manner)
    if failure:
        raise RefusedError(f"{name}: {failure}")
    return read(name, rows)


def proposed(answer: Mapping[str, Any]) -> str:
    """Name of the proposed experiment; empty where there is none, or where it is to be done by hand."""
    following = answer.get("next_experiment") or {}
    return str(following["name"]) if following.get("trajectory") else ""


def scored(labels: bytes, place: Place, rounds: Sequence[Round]) -> list[Record]:
    """Each answer by the same rules, the first one among them."""
    return [_scored(labels, place, answered) for answered in rounds]


def _scored(labels: bytes, place: Place, answered: Round) -> Record:
    folder = place.folder / answered.out
    answer = None if answered.failure else scoring.read(folder / "answer.json")
    record = scoring.strictly(labels, answer, folder / "predictions", place.folder / CAPTURES)
    return {"experiment": answered.experiment, "failure": answered.failure, **record}
