"""The page of an exam: what was reached first, then what was taken for what, from which size, how sure, how far."""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from stagectl.recording.metadata import versions
from stagectl.report.figures import embedded
from stagectl.report.page import Page, Picture, Section, Table
from stagectl.report.panels import DPI
from stagectl_studies.exam import closed_table, figures

REACHED = {"target": "target", "must": "reached", "no": "not reached", "": ""}
HEAD = ["", "found", "95 %", "trials", "target", "must reach", ""]


def page(result: Mapping[str, Any], seconds: Mapping[str, Sequence[float]], commands: list[str]) -> Page:
    """The page of the `result` of an exam, as scores.json holds it."""
    sections = [_naming(result), _size(result), _sure(result), _far(result), _beside(result)]
    sections += [closed_table.section(result["records"]), _seconds(seconds)]
    return Page(
        "stagectl gap exam",
        answer(result),
        _notes(result),
        [],
        [Table("What was asked", HEAD, [cells(row) for row in result["rows"]])],
        commands,
        versions(),
        sections=tuple(section for section in sections if section is not None),
    )


def answer(result: Mapping[str, Any]) -> str:
    """How many of the figures asked for were reached."""
    asked = [row for row in result["rows"] if row["reached"]]
    target = sum(row["reached"] == "target" for row in asked)
    must = sum(row["reached"] in ("target", "must") for row in asked)
    missed = [row["name"].strip() for row in asked if row["reached"] == "no"]
    rest = f" Not reached: {', '.join(missed)}." if missed else ""
    open_ = [row["name"].strip() for row in result["rows"] if row["must"] is not None and not row["reached"]]
    rest += f" Not measured: {', '.join(open_)}." if open_ else ""
    trials = result["trials"] - len(result["void"])
    return (
        f"{must} of {len(asked)} figures reach what they must, {target} their target, on {trials} sealed trials.{rest}"
    )


def _notes(result: Mapping[str, Any]) -> list[str]:
    exam = result["exam"]
    battery = "a battery of 20 s" if exam["short"] else "the recommended battery"
    path = "full" if exam["full"] else "fast"
    notes = [f"Seed {exam['seed']}, {battery}, the diagnosis' {path} path. Trials: {_strata(result['strata'])}."]
    if "stopped after" in exam:
        notes.append(f"The first {exam['stopped after']} of {exam['trials']} trials, in the order that the seed gives.")
    if result["void"]:
        notes.append(f"Void and not counted: {_reasons(result['void'])}.")
    if result["failed"]:
        notes.append(f"Failed, and counted as having said nothing: {_reasons(result['failed'])}.")
    return notes


def _strata(strata: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in strata.items())


def _reasons(trials: Sequence[Mapping[str, Any]]) -> str:
    return "; ".join(f"trial {trial['number']} ({'; '.join(trial['reasons'])})" for trial in trials)


def cells(row: Mapping[str, Any]) -> list[str]:
    """A line of the table."""
    bounds = "" if row["low"] is None else f"{number(row, 'low')} to {number(row, 'high')}"
    side = "≤ " if row["most"] else "≥ "
    asked = [f"{side}{number(row, key)}" if row[key] is not None else "" for key in ("target", "must")]
    indent = "\u2003" if row["name"].startswith("  ") else ""
    name = f"{indent}{row['name'].strip()}"
    return [name, number(row, "value"), bounds, str(row["trials"]), *asked, REACHED[row["reached"]]]


def number(row: Mapping[str, Any], key: str) -> str:
    """A value as its row's kind is read: rates in per cent."""
    value = row[key]
    if value is None:
        return ""
    return f"{100.0 * value:.0f}\u00a0%" if row["kind"] == "rate" else f"{value:.3g}"


def _naming(result: Mapping[str, Any]) -> Section | None:
    if not result["confusion"]:
        return None
    remark = (
        "Trials with one hidden effect of any size, or none. What is true beside it (values that are off) is left out."
    )
    picture = _picture(figures.confusion(result["confusion"]), "Numbers of trials; orange: taken for something else.")
    return Section("What was taken for what", [remark], [picture._replace(least=760)], [])


def _size(result: Mapping[str, Any]) -> Section | None:
    if not result["classes"]:
        return None
    remark = (
        "The bar is the size at which half of the trials of a class are noticed, from a logistic curve with one "
        "steepness for all. Naming is judged at twice that."
    )
    rows = [
        [
            kind["class"],
            f"{'< ' if kind['below'] else ''}{kind['limit']:.2g}",
            f"{kind['low']:.2g} to {kind['high']:.2g}",
            f"{kind['noticed']} of {kind['trials']}",
            f"{kind['named']} of {kind['clear']}",
        ]
        for kind in result["classes"]
    ]
    table = Table("", ["class", "limit, x typical", "95 %", "noticed", "named at twice the limit"], rows)
    picture = _picture(figures.limits(result["classes"]), "One point a trial.")
    return Section("From which size effects are noticed", [remark], [picture], [table, _effects(result)])


def _effects(result: Mapping[str, Any]) -> Table:
    rows = [
        [figures.called(name), str(value["trials"]), str(value["noticed"]), str(value["named"])]
        for name, value in result["by_effect"].items()
    ]
    return Table("Single effects, all sizes", ["effect", "trials", "noticed", "named first"], rows)


def _sure(result: Mapping[str, Any]) -> Section | None:
    if not any(group["count"] for group in result["reliability"]):
        return None
    picture = _picture(figures.reliability(result["reliability"]), "Numbers: entries of answers in that bin.")
    return Section("How sure, and how often right", [], [picture], [])


def _far(result: Mapping[str, Any]) -> Section | None:
    scored = [record for record in result["records"] if "gap" in record]
    hidden = [record for record in scored if record["truth"]["hidden"]]
    open_ = [record for record in hidden if record["gap"]["before"] > record["gap"]["floor"]]
    pictures = []
    if any(record["gap"]["predicted"] is not None for record in open_):
        pictures.append(_picture(figures.closures(open_), "One point a trial whose gap exceeds the floor."))
    if result["oracle_ratios"]:
        pictures.append(_picture(figures.ratios(result["oracle_ratios"]), "Share of trials below each ratio."))
    remark = "The closure is computed from the withheld runs without noise, which the diagnosis never had."
    return Section("How far the gap closes", [remark], pictures, []) if pictures else None


def _beside(result: Mapping[str, Any]) -> Section | None:
    if not result["beside"]:
        return None
    head = ["", *(baseline["name"] for baseline in result["beside"])]
    lines = zip(*(baseline["rows"] for baseline in result["beside"]), strict=True)
    rows = [[line[0]["name"], *(_with_interval(row) for row in line)] for line in lines]
    return Section("Beside simpler methods on the same trials", [], [], [Table("", head, rows)])


def _with_interval(row: Mapping[str, Any]) -> str:
    if row["value"] is None:
        return ""
    return f"{number(row, 'value')} ({number(row, 'low')} to {number(row, 'high')})"


def _seconds(seconds: Mapping[str, Sequence[float]]) -> Section | None:
    rows = [
        [name, f"{sorted(each)[len(each) // 2]:.1f} s", f"{max(each):.1f} s"] for name, each in seconds.items() if each
    ]
    return Section("Seconds a trial", [], [], [Table("", ["", "median", "longest"], rows)]) if rows else None


def _picture(figure: Figure, caption: str) -> Picture:
    return Picture(embedded(figure, DPI), caption)
