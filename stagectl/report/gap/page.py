"""The page of a diagnosis: the verdict, where the gap arises, which effects cause it, and how far it shrinks."""

import shlex

from matplotlib.figure import Figure

from stagectl.gap.effects.library import label
from stagectl.gap.result import remarks_text, verdict_text
from stagectl.gap.result.diagnosis import BLOCKS, HELD_OUT, NOISE, DiagnosisResult
from stagectl.number_format import percent
from stagectl.report import interactive
from stagectl.report.constants import LEAST_SHARE
from stagectl.report.gap import figures
from stagectl.report.gap.chain import SIGNALS, chain
from stagectl.report.page import Page, Picture, Section
from stagectl.report.tables import gap as tables

_ANY_STAGE = "STAGE.yaml"  # of logs that no file is known for


def page(result: DiagnosisResult, place: str, commands: list[str], stored: str = "", stage: str = _ANY_STAGE) -> Page:
    """The page of the diagnosis of the logs at `place`; `commands` do it again, those that follow read `stored`.

    `stage` is the stage file that those that follow take.
    """
    sections = [
        Section("Where in the loop", _largest_block(result), [chain(result)]),
        *_motion(result),
        *_shares(result),
        *_distance(result),
        *_unknown(result, stored or place),
        *_following(result, stored or place),
        *([Section("Parameters", tables=[values])] if (values := tables.values(result)).rows else []),
        *([Section("Notes and limits", lines)] if (lines := remarks_text.remarks(result)) else []),
    ]
    named = shlex.quote(stage)
    return Page(
        f"stagectl gap diagnose: {place}",
        result.sentence or verdict_text.sentence(result),
        _basis(result),
        commands=commands,
        sections=[
            section._replace(commands=[line.replace(_ANY_STAGE, named) for line in section.commands])
            for section in sections
        ],
    )


def _basis(result: DiagnosisResult) -> list[str]:
    """The data behind the page."""
    about = [f"Verdict: {result.verdict}."]
    if result.captures:
        about.append(f"Data: {_counted(len(result.captures), 'capture')}.")
    if result.traces:
        experiments = f" of {_counted(len(result.traces), 'experiment')}" if result.judged_on == HELD_OUT else ""
        about.append(f"Checked on {result.judged_on}{experiments}.")
    if result.seconds:
        about.append(f"Computing time: {sum(seconds for _, seconds in result.seconds):.0f} s.")
    return [*(f"Doubtful data: {doubt}." for doubt in result.doubts), " ".join(about)]


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _largest_block(result: DiagnosisResult) -> list[str]:
    known = {name: share for name, share in result.blocks.items() if share is not None}
    if result.verdict == "none":
        return ["The gap does not exceed the noise significantly, so the shares below mean little."]
    if not known:
        return []
    worst = max(known, key=lambda name: known[name])
    ends = ("reference", *SIGNALS)[BLOCKS.index(worst) :][:2]
    return [
        f"{percent(known[worst])} of the known causes lie in the {worst}, between {' and '.join(ends)}.",
        *_parts(result),
    ]


def _parts(result: DiagnosisResult) -> list[str]:
    """Who holds the gap of the forces, the largest first; nothing where one holds it all."""
    ranked = sorted((part for part in result.parts if part.share >= LEAST_SHARE), key=lambda part: -part.share)
    held = [f"{label(part.name)} {percent(part.share)} ({part.block})" for part in ranked]
    return [f"Of the excess of the forces over noise: {', '.join(held)}."] if len(held) > 1 else []


def _motion(result: DiagnosisResult) -> list[Section]:
    pictures = []
    if result.coordinates:
        least = percent(LEAST_SHARE)
        caption = (
            "Share of the gap that follows each coordinate. Coordinates overlap, so the shares do not add up. "
            f"Those below {least} are left out."
        )
        pictures.append(_picture(figures.coordinates(result), caption))
    if result.captures:
        drawn, count = len(figures.most_open(result)), len(result.captures)
        rest = "" if drawn == count else f" These are the {drawn} of {count} captures with the longest times."
        pictures.append(_picture(figures.spans(result), f"Times with a gap (orange), one row per capture.{rest}"))
    return [Section("Where in the motion", [], pictures)] if pictures else []


def _picture(figure: Figure, caption: str, least: int = 0) -> Picture:
    return interactive.picture(figure, caption, figures.DPI, least)


def _shares(result: DiagnosisResult) -> list[Section]:
    effects = [tables.effects(result)] if result.effects else []
    noise = ' Without the noise ("not repeatable") it is the closable gap.' if dict(result.shares).get(NOISE) else ""
    caption = f"The squared gap on {result.judged_on}, split into its parts, which add up to 100 %.{noise}"
    pictures = [_picture(figures.shares(result), caption)] if result.shares else []
    return [Section("Which effect", [], pictures, effects)] if pictures or effects else []


def _distance(result: DiagnosisResult) -> list[Section]:
    if result.verdict == "controller":
        return []
    run = figures.largest_trace(result)
    pictures = []
    if run is not None:
        window = run.time[figures.window(run)]
        caption = f"{run.file}, the run with the largest gap: its worst {window[-1] - window[0]:.2g} s."
        pictures.append(_picture(figures.trace(run, result), caption, 700))
    return [Section("How far the gap shrinks", _predicted(result), pictures, [tables.gaps(result)])]


def _predicted(result: DiagnosisResult) -> list[str]:
    if result.gap.predicted is None or result.verdict == "none":
        return []
    return [
        f"Predicted from the data that selected the effects: {percent(result.gap.predicted)} of the closable gap "
        f"closes. Measured on {result.judged_on}: {percent(result.gap.closure)}."
    ]


_UNKNOWN_TITLE = "Unexplained"
_CAPTIONS = {
    "frequency": "Unexplained effort: root mean square in each half octave.",
    "time": "Unexplained friction at half the largest speed over the session, minus its mean.",
}
_CAPTION = "Unexplained effort, positive where it opposes the motor."


def _unknown(result: DiagnosisResult, place: str) -> list[Section]:
    term = result.unknown
    if term is None:
        return []
    if term.coordinate == "none":
        text = (
            "A part of the gap repeats but follows no coordinate. It is larger than the error of any friction law "
            "along the measured path, or it keeps the simulated loop from following the machine."
        )
        return [Section(_UNKNOWN_TITLE, [text])]
    text = f"A part of the gap has no known cause: {verdict_text.where_unknown(term, result.travel)}."
    pictures = [_picture(figures.unknown(result), _CAPTIONS.get(term.coordinate, _CAPTION))]
    commands = (f"stagectl gap apply {place} {_ANY_STAGE} --unknown",) if term.fields else ()
    return [Section(_UNKNOWN_TITLE, [text], pictures, [], commands)]


def _following(result: DiagnosisResult, place: str) -> list[Section]:
    ambiguous = remarks_text.ambiguous(result)
    lines = [*ambiguous, *remarks_text.outside(result), *remarks_text.advice(result)]
    commands = []
    if result.next_experiment is not None and result.next_experiment.trajectory:
        lines.append("The command gap next writes it, and prints the commands that run it and diagnose again.")
        commands = [f"stagectl gap next {place}"]
    if result.writes:
        lines.append(
            "The command gap apply writes what was found into the stage file. It shows the patch before it writes."
        )
        commands.append(f"stagectl gap apply {place} {_ANY_STAGE}")
    title = "Ambiguities and next steps" if ambiguous else "Next steps"
    return [Section(title, lines, commands=commands)] if lines else []
