"""From records to the rows of the exam's table: value, interval, number of trials, and what is asked."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from stagectl_studies.exam import intervals
from stagectl_studies.exam.baseline_table import beside
from stagectl_studies.exam.detection_sizes import SMALLEST, beyond, intervals_of, limits, singles
from stagectl_studies.exam.rows import Asked, Row, is_open, mean, median, rate
from stagectl_studies.exam.rules import CLASS_OF
from stagectl_studies.exam.run_trial import FAILED, VOID

Record = dict[str, Any]
BINS = (0.0, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.96, 1.0)
LARGE = 10.0  # times the floor: a gap from which the factor counts


def totals(records: Sequence[Record]) -> Record:
    """Everything that the exam says, without any time in it."""
    counted = [one for one in records if one["state"] != VOID]
    known = limits(singles(counted))
    return {
        "trials": len(records),
        "void": [{"number": one["number"], "reasons": one["reasons"]} for one in records if one["state"] == VOID],
        "failed": [{"number": one["number"], "reasons": one["reasons"]} for one in records if one["state"] == FAILED],
        "strata": dict(sorted(Counter(one["stratum"] for one in counted).items())),
        "rows": [row._asdict() for row in rows(counted, known)],
        "limits": known,
        "classes": classes(counted, known),
        "by_effect": by_effect(counted),
        "confusion": confusion(counted),
        "reliability": reliability(counted),
        "oracle_ratios": oracle_ratios(counted),
        "beside": beside(counted, [one for one in singles_of(counted) if beyond(one, known)]),
    }


def rows(records: Sequence[Record], known: Mapping[str, float]) -> list[Row]:
    """The table of section 7 of the design, and what stands behind it."""
    group = _groups(records)
    single = group["single"]
    clear = [one for one in single if beyond(one, dict(known))]
    placed = [one for one in (*clear, *group["pair"], *group["triple"]) if one["where"] is not None]
    full = [one for one in records if one["stratum"] not in ("left-out", "alien", "poor")]
    return [
        *_nulls(group),
        rate("single effect, top-1 at >= 2x its limit", _naming(clear, "top1"), Asked(0.92, 0.85)),
        rate("  the same, shifts of parameters passed over", _naming(clear, "top1_effects")),
        rate("  all single effects, noticed", _naming(single, "alarm")),
        rate("  all single effects, top-1", _naming(single, "top1")),
        rate("ambiguity set holds the effect", _naming(clear, "covered"), Asked(0.97, 0.92)),
        mean("ambiguity set, mean size", _sizes(clear), Asked(1.5, 2.0, True)),
        mean("  the same, pairs and triples", _sizes([*group["pair"], *group["triple"]])),
        rate("pairs, all found", _naming(group["pair"], "all_found"), Asked(0.8, 0.65)),
        rate("triples, all found", _naming(group["triple"], "all_found"), Asked(0.6, 0.4)),
        mean("  share of the answers that is right, pairs and triples", _precision(group)),
        *_unknowns(group, full),
        *_poor(group["poor"]),
        mean("WHERE F1", [one["where"]["f1"] for one in placed], Asked(0.85, 0.75)),
        mean("  single effects", [one["where"]["f1"] for one in placed if one in clear]),
        mean("  of one who calls all rows open", _everywhere(placed)),
        rate("  block of the loop", [bool(one["where"]["block_right"]) for one in placed]),
        rate("  coordinate", _coordinates(placed)),
        *_closures(clear, [one for one in records if one["truth"]["hidden"]]),
        mean("Brier score", _brier(records)),
    ]


def singles_of(records: Sequence[Record]) -> list[Record]:
    """Trials with one effect, of any size."""
    return [one for one in records if one["stratum"].startswith("single")]


def _groups(records: Sequence[Record]) -> dict[str, list[Record]]:
    nulls = ("null-exact", "null-parameters", "null-law", "null")
    names = (*nulls, "single", "pair", "triple", "left-out", "alien", "poor")
    return {name: [one for one in records if one["stratum"].startswith(name)] for name in names}


def _naming(records: Iterable[Record], key: str) -> list[bool]:
    return [bool(one["naming"][key]) for one in records]


def _nulls(group: Mapping[str, list[Record]]) -> list[Row]:
    return [
        rate("null, false alarms", _naming(group["null"], "alarm"), Asked(0.03, 0.08, True)),
        rate("  of which an effect or unknown", _naming(group["null"], "effects_alarm")),
        *(
            rate(f"  {name.removeprefix('null-')}", _naming(group[name], "alarm"))
            for name in ("null-exact", "null-parameters", "null-law")
        ),
    ]


def _sizes(records: Sequence[Record]) -> list[float]:
    """Mean size of the sets of each answer that names an effect."""
    each = [one["naming"]["sizes"] for one in records]
    return [sum(sizes) / len(sizes) for sizes in each if sizes]


def _everywhere(records: Sequence[Record]) -> list[float]:
    found = [one["where"].get("everywhere") for one in records]  # an exam begun before it was counted has none
    return [one for one in found if one is not None]


def _brier(records: Sequence[Record]) -> list[float]:
    """Mean over the entries of each answer."""
    each = [one["probabilities"] for one in records]
    return [sum((p - y) ** 2 for p, y in pairs) / len(pairs) for pairs in each if pairs]


def _precision(group: Mapping[str, list[Record]]) -> list[float]:
    return [float(one["naming"]["precision"]) for one in (*group["pair"], *group["triple"])]


def _unknowns(group: Mapping[str, list[Record]], full: Sequence[Record]) -> list[Row]:
    return [
        rate("effect left out: unknown", _naming(group["left-out"], "unknown"), Asked(0.85, 0.7)),
        rate("  and no effect named beside it", [_nothing_else(one) for one in group["left-out"]]),
        rate("  and its coordinate", _coordinates([one for one in group["left-out"] if one["naming"]["unknown"]])),
        rate("unknown where nothing is", _naming(full, "unknown"), Asked(0.08, 0.15, True)),
        rate("  alien effect: unknown", _naming(group["alien"], "unknown")),
    ]


def _nothing_else(one: Record) -> bool:
    return bool(one["naming"]["unknown"]) and not one["naming"]["sizes"]


def _poor(poor: Sequence[Record]) -> list[Row]:
    spoken = [one for one in poor if one["naming"]["alarm"]]
    advised = [one["answer"]["next_experiment"] is not None for one in poor if not one["naming"]["covered"]]
    return [
        rate("  poor battery, set holds the effect when it speaks", _naming(spoken, "covered")),
        rate("  poor battery, a next experiment where it does not know", advised),
        *_asked_for([one["rounds"] for one in poor if "rounds" in one]),  # an exam begun before there were any
    ]


def _asked_for(trials: Sequence[Sequence[Record]]) -> list[Row]:
    """How often the answer is right after how many of the experiments it asked for; one that asks no more stands."""
    found = []
    for count, words in enumerate(("at once", "after one experiment", "after two experiments")):
        then = [one[min(count, len(one) - 1)] for one in trials]
        found.append(rate(f"  poor battery, named first {words}", _naming(then, "top1")))
        found.append(rate(f"  poor battery, set holds the effect {words}", _naming(then, "covered")))
    return [*found, mean("  poor battery, experiments run", [len(one) - 1.0 for one in trials])]


def _coordinates(records: Sequence[Record]) -> list[bool]:
    known = [one["where"]["coordinate_right"] for one in records]
    return [bool(one) for one in known if one is not None]


def _closures(clear: Sequence[Record], hidden: Sequence[Record]) -> list[Row]:
    one = [each["gap"]["closure"] for each in clear if is_open(each)]
    large = [_left(each, "before") / _left(each, "after") for each in hidden if is_open(each, LARGE)]
    foretold = [each for each in hidden if is_open(each) and each["gap"]["predicted"] is not None]
    missed = [100.0 * abs(each["gap"]["predicted"] - each["gap"]["closure"]) for each in foretold]
    ratios = oracle_ratios(hidden)
    return [
        median("closure, single effect", one, Asked(0.95, 0.85)),
        median("RMS factor, gap >= 10x floor", large, Asked(8.0, 5.0)),
        median("predicted against realised closure, points", missed, Asked(3.0, 6.0, True)),
        median("oracle ratio", ratios, Asked(1.05, 1.2, True)),
    ]


def oracle_ratios(records: Sequence[Record]) -> list[float]:
    """Gap left over that of the oracle, where the library holds what the oracle was told."""
    strata = ("single", "pair", "triple")
    told = [one for one in records if one["stratum"].startswith(strata) and is_open(one)]
    known = [one for one in told if "oracle" in one.get("baselines", {})]
    return [_left(one, "after") / _left(one["baselines"]["oracle"], "after") for one in known]


def _left(one: Mapping[str, Any], when: str) -> float:
    """The gap as a user sees it: with the noise of his runs in it, rad."""
    return math.hypot(one["gap"][when], one["gap"]["floor"])


def classes(records: Sequence[Record], known: Mapping[str, float]) -> list[Record]:
    """Of each class of effect: limit, trials, noticed, named."""
    single = [one for one in records if one["stratum"].startswith("single")]
    between, found = intervals_of(singles(records)), []
    for kind, limit in known.items():
        mine = [one for one in single if CLASS_OF[one["truth"]["hidden"][0]] == kind]
        clear = [one for one in mine if beyond(one, dict(known))]
        found.append(
            {
                "class": kind,
                "limit": limit,
                "low": between[kind][0],
                "high": between[kind][1],
                "below": limit <= SMALLEST,
                "trials": len(mine),
                "noticed": sum(_naming(mine, "alarm")),
                "clear": len(clear),
                "named": sum(_naming(clear, "top1")),
                "points": [[one["truth"]["effects"][-1]["realised_scale"], one["naming"]["alarm"]] for one in mine],
            }
        )
    return found


def by_effect(records: Sequence[Record]) -> dict[str, Record]:
    """Of each effect in single trials: how often noticed and named."""
    found: dict[str, Record] = {}
    for one in sorted(records, key=lambda record: record["number"]):
        if one["stratum"].startswith("single"):
            line = found.setdefault(one["truth"]["hidden"][0], {"trials": 0, "noticed": 0, "named": 0})
            line["trials"] += 1
            line["noticed"] += bool(one["naming"]["alarm"])
            line["named"] += bool(one["naming"]["top1"])
    return dict(sorted(found.items()))


def confusion(records: Sequence[Record]) -> list[list[Any]]:
    """(truth, answer, trials) of all trials with one effect or none."""
    pairs = Counter(
        (one["truth"]["hidden"][0] if one["truth"]["hidden"] else "none", one["naming"]["top"])
        for one in records
        if one["stratum"].startswith(("single", "null"))
    )
    return [[truth, answer, count] for (truth, answer), count in sorted(pairs.items())]


def reliability(records: Sequence[Record]) -> list[Record]:
    """Probabilities against what came true, by bins; entries that nobody named count in the Brier score alone."""
    pairs = [(p, y) for one in records for p, y in one["probabilities"] if p > 0.0]
    found = []
    for low, high in itertools.pairwise(BINS):
        mine = [(p, y) for p, y in pairs if low <= p < high or p == high == 1.0]
        hits = sum(int(y) for _, y in mine)
        below, above = intervals.wilson(hits, len(mine))
        said = sum(p for p, _ in mine) / len(mine) if mine else None
        right = hits / len(mine) if mine else None
        found.append(
            {"from": low, "to": high, "said": said, "right": right, "low": below, "high": above, "count": len(mine)}
        )
    return found
