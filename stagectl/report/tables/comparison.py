"""A comparison of layers: errors of each variant, and paired differences."""

from typing import Any

from stagectl.number_format import length
from stagectl.report.page import Table

Result = dict[str, Any]


def tables(result: Result) -> list[Table]:
    """Errors of each variant, then the paired differences; of a single repeat the errors alone."""
    unit = result["unit"]
    means = [
        [row["name"], *(length(row[measure]["mean"], unit) for measure in ("peak", "rms"))]
        for row in result["variants"]
    ]
    if len(result["order"]) == 1:
        return [Table("Tracking error", ["variant", "peak", "rms"], means)]
    ends = [[length(end(row["peak"]["values"]), unit) for end in (min, max)] for row in result["variants"]]
    rows = [[*mean, *pair] for mean, pair in zip(means, ends, strict=True)]
    shown = [Table("Tracking error", ["variant", "peak, mean", "rms, mean", "peak, least", "peak, most"], rows)]
    for key in ("against_first", "against_best"):
        against = result[key]
        if key == "against_first" or against["other"] != result["variants"][0]["name"]:
            shown.append(_against(against, unit))
    return shown


def _against(against: Result, unit: str) -> Table:
    head = ["variant", "measure", "lower by", "95 % interval", "p, after Holm", "repeats that agree"]
    rows = [
        [row["name"], measure, length(row["mean"], unit), *_certainty(row, unit), f"{row['agree']} of {row['repeats']}"]
        for measure in ("peak", "rms")
        for row in against[measure]
    ]
    return Table(f"Differences from {against['other']}, paired; negative is worse", head, rows)


def _certainty(row: Result, unit: str) -> list[str]:
    if row["low"] is None:
        return ["no spread", "none"]
    return [f"{length(row['low'], unit)} to {length(row['high'], unit)}", f"{row['adjusted']:.2g}"]
