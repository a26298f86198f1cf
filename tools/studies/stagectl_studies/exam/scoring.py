"""One trial's labels and answer as one record of plain values: what `totals` counts."""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from stagectl_studies.exam import realised_closure, rules, spans
from stagectl_studies.exam.rules import Entry, Truth
from stagectl_studies.exam.staging import unpacked

Record = dict[str, Any]
NOWHERE = Path(os.devnull)  # a folder that holds nothing


def record(labels: bytes, answer: Mapping[str, Any] | None, predictions: Path, captures: Path) -> Record:
    """Everything that counts of one trial; `answer` None: the diagnosis failed, and so has said nothing."""
    truth_file, arrays = unpacked(labels)
    truth, said = rules.truth_of(truth_file), answer or {}
    predictions = predictions if answer is not None else NOWHERE
    every = rules.entries(said)
    named = [entry for entry in every if entry.probability >= rules.NAMED]
    left = rules.considered(truth, named)
    return {
        "stratum": truth_file["stratum"],
        "seed": truth_file["seed"],
        "truth": _truth(truth_file, truth),
        "answer": _answer(said, named),
        "naming": naming(truth, said, named, left),
        "where": _where(truth_file, arrays, said, truth),
        "gap": _gap(truth_file, arrays, said, (predictions, captures)),
        "probabilities": probabilities(truth, every),
    }


def strictly(labels: bytes, answer: Mapping[str, Any] | None, predictions: Path, captures: Path) -> Record:
    """Answer, naming and gap by the rules of a full battery, whatever the trial's own is."""
    truth_file, arrays = unpacked(labels)
    truth, said = rules.truth_of(truth_file)._replace(poor=False), answer or {}
    predictions = predictions if answer is not None else NOWHERE
    named = [entry for entry in rules.entries(said) if entry.probability >= rules.NAMED]
    return {
        "answer": _answer(said, named),
        "naming": naming(truth, said, named, rules.considered(truth, named)),
        "gap": _gap(truth_file, arrays, said, (predictions, captures)),
    }


def read(path: Path) -> Record | None:
    """An answer; None where there is none."""
    try:
        answer: Record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return answer


def beside(labels: bytes, folder: Path, asked: tuple[str, Sequence[str]]) -> Record:
    """Naming and gap of the baselines; one that has not answered has said nothing.

    `asked` = (where below `folder`, their names).
    """
    where, names = asked
    places = [(name, folder / where / name) for name in names]
    each = [(name, place, read(place / "answer.json")) for name, place in places]
    records = [(name, record(labels, said, place / "predictions", folder / "captures")) for name, place, said in each]
    return {name: {part: trial_record[part] for part in ("naming", "gap")} for name, trial_record in records}


def _truth(labels: Mapping[str, Any], truth: Truth) -> Record:
    kept = ("name", "scale", "realised_scale", "companion", "share")
    return {
        "effects": [{name: effect[name] for name in kept} for effect in labels["effects"]],
        "hidden": list(truth.hidden),
        "offsets": list(truth.offsets),
        "law": labels["law"],
        "exclude": labels["exclude"],
    }


def _answer(said: Mapping[str, Any], named: Sequence[Entry]) -> Record:
    following = said.get("next_experiment")
    return {
        "verdict": said.get("verdict", "failed"),
        "named": [[entry.name, *entry.alternatives] for entry in named],
        "probability": [entry.probability for entry in named],
        "next_experiment": following["name"] if following else None,
        "separates": list(following["separates"]) if following else [],
    }


def naming(truth: Truth, said: Mapping[str, Any], named: Sequence[Entry], left: Sequence[Entry]) -> Record:
    """Alarms, ranks and sets; see `rules`."""
    verdict = str(said.get("verdict", "failed"))
    effects = [entry for entry in left if not entry.parameter]
    beyond = verdict not in ("none", "parameters", "effects", "failed")
    hidden = rules.any_same(truth.hidden, truth.poor)
    others = [entry for entry in left if not entry.parameter or entry.name in hidden]
    sets = [entry for entry in named if not entry.parameter]
    hits = rules.found(truth, left)
    return {
        "top": rules.top(said, left),
        "alarm": bool(left) or beyond,
        "effects_alarm": bool(effects) or beyond,
        "unknown": verdict in ("unknown", "effects+unknown"),
        "top1": bool(left) and left[0].name in hidden,
        "top1_effects": bool(others) and others[0].name in hidden,
        "covered": bool(left) and bool(hidden & {left[0].name, *left[0].alternatives}),
        "sizes": [1 + len(entry.alternatives) for entry in sets],
        "only": bool(hits) and all(hits) and len(others) == len(hits),
        "found": hits,
        "all_found": bool(hits) and all(hits),
        "precision": sum(hits) / len(left) if left else 0.0,
    }


def probabilities(truth: Truth, every: Sequence[Entry]) -> list[list[float]]:
    """Pairs (probability, 1 where it is so else 0): each entry, and each nameable effect that none has with 0."""
    true = rules.any_same((*truth.hidden, *truth.companions, *truth.offsets), truth.poor)
    said = {entry.name for entry in every}
    missed = [name for name in truth.hidden if truth.nameable and not rules.same(name, truth.poor) & said]
    return [[entry.probability, float(entry.name in true)] for entry in every] + [[0.0, 1.0] for _ in missed]


def _where(
    truth_file: Mapping[str, Any], arrays: Mapping[str, Any], said: Mapping[str, Any], truth: Truth
) -> Record | None:
    if not truth.hidden:
        return None
    where = said.get("where", {})
    judgement = spans.judged(truth_file, arrays, where.get("captures", []))
    blocks = {name: share for name, share in where.get("blocks", {}).items() if share is not None}
    largest = max(blocks, key=lambda name: blocks[name]) if blocks else ""
    ranked = sorted(where.get("coordinates", []), key=lambda coordinate: -(coordinate["share"] or 0.0))
    right = {block for effect in truth_file["effects"] for block in rules.BLOCKS[effect["seen_in"]]}
    wanted = {name for effect in truth.hidden for name in rules.COORDINATES.get(effect, ())}
    coordinate = ranked[0]["name"] if ranked else ""
    return {
        **judgement,
        "block": largest,
        "block_right": largest in right,
        "coordinate": coordinate,
        "coordinate_right": coordinate in wanted if wanted else None,
    }


def _gap(
    truth: Mapping[str, Any], arrays: Mapping[str, Any], said: Mapping[str, Any], places: tuple[Path, Path]
) -> Record:
    gaps = realised_closure.gaps(truth, arrays, *places)
    gap = said.get("gap", {})
    return {**gaps, "stated": gap.get("closure"), "predicted": gap.get("predicted")}
