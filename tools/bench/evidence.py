"""Development machines of the exam's package, diagnosed by this version and by another one, side by side.

    python tools/bench/evidence.py [--seed 9000] [--machines 12] [--short] [--keep FOLDER] [--against CHECKOUT]

No exam: nothing is sealed, and its seeds are not those of an exam.  Machines with single effects, pairs, none, one that
is left out of the library, and aliens.  `--keep` leaves captures and answers there; a second call goes on from them.
`--against` names the root of another checkout, whose diagnosis answers the same captures.
"""

import argparse
import itertools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from stagectl_studies.exam import rules, scoring
from stagectl_studies.exam.plan import Planned, plan
from stagectl_studies.machine.stage_trial import stage_trial
from stagectl_studies.machine.trials import Options, draw

STRATA = ("null", "single-1", "single-2", "single-4", "pair", "left-out", "alien")
ABSENT = ("left-out", "alien")  # effects that no answer can name
BINS = (0.0, 0.3, 0.5, 0.7, 0.95, 1.0 + 1e-9)
HERE = Path(__file__).parents[2]


class Scored(NamedTuple):
    """One machine against one answer."""

    stratum: str
    pairs: tuple[tuple[float, float], ...]  # probability, 1 where it is so
    wrong: tuple[str, ...]  # effects that are named and not there
    hits: tuple[bool, ...]  # of the hidden effects
    unknown: bool
    block: bool | None  # whether the largest block is right; None where nothing is hidden
    intervals: tuple[bool, ...]  # of the parameters that are off: whether theirs holds the truth


def main() -> None:
    """Draw, diagnose, compare, show."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=9000)
    parser.add_argument("--machines", type=int, default=12)
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--against", type=Path)
    given = parser.parse_args()
    trees = {"this": HERE, **({"other": given.against} if given.against else {})}
    scores: dict[str, list[Scored]] = {name: [] for name in trees}
    with tempfile.TemporaryDirectory(prefix="stagectl-") as folder:
        for trial, place in machines((given.keep or Path(folder)).resolve(), given):
            for name, tree in trees.items():
                scores[name].append(scored(trial, place, answered(place, trial, name, tree)))
                print(place.name, trial.stratum, ",".join(trial.effects), name, scores[name][-1].wrong, flush=True)
    for name, rows in scores.items():
        show(name, rows)


def machines(root: Path, given: argparse.Namespace) -> Iterator[tuple[Planned, Path]]:
    """Each trial with the folder of its captures."""
    for trial in plan(given.machines, given.seed, STRATA):
        place = root / f"{given.seed}-{trial.number}"
        if not (place / "sealed").exists():
            options = Options(effects=trial.effects, scale=trial.scale, short=given.short)
            stage_trial(draw(trial.seed, trial.drawn_as, options), place)
        yield trial, place


def answered(place: Path, trial: Planned, name: str, tree: Path) -> dict[str, Any]:
    """The answer of the version in `tree`; a diagnosis that fails ends the bench."""
    answer = place / f"{name}.json"
    if not answer.exists():
        command = [sys.executable, "-m", "stagectl", "gap", "diagnose", str(place / "captures"), "--json", str(answer)]
        excluded = ["--exclude", ",".join(trial.exclude)] if trial.exclude else []
        paths = {"PYTHONPATH": os.pathsep.join([str(tree), str(tree / "tools" / "studies")])}
        done = subprocess.run(
            [*command, *excluded], cwd=tree, env=os.environ | paths, capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise SystemExit(done.stderr)
    read: dict[str, Any] = json.loads(answer.read_text(encoding="utf-8"))
    return read


def scored(trial: Planned, place: Path, answer: dict[str, Any]) -> Scored:
    """The answer against what was hidden."""
    told = json.loads((place / "sealed" / "truth.json").read_text(encoding="utf-8")) | {"stratum": trial.stratum}
    truth, entries = rules.truth_of(told), rules.entries(answer)
    named = [entry for entry in entries if entry.probability >= rules.NAMED]
    true = rules.any_same((*truth.hidden, *truth.companions, *truth.offsets), truth.poor)
    pairs = tuple((p, y) for p, y in scoring.probabilities(truth, entries))
    blocks = {name: share for name, share in answer["where"]["blocks"].items() if share is not None}
    right = {block for effect in told["effects"] for block in rules.BLOCKS[effect["seen_in"]]}
    return Scored(
        trial.stratum,
        pairs,
        tuple(entry.name for entry in named if not entry.parameter and entry.name not in true),
        tuple(rules.found(truth, rules.considered(truth, named))) if truth.nameable else (),
        answer["verdict"] in ("unknown", "effects+unknown"),
        max(blocks, key=blocks.__getitem__) in right if truth.hidden and blocks else None,
        tuple(held(answer, told["true"], set(truth.hidden))),
    )


def held(answer: dict[str, Any], true: dict[str, float], hidden: set[str]) -> Iterator[bool]:
    """Whether the interval of each parameter that is off holds the true value; not where a hidden effect is as good."""
    for effect in answer["effects"]:
        value = effect["parameters"].get(effect["name"])
        if effect["name"] in true and value and not hidden & set(effect["alternatives"]):
            yield value["low"] <= true[effect["name"]] <= value["high"]


def show(name: str, rows: Sequence[Scored]) -> None:
    """One version's figures."""
    hits = [hit for row in rows for hit in row.hits]
    nulls = [row for row in rows if row.stratum.startswith("null")]
    absent = [row for row in rows if row.stratum in ABSENT]
    present = [row for row in rows if row.stratum not in ABSENT]
    blocks = [row.block for row in rows if row.block is not None]
    intervals = [inside for row in rows for inside in row.intervals]
    pairs = np.array([pair for row in rows for pair in row.pairs]).reshape(-1, 2)
    errors = [[(p - y) ** 2 for p, y in row.pairs] for row in rows]
    machine, exam = np.mean([sum(each) for each in errors]), np.mean([np.mean(each) for each in errors if each])
    print(f"\n{name}: {len(rows)} machines, Brier score {exam:.3f} (mean over each answer's entries)")
    print(f"their sum {machine:.3f} a machine, {np.mean(np.concatenate(errors)):.3f} a probability of {len(pairs)}")
    print(f"wrong names {sum(len(row.wrong) for row in rows)}")
    print(f"nulls with a wrong name {sum(bool(row.wrong) for row in nulls)} of {len(nulls)}")
    print(f"library effects found {sum(hits)} of {len(hits)}")
    print(f"unknown said where it is {sum(row.unknown for row in absent)} of {len(absent)}", end="; ")
    print(f"elsewhere {sum(row.unknown for row in present)} of {len(present)}")
    print(f"block right {sum(blocks)} of {len(blocks)}; intervals that hold {sum(intervals)} of {len(intervals)}")
    for low, high in itertools.pairwise(BINS):
        within = pairs[(pairs[:, 0] >= low) & (pairs[:, 0] < high)]
        if len(within):
            said, true = within.mean(axis=0)
            print(f"said {low:g} to {min(high, 1.0):g}: {said:.2f}, true {true:.2f} of {len(within)}")


if __name__ == "__main__":
    main()
