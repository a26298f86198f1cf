"""The main job on a machine with nothing but Python: a stage tracks three sines over a CAN bus.

A virtual CANopen drive with the ball-screw stage inside is one process, the controller another; each sine of
the paper runs without and with friction compensation, is recorded, and all of it ends in one page.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from stagectl.config.stage_file import Setup, load_stage
from stagectl.config.wire_checks import OWN
from stagectl.number_format import length
from stagectl.recording.hdf5 import open_recording
from stagectl.recording.metadata import versions
from stagectl.report.page import Page, Picture, Table, write
from stagectl.units import StageError
from stagectl.workflows.motion import drive_present, on_channel, perform, prepare
from stagectl.workflows.trials import Result, Shown, unsaid

SINES = ("sine-3.2hz", "sine-1.6hz", "sine-0.8hz")


def demo(output: Path, shown: Shown) -> Result:
    """Run it all; returns what each run achieved, and where the page is."""
    if not (OWN / "ball-screw.yaml").is_file():
        raise StageError(f"the demo needs the checkout's config folder, and there is none at {OWN}: run it there")
    with tempfile.TemporaryDirectory(prefix="stagectl-") as folder:
        setup = on_channel(load_stage(OWN / "ball-screw.yaml"), folder)
        with drive_present(setup, shown.say):
            results = [_pair(setup, OWN / "trajectories" / f"{sine}.yaml", output, shown) for sine in SINES]
    page = _page(results, output)
    shown.say("\n" + page.answer)
    report = write(page, output / "report.html")
    runs = [run for pair in results for run in pair]
    return {"answer": page.answer, "report": str(report), "runs": runs}


def _pair(setup: Setup, trajectory: Path, output: Path, shown: Shown) -> tuple[Result, Result]:
    """The same motion without and with friction compensation."""
    results = []
    for name, without in (("without", frozenset({"friction"})), ("with", frozenset[str]())):
        motion = prepare(setup, trajectory, without, output / f"{trajectory.stem}-{name}.h5")
        with shown.bar(f"{trajectory.stem}, {name} friction compensation", len(motion.plan.setpoints)) as update:
            result = perform(motion, shown.say if trajectory.stem == SINES[0] and without else unsaid, update)
        if result["fault"]:
            raise StageError(f"the motion stopped: {result['fault']}; the recording {result['recording']} shows why")
        results.append(result)
    return results[0], results[1]


def _page(results: list[tuple[Result, Result]], output: Path) -> Page:
    from stagectl.report.figures import embedded, motion

    worst = max(pair[1]["tracking_error"]["peak"] for pair in results)
    bare = max(pair[0]["tracking_error"]["peak"] for pair in results)
    late = sum(result["late_cycles"] for pair in results for result in pair)
    cycles = sum(result["cycles"] for pair in results for result in pair)
    pairs = [_figure_pair(*pair) for pair in results]
    figure = motion(pairs)
    figure.savefig(output / "first-light.png", dpi=130)
    return Page(
        "stagectl demo: a ball-screw stage over CAN at 2 kHz",
        f"At full amplitude the stage tracks all three sines within {length(worst, 'm')} with friction compensation; "
        f"without it the error peaks at {length(bare, 'm')}, {bare / worst:.0f} times as much.",
        [
            "Simulated: a virtual CANopen drive with the paper's ball-screw stage inside. Controller and drive are "
            "two processes that talk CAN over a bus of Unix sockets; PID at 40 Hz and perfect tracking feedforward "
            "in both runs, Ts 0.5 ms, nd = 1.",
            f"{cycles} control cycles, {late} of them late. The virtual plant moves one period per SYNC, so a late "
            "cycle does not disturb it; on a machine it would.",
        ],
        [Picture(embedded(motion([pair])), f"{pair.title}; shaded: where the error is taken.") for pair in pairs],
        [Table("Tracking error", _HEAD, [_row(*pair) for pair in results])],
        ["make run", *(f".venv/bin/stagectl replay {pair[1]['recording']}" for pair in results)],
        versions(),
    )


_HEAD = [
    "motion",
    "peak, without",
    "peak, with",
    "rms, without",
    "rms, with",
    "peak current, with",
    "late cycles, both",
]


def _row(bare: Result, compensated: Result) -> list[str]:
    errors = [run["tracking_error"][kind] for kind in ("peak", "rms") for run in (bare, compensated)]
    late, cycles = (bare[name] + compensated[name] for name in ("late_cycles", "cycles"))
    return [
        compensated["trajectory"],
        *(length(x, "m") for x in errors),
        f"{compensated['peak_current']:.2f} A",
        f"{late} of {cycles}",
    ]


def _figure_pair(bare: Result, compensated: Result) -> Any:
    from stagectl.report.figures import Pair

    opened = [open_recording(Path(run["recording"])) for run in (bare, compensated)]
    meta = opened[0].meta
    title = f"{meta['trajectory'].removeprefix('sine-').removesuffix('hz')} Hz"
    return Pair(title, opened[0].samples, opened[1].samples, meta["axis"]["travel_per_unit"], tuple(meta["steady"]))
