"""The command `gap fleet`: `gap diagnose` over the folders of many machines."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stagectl.cli.gap_diagnose import Exclude, Full
from stagectl.cli.options import Json
from stagectl.cli.show import console, emit, progress, single_threaded_algebra

if TYPE_CHECKING:
    from stagectl_studies.fleet import FleetMachine, MachineSummary

Folders = Annotated[list[Path], typer.Argument(metavar="FOLDER...", help="One folder per machine.")]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Diagnose on the Dask cluster of this scheduler.")
]


def fleet(
    folders: Folders, scheduler: Scheduler = None, exclude: Exclude = None, full: Full = False, json: Json = None
) -> None:
    """Diagnose many machines, one folder each: verdict, gap, and its drift since the last diagnosis.

    Example: stagectl gap fleet captures/machine-*
    """
    single_threaded_algebra()
    from rich.table import Table

    from stagectl.gap.effects.library import excluded
    from stagectl.typed_json import finite
    from stagectl_studies.fleet import FleetMachine, names_of

    names = excluded(exclude or [])
    places = [folder.resolve() for folder in folders]
    machines = [
        FleetMachine(str(place), name, names, full) for place, name in zip(places, names_of(places), strict=True)
    ]
    with progress("machines", len(machines)) as update:
        summaries = sorted(
            _counted(_lines(machines, scheduler), len(machines), update), key=lambda summary: summary.machine
        )
    table = Table("machine", "verdict", "named", "gap", "left", "drift")
    for summary in summaries:
        table.add_row(*_cells(summary))
    console.print(table)
    lost = [summary for summary in summaries if not summary.verdict]
    for summary in lost:
        console.print(f"{summary.machine}: {summary.words}")
    rows = [{**summary._asdict(), "gap": finite(summary.gap), "left": finite(summary.left)} for summary in summaries]
    emit({"machines": rows}, json, not lost)


def _lines(machines: Sequence[FleetMachine], scheduler: str | None) -> Iterable[MachineSummary]:
    from stagectl_studies.cluster import on_cluster
    from stagectl_studies.fleet import diagnosed

    return map(diagnosed, machines) if scheduler is None else on_cluster(diagnosed, machines, scheduler)


def _counted(lines: Iterable[MachineSummary], whole: int, update: object) -> Iterator[MachineSummary]:
    for done, summary in enumerate(lines, 1):
        if callable(update):
            update(done, whole)
        yield summary


def _cells(machine: MachineSummary) -> list[str]:
    if not machine.verdict:
        return [machine.machine, "not diagnosed", "", "", "", ""]
    drift = "first" if machine.drift is None else f"{100.0 * machine.drift:+.0f} %"
    return [
        machine.machine,
        machine.verdict,
        ", ".join(machine.named),
        *(f"{x:.3g} {machine.unit}" for x in (machine.gap, machine.left)),
        drift,
    ]
