"""Commands of the live twin: what it observes now, and the drift over days."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from stagectl.api.arguments import terminal
from stagectl.cli.options import Json, argument, option
from stagectl.cli.show import console, emit, stream
from stagectl.number_format import NORMAL, duration
from stagectl.units import StageError, unit_on

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

_POLL = 0.25  # s
_SILENCE = 5.0  # s without a snapshot, after which the twin's process is looked for
_WORDS = ("parameter", "unit", "check", "residual", "meaning")  # heads of columns that hold words
_STYLES = {"none": "green", "effects": "bold yellow", "controller": "bold red"}


def watch(
    file: Annotated[
        Path | None, argument("[FILE.twin.json]", "Snapshot of one run; default: the newest in recordings/.")
    ] = None,
    once: Annotated[bool, option("--once", "Show the present snapshot and exit.")] = False,
    json: Annotated[str | None, option("--json FILE", "One JSON line per snapshot; - for standard output.")] = None,
) -> None:
    """Watch the twin of a run: residuals, drifts, and the effects that explain them.

    Example: stagectl gap watch
    """
    from rich.live import Live

    from stagectl.twin.record import load_snapshot, newest

    path = file or newest(Path("recordings"))
    if path is None:
        raise StageError("no run in recordings/ has a twin: start one with `stagectl run STAGE TRAJECTORY --twin`")
    if once or json or not terminal().is_terminal:
        console.print(_plain(path, once, json), end="")
        return
    with Live(_table(load_snapshot(path)), console=terminal(), refresh_per_second=4) as live:
        while not (ended := _ended(now := load_snapshot(path))):
            live.update(_table(now))
            time.sleep(_POLL)
        live.update(_table(now))
    console.print(ended)


def _plain(path: Path, once: bool, json: str | None) -> str:
    """Every snapshot as it comes; why there will be no more, where that is so."""
    from stagectl.twin.record import load_snapshot

    last, write = 0.0, stream(json)
    while True:
        now = load_snapshot(path)
        if now["written"] != last:
            write(now) if json else console.print(_table(now))
        last, ended = now["written"], _ended(now)
        if once or ended:
            return f"{ended}\n" if ended else ""
        time.sleep(_POLL)


def _ended(now: dict[str, Any]) -> str:
    """Why there will be no more snapshots, in words; empty while there will."""
    if now["ended"]:
        return f"the run has ended: {now['ended']}"
    silent = time.time() - now["written"]
    if silent > _SILENCE and not Path(f"/proc/{now['process']}").exists():
        return f"the twin's process {now['process']} has ended; its last record is {duration(silent)} old"
    return ""


def _table(now: dict[str, Any]) -> Group:
    from rich.console import Group

    effort = unit_on(now["kind"], "N m | N")
    title = f"{now['name']}: {now['time']:.1f} s of the run, last {now['covered']:.0f} s"
    cuts = _titled(title, "check", "residual", "meaning")
    residual = now["residual"]
    cuts.add_row("A controller", _number(residual["controller"], "A"), "command - recomputed command, largest")
    cuts.add_row("B drive", _number(residual["drive"], "A"), "measured - expected current, rms")
    cuts.add_row("C mechanics", _number(residual["mechanics"], effort), "unexplained effort, rms")
    cuts.add_row("D sensor, time", _number(residual["sensor"], "s"), "position late against current")
    return Group(cuts, _drifts(now), *_below(now))


def _drifts(now: dict[str, Any]) -> Table:
    table = _titled("against the model", "parameter", "now", "95 %", "model", "unit")
    for name, drift in now["drift"].items():
        value, half, unit = f"{drift['value']:.4g}", f"± {NORMAL * drift['error']:.2g}", drift["unit"]
        if not drift["told"]:
            value, half, unit = "-", "", f"{unit}  not determined by this motion".strip()
        table.add_row(name, value, half, f"{drift['nominal']:.4g}", unit)
    return table


def _titled(title: str, *heads: str) -> Table:
    """A table without rows yet; numbers stand on the right of their columns, words on the left."""
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for head in heads:
        table.add_column(head, justify="left" if head in _WORDS else "right")
    return table


def _below(now: dict[str, Any]) -> list[Text]:
    from rich.text import Text

    words = [Text(now["words"], style=_STYLES.get(now["verdict"], "none"))]
    if now["form"]:
        words.append(Text(now["form"]))
    if now["skipped_rows"]:
        words.append(Text(f"{now['skipped_rows']} rows were skipped: the twin had fallen behind", style="yellow"))
    words.append(Text(f"{now['behind']:.2f} s behind; {100 * now['cpu_share']:.1f} % of a core", style="dim"))
    return words


def _number(value: float | None, unit: str) -> str:
    return "not known" if value is None else f"{value:.3g} {unit}"


def drift(
    file: Annotated[Path, argument("FILE.jsonl", "Minute-by-minute record of `run --twin`.")],
    axis: Annotated[str | None, option("--axis", "Name of the axis, if the record has several.")] = None,
    json: Json = None,
) -> None:
    """Report which parameter drifts over the days, how fast, and which effect explains it.

    Example: stagectl gap drift recordings/twin-ball-screw-stage-A.jsonl
    """
    from stagectl.twin.drift import drift as trends_of
    from stagectl.twin.record import read

    drifts = trends_of(read(file), axis)
    table = _titled(str(file), "parameter", "at first", "a day", "95 %", "unit", "lines", "days")
    for trend in drifts.trends:
        values = (f"{trend.start:.4g}", f"{trend.slope:+.3g}", f"± {trend.half:.2g}", trend.unit)
        table.add_row(
            trend.name, *values, str(trend.lines), f"{trend.days:.3g}", style="yellow" if trend.drifts else ""
        )
    console.print(table)
    console.print(drifts.sentence)
    trends = {trend.name: {**trend._asdict(), "sure": trend.sure, "drifts": trend.drifts} for trend in drifts.trends}
    answer = {"named": list(drifts.named), "alternatives": list(drifts.alternatives), "sentence": drifts.sentence}
    emit({**answer, "trends": trends}, json)
