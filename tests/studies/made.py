"""Records as trials leave them, made up: an examinee that is right with a probability that is known."""

from __future__ import annotations

from typing import Any

import numpy as np
from stagectl_studies.exam.plan import Planned, plan
from stagectl_studies.exam.rules import BLOCKS, Entry, Truth, considered
from stagectl_studies.exam.scoring import naming, probabilities
from stagectl_studies.machine.effects import ALIENS, EFFECTS

Record = dict[str, Any]
BASELINES = {"oracle": 1.0, "refit": 0.0, "sparse": 0.5}  # chance to be right


def records(trials: int, seed: int, skill: float = 0.9) -> list[Record]:
    """An exam of an examinee that names a hidden effect with this probability if it is of typical size or more."""
    random = np.random.default_rng(seed)
    return [_record(trial, random, skill) for trial in plan(trials, seed)]


def _record(planned: Planned, random: np.random.Generator, skill: float) -> Record:
    scale = planned.scale or 1.0
    offsets = ("viscous",) if random.random() < 0.5 else ()
    nameable = planned.stratum not in ("alien", "left-out")
    truth = Truth(planned.effects, (), offsets, planned.stratum == "poor", nameable)
    said = [_entry(name, random, skill * min(scale, 1.0)) for name in planned.effects if nameable]
    named = [name for name in said if name is not None]
    unknown = not nameable and random.random() < skill
    verdict = "unknown" if unknown else "effects" if named else "none"
    closure = float(random.uniform(0.8, 1.0)) if named or unknown else 0.1
    before, floor = float(random.uniform(1e-5, 1e-4)), 4e-6
    gap = {"before": before, "floor": floor, "after": before * np.sqrt(1.0 - closure), "closure": closure}
    effects = [{"name": n, "scale": scale, "realised_scale": scale, "companion": False} for n in planned.effects]
    rounds = {"rounds": _rounds(truth, verdict, named)} if truth.poor else {}
    return rounds | {
        "number": planned.number,
        "stratum": planned.stratum,
        "state": "scored",
        "reasons": [],
        "seed": planned.seed,
        "truth": {"effects": effects, "hidden": list(planned.effects), "offsets": list(offsets)},
        "answer": {"verdict": verdict, "next_experiment": "scan"},
        "naming": naming(truth, {"verdict": verdict}, named, considered(truth, named)),
        "probabilities": probabilities(truth, named),
        "where": _where(planned, random) if planned.effects else None,
        "gap": {**gap, "predicted": closure + float(random.normal(0.0, 0.02)), "stated": closure},
        "baselines": {name: _baseline(truth, random, chance, gap) for name, chance in BASELINES.items()},
    }


def _rounds(truth: Truth, verdict: str, named: list[Entry]) -> list[Record]:
    """Whatever it said first: after one experiment it is right, and asks for no more."""
    strict, right = truth._replace(poor=False), [Entry(name, (), 0.9, False) for name in truth.hidden]
    said = [(verdict, named), ("effects", right)]
    return [
        {"naming": naming(strict, {"verdict": verdict_said}, named_then, considered(strict, named_then))}
        for verdict_said, named_then in said
    ]


def _entry(name: str, random: np.random.Generator, chance: float) -> Entry | None:
    if random.random() > chance:
        return None
    right = random.random() < 0.9
    return Entry(name if right else str(random.choice(sorted(EFFECTS))), (), float(random.uniform(0.7, 1.0)), False)


def _where(planned: Planned, random: np.random.Generator) -> Record:
    block = BLOCKS[(EFFECTS.get(planned.effects[0]) or ALIENS[planned.effects[0]]).seen_in][0]
    where = {
        "block": block,
        "block_right": True,
        "coordinate": "speed",
        "coordinate_right": bool(random.random() < 0.7),
    }
    return {"f1": float(random.uniform(0.6, 1.0)), "precision": 0.9, "recall": 0.9, **where}


def _baseline(truth: Truth, random: np.random.Generator, chance: float, gap: Record) -> Record:
    named = [Entry(name, (), 1.0, False) for name in truth.hidden if random.random() < chance]
    return {"naming": naming(truth, {"verdict": "effects"}, named, considered(truth, named)), "gap": gap}
