"""From records to the rows of the exam's table: value, interval, number of trials, and what is asked."""

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from stagectl_studies.exam import closed_table, intervals
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
    held = [record for record in records if record["state"] != VOID]
    counted, closed = [record for record in held if "naming" in record], closed_table.of(held)
    known = limits(singles(counted))
    return {
        "trials": len(records),
        "void": [
            {"number": record["number"], "reasons": record["reasons"]} for record in records if record["state"] == VOID
        ],
        "failed": [
            {"number": record["number"], "reasons": record["reasons"]}
            for record in records
            if record["state"] == FAILED
        ],
        "strata": dict(sorted(Counter(record["stratum"] for record in held).items())),
        "rows": [row._asdict() for row in (*(rows(counted, known) if counted else ()), *closed_table.rows(closed))],
        "limits": known,
        "classes": classes(counted, known),
        "by_effect": by_effect(counted),
        "confusion": confusion(counted),
        "reliability": reliability(counted),
        "oracle_ratios": oracle_ratios(counted),
        "beside": beside(counted, [single for single in singles_of(counted) if beyond(single, known)]),
    }


def rows(records: Sequence[Record], known: Mapping[str, float]) -> list[Row]:
    """The table of section 7 of the design, and what stands behind it."""
    group = _groups(records)
    single = group["single"]
    clear = [record for record in single if beyond(record, dict(known))]
    placed = [record for record in (*clear, *group["pair"], *group["triple"]) if record["where"] is not None]
    full = [record for record in records if record["stratum"] not in ("left-out", "alien", "poor")]
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
        mean("WHERE F1", [record["where"]["f1"] for record in placed], Asked(0.85, 0.75)),
        mean("  single effects", [record["where"]["f1"] for record in placed if record in clear]),
        mean("  of one who calls all rows open", _everywhere(placed)),
        rate("  block of the loop", [bool(record["where"]["block_right"]) for record in placed]),
        rate("  coordinate", _coordinates(placed)),
        *_closures(clear, [record for record in records if record["truth"]["hidden"]]),
        mean("Brier score", _brier(records)),
    ]


def singles_of(records: Sequence[Record]) -> list[Record]:
    """Trials with one effect, of any size."""
    return [record for record in records if record["stratum"].startswith("single")]


def _groups(records: Sequence[Record]) -> dict[str, list[Record]]:
    nulls = ("null-exact", "null-parameters", "null-law", "null")
    names = (*nulls, "single", "pair", "triple", "left-out", "alien", "poor")
    return {name: [record for record in records if record["stratum"].startswith(name)] for name in names}


def _naming(records: Iterable[Record], key: str) -> list[bool]:
    return [bool(record["naming"][key]) for record in records]


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
    each = [record["naming"]["sizes"] for record in records]
    return [sum(sizes) / len(sizes) for sizes in each if sizes]


def _everywhere(records: Sequence[Record]) -> list[float]:
    scores = [record["where"].get("everywhere") for record in records]  # an exam begun before it was counted has none
    return [score for score in scores if score is not None]


def _brier(records: Sequence[Record]) -> list[float]:
    """Mean over the entries of each answer."""
    each = [record["probabilities"] for record in records]
    return [sum((p - y) ** 2 for p, y in pairs) / len(pairs) for pairs in each if pairs]


def _precision(group: Mapping[str, list[Record]]) -> list[float]:
    return [float(record["naming"]["precision"]) for record in (*group["pair"], *group["triple"])]


def _unknowns(group: Mapping[str, list[Record]], full: Sequence[Record]) -> list[Row]:
    return [
        rate("effect left out: unknown", _naming(group["left-out"], "unknown"), Asked(0.85, 0.7)),
        rate("  and no effect named beside it", [_nothing_else(record) for record in group["left-out"]]),
        rate(
            "  and its coordinate",
            _coordinates([record for record in group["left-out"] if record["naming"]["unknown"]]),
        ),
        rate("unknown where nothing is", _naming(full, "unknown"), Asked(0.08, 0.15, True)),
        rate("  alien effect: unknown", _naming(group["alien"], "unknown")),
    ]


def _nothing_else(record: Record) -> bool:
    return bool(record["naming"]["unknown"]) and not record["naming"]["sizes"]


def _poor(poor: Sequence[Record]) -> list[Row]:
    spoken = [record for record in poor if record["naming"]["alarm"]]
    advised = [record["answer"]["next_experiment"] is not None for record in poor if not record["naming"]["covered"]]
    return [
        rate("  poor battery, set holds the effect when it speaks", _naming(spoken, "covered")),
        rate("  poor battery, a next experiment where it does not know", advised),
        *_asked_for([record["rounds"] for record in poor if "rounds" in record]),  # an exam begun before there were any
    ]


def _asked_for(trials: Sequence[Sequence[Record]]) -> list[Row]:
    """How often the answer is right after how many of the experiments it asked for; one that asks no more stands."""
    lines = []
    for count, words in enumerate(("at once", "after one experiment", "after two experiments")):
        then = [trial[min(count, len(trial) - 1)] for trial in trials]
        lines.append(rate(f"  poor battery, named first {words}", _naming(then, "top1")))
        lines.append(rate(f"  poor battery, set holds the effect {words}", _naming(then, "covered")))
    return [*lines, mean("  poor battery, experiments run", [len(trial) - 1.0 for trial in trials])]


def _coordinates(records: Sequence[Record]) -> list[bool]:
    known = [record["where"]["coordinate_right"] for record in records]
    return [bool(right) for right in known if right is not None]


def _closures(clear: Sequence[Record], hidden: Sequence[Record]) -> list[Row]:
    closures = [each["gap"]["closure"] for each in clear if is_open(each)]
    large = [_left(each, "before") / _left(each, "after") for each in hidden if is_open(each, LARGE)]
    foretold = [each for each in hidden if is_open(each) and each["gap"]["predicted"] is not None]
    missed = [100.0 * abs(each["gap"]["predicted"] - each["gap"]["closure"]) for each in foretold]
    ratios = oracle_ratios(hidden)
    return [
        median("closure, single effect", closures, Asked(0.95, 0.85)),
        median("RMS factor, gap >= 10x floor", large, Asked(8.0, 5.0)),
        median("predicted against realised closure, points", missed, Asked(3.0, 6.0, True)),
        median("oracle ratio", ratios, Asked(1.05, 1.2, True)),
    ]


def oracle_ratios(records: Sequence[Record]) -> list[float]:
    """Gap left over that of the oracle, where the library holds what the oracle was told."""
    strata = ("single", "pair", "triple")
    open_records = [record for record in records if record["stratum"].startswith(strata) and is_open(record)]
    known = [record for record in open_records if "oracle" in record.get("baselines", {})]
    return [_left(record, "after") / _left(record["baselines"]["oracle"], "after") for record in known]


def _left(record: Mapping[str, Any], when: str) -> float:
    """The gap as a user sees it: with the noise of his runs in it, rad."""
    return math.hypot(record["gap"][when], record["gap"]["floor"])


def classes(records: Sequence[Record], known: Mapping[str, float]) -> list[Record]:
    """Of each class of effect: limit, trials, noticed, named."""
    single = [record for record in records if record["stratum"].startswith("single")]
    between, rows = intervals_of(singles(records)), []
    for kind, limit in known.items():
        mine = [record for record in single if CLASS_OF[record["truth"]["hidden"][0]] == kind]
        clear = [record for record in mine if beyond(record, dict(known))]
        rows.append(
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
                "points": [
                    [record["truth"]["effects"][-1]["realised_scale"], record["naming"]["alarm"]] for record in mine
                ],
            }
        )
    return rows


def by_effect(records: Sequence[Record]) -> dict[str, Record]:
    """Of each effect in single trials: how often noticed and named."""
    records_by_effect: dict[str, Record] = {}
    for trial_record in sorted(records, key=lambda record: record["number"]):
        if trial_record["stratum"].startswith("single"):
            line = records_by_effect.setdefault(
                trial_record["truth"]["hidden"][0], {"trials": 0, "noticed": 0, "named": 0}
            )
            line["trials"] += 1
            line["noticed"] += bool(trial_record["naming"]["alarm"])
            line["named"] += bool(trial_record["naming"]["top1"])
    return dict(sorted(records_by_effect.items()))


def confusion(records: Sequence[Record]) -> list[list[Any]]:
    """(truth, answer, trials) of all trials with one effect or none."""
    pairs = Counter(
        (record["truth"]["hidden"][0] if record["truth"]["hidden"] else "none", record["naming"]["top"])
        for record in records
        if record["stratum"].startswith(("single", "null"))
    )
    return [[truth, answer, count] for (truth, answer), count in sorted(pairs.items())]


def reliability(records: Sequence[Record]) -> list[Record]:
    """Probabilities against what came true, by bins; entries that nobody named count in the Brier score alone."""
    pairs = [(p, y) for record in records for p, y in record["probabilities"] if p > 0.0]
    bins = []
    for low, high in itertools.pairwise(BINS):
        mine = [(p, y) for p, y in pairs if low <= p < high or p == high == 1.0]
        hits = sum(int(y) for _, y in mine)
        below, above = intervals.wilson(hits, len(mine))
        said = sum(p for p, _ in mine) / len(mine) if mine else None
        right = hits / len(mine) if mine else None
        bins.append(
            {"from": low, "to": high, "said": said, "right": right, "low": below, "high": above, "count": len(mine)}
        )
    return bins
