"""A diagnosis in tables: effects, their values, and how far the gap closes."""

import math

from stagectl.gap.effects.library import label
from stagectl.gap.result import verdict_text
from stagectl.gap.result.diagnosis import NAMED, DiagnosisResult, FoundEffect, Gap
from stagectl.number_format import UNKNOWN, interval, portion, together
from stagectl.report.page import Table


def tables(result: DiagnosisResult) -> list[Table]:
    """The effects, their values, and how far the gap closes."""
    return [
        *([effects(result)] if result.effects else []),
        *([values(result)] if any(effect.parameters for effect in result.named) else []),
        *([gaps(result)] if result.verdict != "controller" else []),
    ]


def effects(result: DiagnosisResult) -> Table:
    """Each effect with its share and probability."""
    rows = [row for effect in result.effects for row in _effect(effect)]
    return Table("", ["effect", "in", "share of closable gap", "probability"], rows)


def _effect(effect: FoundEffect) -> list[list[str]]:
    """A row, and one for each effect that fits as well."""
    probability = f"{effect.probability:.2f}" + ("" if effect.probability >= NAMED else ": not named")
    rest = [[f"or {label(name)}", "", "", ""] for name in effect.alternatives]
    return [[label(effect.name), effect.block, portion(effect.share), probability], *rest]


def gaps(result: DiagnosisResult) -> Table:
    """The gap before and after."""
    known = {verdict_text.headline(result.gap): result.gap, **result.gaps}
    rows = [_row(f"{name} gap", gap, result) for name, gap in known.items()]
    head = [f"rms on {result.judged_on}", "before", "after", "unit", "factor", "noise floor", "closed (95 %)"]
    return Table("", head, rows)


def _row(name: str, gap: Gap, result: DiagnosisResult) -> list[str]:
    (before, after, floor), unit = together((gap.before, gap.after, gap.floor), gap.unit, result.travel)
    factor = f"{gap.before / gap.after:.1f}" if gap.after > 0.0 else ""
    noise = floor if gap.floor > 0.0 else UNKNOWN  # no run was repeated
    closed = verdict_text.closure(gap) if math.isfinite(gap.closure) else UNKNOWN
    return [name, before, after, unit, factor, noise, "nothing to close" if result.verdict == "none" else closed]


def values(result: DiagnosisResult) -> Table:
    """Values of the named effects, with their intervals."""
    rows = [
        [label(effect.name), name.replace("_", " "), interval(name, estimate, result.travel)]
        for effect in result.named
        for name, estimate in effect.parameters.items()
    ]
    return Table("", ["effect", "parameter", "value (95 % interval)"], rows)
