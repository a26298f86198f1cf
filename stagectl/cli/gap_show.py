"""A diagnosis on the terminal: the sentence first, then who, where and how far, then what to do next."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from stagectl.cli.show import console
from stagectl.gap.effects import library
from stagectl.gap.result import verdict_text
from stagectl.gap.result.diagnosis import NAMED, DiagnosisResult, FoundEffect, Gap
from stagectl.number_format import interval, percent, together

MOST_COORDINATES = 3
MOST_SPANS = 8


def show(found: DiagnosisResult, folder: Path) -> None:
    """Print the diagnosis of `folder`."""
    console.print(f"{found.verdict}: {found.sentence or verdict_text.sentence(found)}")
    if found.effects:
        console.print(_effects(found))
    if found.verdict != "controller":
        console.print(_gaps(found))
    for line in (
        *_where(found),
        *verdict_text.remarks(found),
        *verdict_text.ambiguous(found),
        *verdict_text.advice(found),
    ):
        console.print(line)
    for line in _commands(found, folder):
        console.print(line, style="bold")


def _effects(found: DiagnosisResult) -> Table:
    table = Table("effect", "in", "share", "probability", "parameters (95 %)")
    for one in found.effects:
        probability = f"{one.probability:.2f}" + ("" if one.probability >= NAMED else ", not named")
        table.add_row(verdict_text.candidates(one), one.block, percent(one.share), probability, _parameters(one, found))
    return table


def _parameters(one: FoundEffect, found: DiagnosisResult) -> str:
    shown = (
        f"{name.replace('_', ' ')} {interval(name, value, found.travel)}" for name, value in one.parameters.items()
    )
    return "\n".join(shown)


def _gaps(found: DiagnosisResult) -> Table:
    table = Table("held-out runs, rms", "before", "after", "floor", "unit", "closed (95 %)")
    known = {"position" if found.gap.unit in ("rad", "m") else "effort": found.gap, **found.gaps}
    for name, one in known.items():
        table.add_row(verdict_text.gap_label(name), *_gap(one, found))
    return table


def _gap(one: Gap, found: DiagnosisResult) -> list[str]:
    (before, after, floor), unit = together((one.before, one.after, one.floor), one.unit, found.travel)
    return [before, after, floor, unit, "nothing to close" if found.verdict == "none" else verdict_text.closure(one)]


def _where(found: DiagnosisResult) -> list[str]:
    if found.verdict == "none":
        return []
    blocks = ", ".join(
        f"{name} {'not judged' if share is None else percent(share)}" for name, share in found.blocks.items()
    )
    ranked = sorted(found.coordinates, key=lambda one: -one.share)[:MOST_COORDINATES]
    follows = ", ".join(f"{library.coordinate_label(one.name)} {percent(one.share)}" for one in ranked)
    lines = [f"where in the loop: {blocks}"] + ([f"what it follows: {follows}"] if ranked else [])
    spans = verdict_text.spans(found._replace(captures=tuple(one for one in found.captures if one.spans)))
    more = [f"and {len(spans) - MOST_SPANS} more captures"] if len(spans) > MOST_SPANS else []
    return [*lines, *(f"open in {one}" for one in spans[:MOST_SPANS]), *more]


def _commands(found: DiagnosisResult, folder: Path) -> list[str]:
    lines = []
    if found.next_experiment is not None and found.next_experiment.trajectory:
        lines.append(f"stagectl gap next {folder}")
    if any(one.fields for one in found.named):
        lines.append(f"stagectl gap apply {folder} STAGE.yaml")
    return lines
