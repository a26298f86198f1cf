"""A diagnosis in tables: effects, their values, and how far the gap shrinks."""

from __future__ import annotations

import math

from stagectl.gap.effects import effect_names as words
from stagectl.gap.result import verdict_text
from stagectl.gap.result.diagnosis import NAMED, Effect, Found, Gap
from stagectl.gap.result.gap_numbers import parameter, percent, together
from stagectl.report.page import Table


def tables(found: Found) -> list[Table]:
    """The effects, their values, and how far the gap shrinks."""
    return [
        *([effects(found)] if found.effects else []),
        *([values(found)] if any(effect.parameters for effect in found.named) else []),
        *([gaps(found)] if found.verdict != "controller" else []),
    ]


def effects(found: Found) -> Table:
    """Each effect with its share and probability."""
    rows = [row for one in found.effects for row in _effect(one)]
    return Table("", ["effect", "in", "share of closable gap", "probability"], rows)


def _effect(one: Effect) -> list[list[str]]:
    """A row, and one for each effect that would fit as well."""
    probability = f"{one.probability:.2f}" + ("" if one.probability >= NAMED else ": not named")
    rest = [[f"or {words.effect(name)}", "", "", ""] for name in one.alternatives]
    return [[words.effect(one.name), one.block, percent(one.share), probability], *rest]


def gaps(found: Found) -> Table:
    """The gap before and after."""
    known = {"position" if found.gap.unit in ("rad", "m") else "effort": found.gap, **found.gaps}
    rows = [_row(verdict_text.called(name), gap, found) for name, gap in known.items()]
    return Table(
        "", ["rms on held-out runs", "before", "after", "unit", "factor", "noise floor", "closed (95 %)"], rows
    )


def _row(name: str, one: Gap, found: Found) -> list[str]:
    (before, after, floor), unit = together((one.before, one.after, one.floor), one.unit, found)
    factor = f"{one.before / one.after:.1f}" if one.after > 0.0 else ""
    return [name, before, after, unit, factor, floor, _closed(one, found)]


def _closed(one: Gap, found: Found) -> str:
    if found.verdict == "none":
        return "nothing to close"
    return verdict_text.closure(one) if math.isfinite(one.closure) else "not known"


def values(found: Found) -> Table:
    """Values of what is named, with their intervals."""
    rows = [
        [words.effect(one.name), name.replace("_", " "), parameter(name, value, found)]
        for one in found.named
        for name, value in one.parameters.items()
    ]
    return Table("", ["effect", "", "value (95 % interval)"], rows)
