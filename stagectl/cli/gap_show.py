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


def show(diagnosis: DiagnosisResult, folder: Path) -> None:
    """Print the diagnosis of `folder`."""
    console.print(f"{diagnosis.verdict}: {diagnosis.sentence or verdict_text.sentence(diagnosis)}")
    if diagnosis.effects:
        console.print(_effects(diagnosis))
    if diagnosis.verdict != "controller":
        console.print(_gaps(diagnosis))
    for line in (
        *_where(diagnosis),
        *verdict_text.lines(diagnosis),
    ):
        console.print(line)
    for line in _commands(diagnosis, folder):
        console.print(line, style="bold")


def _effects(diagnosis: DiagnosisResult) -> Table:
    table = Table("effect", "in", "share", "probability", "parameters (95 %)")
    for effect in diagnosis.effects:
        probability = f"{effect.probability:.2f}" + ("" if effect.probability >= NAMED else ", not named")
        table.add_row(
            verdict_text.candidates(effect),
            effect.block,
            percent(effect.share),
            probability,
            _parameters(effect, diagnosis),
        )
    return table


def _parameters(effect: FoundEffect, diagnosis: DiagnosisResult) -> str:
    shown = (
        f"{name.replace('_', ' ')} {interval(name, value, diagnosis.travel)}"
        for name, value in effect.parameters.items()
    )
    return "\n".join(shown)


def _gaps(diagnosis: DiagnosisResult) -> Table:
    table = Table("held-out runs, rms", "before", "after", "floor", "unit", "closed (95 %)")
    known = {"position" if diagnosis.gap.unit in ("rad", "m") else "effort": diagnosis.gap, **diagnosis.gaps}
    for name, value in known.items():
        table.add_row(verdict_text.gap_label(name), *_gap(value, diagnosis))
    return table


def _gap(gap: Gap, diagnosis: DiagnosisResult) -> list[str]:
    (before, after, floor), unit = together((gap.before, gap.after, gap.floor), gap.unit, diagnosis.travel)
    return [
        before,
        after,
        floor,
        unit,
        "nothing to close" if diagnosis.verdict == "none" else verdict_text.closure(gap),
    ]


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
    spans = verdict_text.spans(
        diagnosis._replace(captures=tuple(capture for capture in diagnosis.captures if capture.spans))
    )
    more = [f"and {len(spans) - MOST_SPANS} more captures"] if len(spans) > MOST_SPANS else []
    return [*lines, *(f"open in {span}" for span in spans[:MOST_SPANS]), *more]


def _commands(diagnosis: DiagnosisResult, folder: Path) -> list[str]:
    lines = []
    if diagnosis.next_experiment is not None and diagnosis.next_experiment.trajectory:
        lines.append(f"stagectl gap next {folder}")
    if any(effect.fields for effect in diagnosis.named):
        lines.append(f"stagectl gap apply {folder} STAGE.yaml")
    return lines
