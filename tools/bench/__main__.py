"""The benchmarks of the project: ``python tools/bench [--quick] [--json FILE]``; ``--page FILE`` compares with peers.

Every figure is a median with quartiles (extremes below four values); contenders run interleaved in one
process, so that a busy machine disturbs all alike.  Bounds come from the issue; a line that misses its bound
is shown as such.  It is a benchmark, not a test: the exit code is 0 whatever the verdicts.
"""

import argparse
import importlib.util
import json
import os
import platform
import sys
import tempfile
import time
from pathlib import Path

import cycle
import engines
import gap
import identification
import peers
import processes
import simulator
import twin
from measure import Row, Wanted, as_json, spread
from rich.console import Console
from rich.table import Table
from scene import STAGE

from stagectl.service import virtual_drive

console = Console(width=None if sys.stdout.isatty() else 132, highlight=False)


def main() -> None:
    """Measure, show, write."""
    parser = argparse.ArgumentParser(prog="bench", description="Measure what the project promises.")
    parser.add_argument("--quick", action="store_true", help="fewer rounds, without the memory of long captures")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures there")
    parser.add_argument("--page", type=Path, metavar="FILE.html", help="measure against peers instead; write a page")
    parser.add_argument("--manual", type=Path, metavar="FILE.md", help="with --page: the same as Markdown")
    parser.add_argument("--exam", type=Path, metavar="scores.json", help="with --page: an exam held with --baselines")
    parser.add_argument(
        "--only", choices=peers.PARTS, default="", help="with --page: one part anew, others from --json"
    )
    chosen = parser.parse_args()
    if importlib.util.find_spec("mujoco") is None:
        parser.error("MuJoCo is not installed, and there is nothing to compare with: pip install -e '.[bench]'")
    if chosen.page:
        peers.main(chosen.page, chosen.manual, chosen.json, peers.Wish(chosen.quick, chosen.only, chosen.exam))
        return
    _promises(chosen)


def _promises(chosen: argparse.Namespace) -> None:
    begin = time.perf_counter()
    rounds = 5 if chosen.quick else 25
    table = simulator.tracking()
    factors = simulator.speed(4 * rounds)
    rows = [
        *simulator.rows(factors, table),
        *engines.rows(rounds),
        *processes.starts(rounds),
        *_on_the_bus(2 if chosen.quick else 5),
    ]
    with tempfile.TemporaryDirectory(prefix="stagectl-") as folder:
        rows += identification.rows(Path(folder), 1 if chosen.quick else 3, memory=not chosen.quick)
        rows += gap.rows(Path(folder) / "gap", 3 if chosen.quick else 9)
    machine = f"{platform.machine()}, {os.cpu_count()} CPUs, Python {platform.python_version()}, {platform.release()}"
    _show(rows)
    _show_tracking(table, factors)
    _show_methods(rows)
    console.print(f"\n{machine}; load {os.getloadavg()[0]:.1f}; {time.perf_counter() - begin:.0f} s")
    if chosen.json:
        result = {
            "machine": machine,
            "rows": [as_json(row) for row in rows],
            "tracking": [{**line._asdict(), "holds": line.holds} for line in table],
        }
        chosen.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


def _on_the_bus(rounds: int) -> list[Row]:
    with tempfile.TemporaryDirectory(prefix="stagectl-") as folder:
        channel = str(Path(folder) / "bus")
        node = virtual_drive.start(STAGE, channel, 1)
        try:
            place = Path(folder)
            return [
                *cycle.rows(channel, rounds),
                *processes.rows(channel, place, rounds),
                *twin.rows(channel, place, rounds),
            ]
        finally:
            node.terminate()
            node.wait()


def _show(rows: list[Row]) -> None:
    table = Table(title="stagectl bench")
    for title in ("what", "measured", "quartiles", "wanted", "margin", "verdict"):
        table.add_column(title, justify="left" if title in ("what", "verdict") else "right")
    for row in rows:
        low, median, high = row.measured
        ratio = "" if row.ratio is None else f"{row.ratio:.2f} x"
        style = {"met": "green", "not met": "bold red", "": "none"}[row.verdict]
        measured, quartiles = f"{median:.4g} {row.unit}", f"{low:.4g} - {high:.4g}"
        table.add_row(row.what, measured, quartiles, _bound(row.wanted), ratio, f"[{style}]{row.verdict}[/]")
    console.print(table)


def _bound(wanted: Wanted | None) -> str:
    if wanted is None:
        return ""
    return f"{'>=' if wanted.at_least else '<='} {wanted.bound:g}"


def _show_tracking(lines: list[simulator.Tracking], factors: dict[int, list[float]]) -> None:
    table = Table(
        title="tracking error over the integrator's steps per control period: peak in the steady window, um",
        caption="wanted: none 4.9-5.6 (nd 0), 5.1-6.1 (nd 1); with <= 0.03, 2 um sine <= 0.02",
    )
    bare, compensated = simulator.SINES, (*simulator.SINES, simulator.TINY)
    table.add_column("steps", justify="right")
    for title in ("speed", "nd", *(f"none {m[5:]}" for m in bare), *(f"with {m[5:]}" for m in compensated), "holds"):
        table.add_column(title, justify="right")
    for line in lines:
        speed = f"{spread(factors[line.substeps]).median:.0f} x"
        peaks = [*(f"{line.bare[m]:.2f}" for m in bare), *(f"{line.compensated[m]:.4f}" for m in compensated)]
        table.add_row(str(line.substeps), speed, str(line.nd), *peaks, "yes" if line.holds else "[bold red]no[/]")
    console.print(table)


def _show_methods(rows: list[Row]) -> None:
    console.print("\n[bold]How it was measured[/]")
    methods: dict[str, list[str]] = {}
    for row in rows:
        methods.setdefault(row.method, []).append(row.what.strip())
    for method, names in methods.items():
        console.print(f"- [bold]{', '.join(names)}[/]: {method}", soft_wrap=True)
    console.print(engines.__doc__, soft_wrap=True)
    console.print(identification.__doc__, soft_wrap=True)


if __name__ == "__main__":
    main()
