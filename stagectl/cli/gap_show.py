"""A diagnosis on the terminal: the sentence first, then who, where and how far, then what to do next."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from stagectl.cli.show import console
from stagectl.gap.effects import library
from stagectl.gap.result import remarks_text, verdict_text
from stagectl.gap.result.diagnosis import NAMED, DiagnosisResult
from stagectl.number_format import interval, percent, portion
from stagectl.report.tables.gap import gaps

MOST_COORDINATES = 3
MOST_SPANS = 8


def show(diagnosis: DiagnosisResult, folder: Path) -> None:
    """Print the diagnosis of `folder`."""
    for doubt in diagnosis.doubts:
        console.print(f"doubtful data: {doubt}", style="bold")
    console.print(f"{diagnosis.verdict}: {diagnosis.sentence or verdict_text.sentence(diagnosis)}")
    if diagnosis.effects:
        console.print(_effects(diagnosis))
    if diagnosis.verdict != "controller":
        console.print(_gaps(diagnosis))
    for line in (*_where(diagnosis), *remarks_text.lines(diagnosis)):
        console.print(line)
    for line in _commands(diagnosis, folder):
        console.print(line, style="bold")


def _effects(diagnosis: DiagnosisResult) -> Table:
    table = Table("effect", "in", "share", "probability", "parameters (95 %)")
    for effect in diagnosis.effects:
        probability = f"{effect.probability:.2f}" + ("" if effect.probability >= NAMED else ", not named")
        values = [
            f"{name.replace('_', ' ')} {interval(name, value, diagnosis.travel)}"
            for name, value in effect.parameters.items()
        ]
        names, share = verdict_text.candidates(effect), portion(effect.share)
        table.add_row(names, effect.block, share, probability, "\n".join(values))
    return table


def _gaps(diagnosis: DiagnosisResult) -> Table:
    table = Table(f"{diagnosis.judged_on}, rms", "before", "after", "floor", "unit", "closed (95 %)")
    for name, before, after, unit, _, floor, closed in gaps(diagnosis).rows:
        table.add_row(name, before, after, floor, unit, closed)
    return table


def _where(diagnosis: DiagnosisResult) -> list[str]:
    if diagnosis.verdict == "none":
        return []
    blocks = ", ".join(
        f"{name} {'not judged' if share is None else percent(share)}" for name, share in diagnosis.blocks.items()
    )
    ranked = sorted(diagnosis.coordinates, key=lambda coordinate: -coordinate.share)[:MOST_COORDINATES]
    follows = ", ".join(
        f"{library.coordinate_label(coordinate.name)} {percent(coordinate.share)}" for coordinate in ranked
    )
    lines = [f"where in the loop: {blocks}"] + ([f"what it follows: {follows}"] if ranked else [])
    open_ones = tuple(capture for capture in diagnosis.captures if capture.spans)
    spans = remarks_text.spans(diagnosis._replace(captures=open_ones))
    more = [f"and {len(spans) - MOST_SPANS} more captures"] if len(spans) > MOST_SPANS else []
    return [*lines, *(f"open in {span}" for span in spans[:MOST_SPANS]), *more]


def _commands(diagnosis: DiagnosisResult, folder: Path) -> list[str]:
    lines = []
    if diagnosis.next_experiment is not None and diagnosis.next_experiment.trajectory:
        lines.append(f"stagectl gap next {folder}")
    if any(effect.fields for effect in diagnosis.named):
        lines.append(f"stagectl gap apply {folder} STAGE.yaml")
    return lines
