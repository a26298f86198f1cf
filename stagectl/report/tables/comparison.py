"""A comparison of layers: errors of each variant, and paired differences."""

from __future__ import annotations

from typing import Any

from stagectl.number_format import length
from stagectl.report.page import Table

Result = dict[str, Any]


def tables(result: Result) -> list[Table]:
    """Errors of each variant, then the paired differences."""
    unit = result["unit"]
    rows = [
        [one["name"], *(length(one[measure]["mean"], unit) for measure in ("peak", "rms")), *_ends(one, unit)]
        for one in result["variants"]
    ]
    found = [Table("Tracking error", ["variant", "peak, mean", "rms, mean", "peak, least", "peak, most"], rows)]
    for key in ("against_first", "against_best"):
        against = result[key]
        if key == "against_first" or against["other"] != result["variants"][0]["name"]:
            found.append(_against(against, unit))
    return found


def _ends(one: Result, unit: str) -> list[str]:
    return [length(end(one["peak"]["values"]), unit) for end in (min, max)]


def _against(against: Result, unit: str) -> Table:
    head = ["variant", "measure", "lower by", "95 % interval", "p, after Holm", "repeats that agree"]
    rows = [
        [one["name"], measure, length(one["mean"], unit), *_certainty(one, unit), f"{one['agree']} of {one['repeats']}"]
        for measure in ("peak", "rms")
        for one in against[measure]
    ]
    return Table(f"Differences from {against['other']}, paired; negative is worse", head, rows)


def _certainty(one: Result, unit: str) -> list[str]:
    if one["low"] is None:
        return ["no spread", "none"]
    return [f"{length(one['low'], unit)} to {length(one['high'], unit)}", f"{one['adjusted']:.2g}"]
