"""The page of a diagnosis: the verdict in a sentence, where the gap lies, which effect makes it, how far it shrinks."""

from __future__ import annotations

import math
import re

from matplotlib.figure import Figure

from stagectl.gap.effects import library
from stagectl.gap.result import verdict_text
from stagectl.gap.result.diagnosis import BLOCKS, NAMED, DiagnosisResult, FoundEffect, Gap, Trace
from stagectl.gap.result.gap_numbers import parameter, percent, together
from stagectl.recording.metadata import versions
from stagectl.report.figures import embedded
from stagectl.report.gap import figures
from stagectl.report.gap.chain import SIGNALS, chain
from stagectl.report.page import Page, Picture, Section, Table

MOST_SIGNATURES = 6
_UNIT = re.compile(r"([0-9]) (%|[nµm]?(?:m|rad|A|N|s)\b)")


def page(found: DiagnosisResult, place: str, commands: list[str]) -> Page:
    """The page of the diagnosis of the folder `place`; `commands` do it again."""
    parts = (_loop, _motion, _shares, _distance, _signatures, _unknown, _following, _parameters, _limits)
    sections = [part(found, place) for part in parts]
    return Page(
        f"stagectl gap diagnose: {place}",
        typeset(found.sentence or verdict_text.sentence(found)),
        _remark(found),
        [],
        [],
        commands,
        versions(),
        sections=tuple(one for one in sections if one is not None),
    )


def typeset(text: str) -> str:
    """With an arrow for ``->``, and no line break between a number and its unit."""
    return _UNIT.sub("\\1\u00a0\\2", text.replace(" -> ", "\u00a0→ "))


def _remark(found: DiagnosisResult) -> list[str]:
    """What the figures below rest on."""
    about = [f"Verdict: {found.verdict}."]
    if found.captures:
        about.append(f"From {_counted(len(found.captures), 'capture')}.")
    if found.traces:
        about.append(f"Judged on {_counted(len(found.traces), 'held-out run')} that chose nothing.")
    if found.seconds:
        about.append(f"Took {sum(seconds for _, seconds in found.seconds):.0f} s.")
    return [" ".join(about)]


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _loop(found: DiagnosisResult, _place: str) -> Section:
    return Section("Where in the loop", _loop_words(found), [chain(found)], [])


def _loop_words(found: DiagnosisResult) -> list[str]:
    known = {name: share for name, share in found.blocks.items() if share is not None}
    if found.verdict == "none":
        return ["Nothing exceeds the noise by enough to matter: the shares below are of next to nothing."]
    if not known:
        return []
    worst = max(known, key=lambda name: known[name])
    ends = ("reference", *SIGNALS)[BLOCKS.index(worst) :][:2]
    return [f"{percent(known[worst])} of the excess over noise arises in the {worst}, between {' and '.join(ends)}."]


def _motion(found: DiagnosisResult, _place: str) -> Section | None:
    shown = []
    if found.coordinates:
        shown.append(
            _picture(figures.coordinates(found), "What the gap follows; coordinates overlap, so these do not add up.")
        )
    if found.captures:
        drawn = len(figures.most_open(found))
        rest = (
            ""
            if drawn == len(found.captures)
            else f" The {drawn} of {len(found.captures)} in which it is open longest."
        )
        shown.append(_picture(figures.spans(found), f"When the gap is open (orange), a row a capture.{rest}"))
    return Section("Where in the motion", [], shown, []) if shown else None


def _picture(figure: Figure, caption: str, least: int = 0) -> Picture:
    return Picture(embedded(figure, figures.DPI), caption, least)


def _shares(found: DiagnosisResult, _place: str) -> Section | None:
    tables = [_effects(found)] if found.effects else []
    shown = [_picture(figures.shares(found), "The squared gap on held-out runs taken apart; the parts make 100 %.")]
    if not found.shares:
        shown = []
    return Section("Which effect", [], shown, tables) if shown or tables else None


def _effects(found: DiagnosisResult) -> Table:
    rows = [row for one in found.effects for row in _effect(one)]
    return Table("", ["effect", "in", "share of closable gap", "probability"], rows)


def _effect(one: FoundEffect) -> list[list[str]]:
    """A row, and one for each effect that would fit as well."""
    probability = f"{one.probability:.2f}" + ("" if one.probability >= NAMED else ": not named")
    rest = [[f"or {library.label(name)}", "", "", ""] for name in one.alternatives]
    return [[library.label(one.name), one.block, percent(one.share), probability], *rest]


def _distance(found: DiagnosisResult, _place: str) -> Section | None:
    if found.verdict == "controller":
        return None
    known = {"position" if found.gap.unit in ("rad", "m") else "effort": found.gap, **found.gaps}
    rows = [_row(verdict_text.called(name), one, found) for name, one in known.items()]
    head = ["rms on held-out runs", "before", "after", "unit", "factor", "noise floor", "closed (95 %)"]
    run = figures.telling(found)
    shown = []
    if run is not None:
        caption = f"{run.file}, the held-out run with the largest gap: its {_window(run)} with the largest gap."
        shown.append(_picture(figures.trace(run, found), caption, 700))
    return Section("How far it shrinks", _predicted(found), shown, [Table("", head, rows)])


def _window(run: Trace) -> str:
    part = run.time[figures.window(run)]
    return f"{part[-1] - part[0]:.2g} s"


def _row(name: str, one: Gap, found: DiagnosisResult) -> list[str]:
    (before, after, floor), unit = together((one.before, one.after, one.floor), one.unit, found)
    factor = f"{one.before / one.after:.1f}" if one.after > 0.0 else ""
    return [name, before, after, unit, factor, floor, _closed(one, found)]


def _closed(one: Gap, found: DiagnosisResult) -> str:
    if found.verdict == "none":
        return "nothing to close"
    return verdict_text.closure(one) if math.isfinite(one.closure) else "not known"


def _predicted(found: DiagnosisResult) -> list[str]:
    if found.gap.predicted is None or found.verdict == "none":
        return []
    return [
        f"Expected beforehand, on the data that chose the effects: {percent(found.gap.predicted)} of the closable gap "
        f"closed; reached on the held-out runs: {percent(found.gap.closure)}."
    ]


def _signatures(found: DiagnosisResult, _place: str) -> Section | None:
    drawn = [one for one in found.named if one.curve is not None][:MOST_SIGNATURES]
    shown = [_picture(figures.signature(one, found), f"{_name(one)}: {_told(one, found)}") for one in drawn]
    title = "How it shows" if len(shown) == 1 else "How they show"
    return Section(title, [], shown, []) if shown else None


def _name(one: FoundEffect) -> str:
    name = library.label(one.name)
    return name[:1].upper() + name[1:]


def _told(one: FoundEffect, found: DiagnosisResult) -> str:
    shown = [f"{name.replace('_', ' ')} {parameter(name, value, found)}" for name, value in one.parameters.items()]
    return f"{', '.join(shown)}." if shown else "no parameters."


_CAPTIONS = {
    "frequency": "What is unknown: root mean square in each half octave.",
    "time": "What is unknown: friction at half the largest speed over the session, less its mean.",
    "none": "What is unknown, positive where it opposes the motor.",
}


def _unknown(found: DiagnosisResult, place: str) -> Section | None:
    if found.unknown is None:
        return None
    one = found.unknown
    if one.coordinate == "none":
        lost = (
            "What repeats and has no name follows no coordinate that was tried: it is more than any law of friction "
            "leaves along the measured path, or it keeps the simulated loop from following the machine."
        )
        return Section("What has no name", [lost], [], [], ())
    said = [f"What repeats and has no name: {verdict_text.where_unknown(one)}. It is no cause, only a shape."]
    shown = [_picture(figures.shape(found), _CAPTIONS.get(one.coordinate, _CAPTIONS["none"]))]
    commands = (f"stagectl gap apply {place} STAGE.yaml --unknown",) if one.fields else ()
    return Section("What has no name", said, shown, [], commands)


def _following(found: DiagnosisResult, place: str) -> Section | None:
    said = [*verdict_text.ambiguous(found), *verdict_text.advice(found)]
    commands = []
    if found.next_experiment is not None and found.next_experiment.trajectory:
        commands = [f"stagectl gap next {place}", f"stagectl run STAGE.yaml {found.next_experiment.trajectory}"]
    if any(one.fields for one in found.named):
        said.append("What is named goes into the stage model as a patch that is shown before it is written:")
        commands.append(f"stagectl gap apply {place} STAGE.yaml")
    title = "What is ambiguous, and what to do next" if verdict_text.ambiguous(found) else "What to do next"
    return Section(title, said, [], [], tuple(commands)) if said else None


def _parameters(found: DiagnosisResult, _place: str) -> Section | None:
    rows = [
        [library.label(one.name), name.replace("_", " "), parameter(name, value, found)]
        for one in found.named
        for name, value in one.parameters.items()
    ]
    return Section("Parameters", [], [], [Table("", ["effect", "", "value (95 % interval)"], rows)]) if rows else None


def _limits(found: DiagnosisResult, _place: str) -> Section | None:
    said = [*(f"Cannot be told: {one}" for one in found.cannot_tell), *found.notes]
    return Section("Notes, and what cannot be told", said, [], []) if said else None
