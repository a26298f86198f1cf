"""The page of `peers.measure`, in the design of all reports, and the same figures as a page of the manual."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from stagectl.report.figures import STYLE, TARGET, WITH, WITHOUT, embedded
from stagectl.report.page import Page, Picture, Section, Table, write

EVEN = 1.1  # times; closer than that nobody is ahead
COMMANDS = ["pip install -e '.[bench]'", "python tools/bench --page bench.html"]
HEAD = ["what", "peer", "ours", "theirs", "theirs / ours", "quartiles", ""]
_EXAM = (
    "single effect, top-1 at >= 2x its limit",
    "pairs, all found",
    "null, false alarms",
    "effect left out: unknown",
    "closure, single effect",
)
_MEANING = (
    "In all comparisons less is better. Each round measures both and gives a ratio, theirs over ours. Above 1, ours is "
    "ahead. The table shows the median of these ratios, which may differ from the ratio of the two medians."
)
Line = dict[str, Any]


def standing(line: Line) -> str:
    """Whether ours is ahead, less being better; open where the quartiles of the rounds lie on both sides of 1."""
    low, ratio, high = (line["ratio"][name] for name in ("low", "median", "high"))
    if low <= 1.0 <= high or 1.0 / EVEN <= ratio <= EVEN:
        return "open"
    return "ahead" if ratio > 1.0 else "behind"


def answer(found: dict[str, Any]) -> str:
    """The whole in two sentences: wins as well as losses."""
    lines = _lines(found)
    count = {word: sum(standing(line) == word for line in lines) for word in ("ahead", "open", "behind")}
    words = (
        f"Ahead in {count['ahead']} of {len(lines)} comparisons, behind in {count['behind']}, open in {count['open']}."
    )
    worst = min(lines, key=lambda line: line["ratio"]["median"])
    if standing(worst) != "behind":
        return words
    return (
        f"{words} Furthest behind: {worst['what']}, {_times(1.0 / worst['ratio']['median'])} that of {worst['peer']}."
    )


def _lines(found: dict[str, Any]) -> list[Line]:
    return [line for part in found["parts"].values() for line in part["against"]]


def page(found: dict[str, Any]) -> Page:
    """All of it."""
    glance = Section("At a glance", [], [Picture(embedded(chart(_lines(found))), _CAPTION, least=640)], [])
    return Page(
        title="stagectl and its peers",
        answer=answer(found),
        notes=[
            _circumstances(found),
            _MEANING,
        ],
        figures=[],
        tables=[],
        commands=COMMANDS,
        versions=found["versions"],
        sections=(glance, *_sections(found)),
    )


_CAPTION = "Theirs over ours, median and quartiles of the rounds: to the right of 1 ours is ahead."


def _circumstances(found: dict[str, Any]) -> str:
    return (
        f"Measured {found['date']} on {found['machine']}, load {found['load']:g}.  Ours and theirs take turns, so "
        "a busy machine disturbs both: compare the ratios, not the times."
    )


def _sections(found: dict[str, Any]) -> list[Section]:
    sections = []
    for topic, lines in _topics(_lines(found)):
        methods = dict.fromkeys(line["method"] for line in lines)
        words = [f"{method[0].upper()}{method[1:]}." for method in methods]
        sections.append(Section(topic, words, [], [Table("", HEAD, [_row(line) for line in lines])]))
    sections.append(Section("Gap diagnosis", _exam_words(found["exam"]), [], _exam_tables(found["exam"])))
    rows = [[what, why] for part in found["parts"].values() for what, why in part["skipped"].items()]
    if rows:
        sections.append(Section("Not measured", [], [], [Table("", ["what", "why"], rows)]))
    return sections


def _topics(lines: Sequence[Line]) -> list[tuple[str, list[Line]]]:
    return [(topic, list(group)) for topic, group in itertools.groupby(lines, key=lambda line: str(line["topic"]))]


def _row(line: Line) -> list[str]:
    ratio, unit = line["ratio"], line["unit"]
    values = [f"{_plain(line[side]['median'])} {unit}" for side in ("ours", "theirs")]
    spread = f"{_plain(ratio['low'])} to {_plain(ratio['high'])}"
    return [line["what"], line["peer"], *values, _times(ratio["median"]), spread, standing(line)]


def _times(ratio: float) -> str:
    return f"{_plain(ratio)} x"


def _plain(value: float) -> str:
    return f"{value:.0f}" if value >= 100.0 else f"{value:.2g}"


def _exam_words(exam: dict[str, Any]) -> list[str]:
    last = exam["last"]
    words = [f"Read from the exams that were held, not measured here: the last large one is of {last['date'][:10]}."]
    if exam["beside"]:
        words.append("The oracle knows the effects; the others do not. The black box names nothing.")
    else:
        words.append(
            "No exam with the baselines (refit, ladder of friction models, sparse regression, boosted trees, oracle) "
            "is in the ledger yet: nothing is claimed against them. `stagectl gap exam --baselines` holds one."
        )
    return words


def _exam_tables(exam: dict[str, Any]) -> list[Table]:
    last = exam["last"]
    rows = [[name, f"{100.0 * last['scores'][name][0]:.0f} %", str(last["scores"][name][1])] for name in _EXAM]
    way = f"{last['trials']} trials on the {'full' if last['full'] else 'fast'} path"
    title = f"The last exam of a hundred trials or more, version {last['version']}, {way}"
    tables = [Table(title, ["figure", "diagnosis", "trials"], rows)]
    if exam["beside"]:
        names = [one["name"] for one in exam["beside"]]
        kinds = [row["name"] for row in exam["beside"][0]["rows"]]
        cells = [[_value(one["rows"][k]["value"]) for one in exam["beside"]] for k in range(len(kinds))]
        counts = [str(row["trials"]) for row in exam["beside"][0]["rows"]]
        body = [[kind, *row, count] for kind, row, count in zip(kinds, cells, counts, strict=True)]
        tables.append(Table("Diagnosis and baselines on the same trials", ["figure", *names, "trials"], body))
    return tables


def _value(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.0f} %"


def chart(lines: Sequence[Line]) -> Figure:
    """A dot with its quartiles for each comparison, by topic, over a logarithmic ratio."""
    colours = {"ahead": WITH, "open": TARGET, "behind": WITHOUT}
    places, labels, at = list[float](), list[str](), 0.0
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(9.0, 0.21 * len(lines) + 1.9))
        for topic, group in _topics(lines):
            axes.text(
                0.0, at, f"{topic} ", transform=axes.get_yaxis_transform(), ha="right", va="center", fontweight="bold"
            )
            for line in group:
                at += 1.0
                ratio, colour = line["ratio"], colours[standing(line)]
                axes.plot([ratio["low"], ratio["high"]], [at, at], color=colour, linewidth=1.2)
                axes.plot(ratio["median"], at, "o", color=colour, markersize=4.5)
                places.append(at)
                labels.append(f"{line['what']} ({line['peer']})")
            at += 1.6
        axes.set_yticks(places, labels, fontsize=7.5)
        axes.set_ylim(at - 0.6, -1.0)
        axes.axvline(1.0, color=TARGET, linewidth=0.8)
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("theirs / ours   (left of 1: behind, right: ahead)")
        figure.subplots_adjust(left=0.37, right=0.98, top=0.99, bottom=0.07)
    return figure


def manual(found: dict[str, Any]) -> str:
    """The same as Markdown."""
    parts = [
        "# Figures against peers",
        "How fast, small and accurate is stagectl, compared with other tools for the same task?",
        answer(found),
        f"{_MEANING} {_circumstances(found)} `python tools/bench --page bench.html` measures them on your machine "
        "(`pip install -e '.[bench]'`, `apt install rt-tests`).",
        f"Versions: {', '.join(' '.join(one) for one in found['versions'].items())}.",
    ]
    for section in _sections(found):
        parts += [f"## {section.title}", *section.words]
        for table in section.tables:
            parts += [*([table.title + ":"] if table.title else []), _markdown(table)]
    return "\n\n".join(parts) + "\n"


def _markdown(table: Table) -> str:
    lines = [table.head, ["---"] * len(table.head), *table.rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def write_all(found: dict[str, Any], html: Path | None, markdown: Path | None) -> None:
    """What is asked for."""
    if html:
        print(f"report: {write(page(found), html)}")
    if markdown:
        markdown.write_text(manual(found), encoding="utf-8")
        print(f"manual: {markdown}")
