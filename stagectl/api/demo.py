"""The main job on a machine with nothing but Python: a stage tracks three sines over a CAN bus.

A virtual CANopen drive with the ball-screw stage inside is one process, the controller another; each sine of
the paper runs without and with friction compensation, is recorded, and all of it ends in one page.
"""

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

from stagectl.api.arguments import ProgressOption, Say, reported
from stagectl.api.motion import run
from stagectl.api.record import MotionRecord
from stagectl.api.stage import DesignedStage, load_stage
from stagectl.config.wire_checks import OWN
from stagectl.number_format import length
from stagectl.report.page import Page, Table, write
from stagectl.units import StageError
from stagectl.workflows.motion import check_not_interrupted, drive_present

SINES = ("sine-3.2hz", "sine-1.6hz", "sine-0.8hz")
Pair = tuple[MotionRecord, MotionRecord]  # without and with friction compensation


def demo(output: Path, progress: ProgressOption, say: Say) -> dict[str, Any]:
    """Run it all into the folder `output`; returns what each run achieved, and where the page is."""
    if not (OWN / "ball-screw.yaml").is_file():
        raise StageError(f"the demo needs the checkout's config folder, and there is none at {OWN}: run it there")
    with tempfile.TemporaryDirectory(prefix="stagectl-") as folder:
        stage = load_stage(OWN / "ball-screw.yaml").on_channel(folder)
        with drive_present(stage.setup, say):
            pairs = [_pair(stage, sine, output, partial(reported, progress), say) for sine in SINES]
    page = _page(pairs, output)
    say("\n" + page.answer)
    written = write(page, output / "report.html")
    runs = [record.summary for pair in pairs for record in pair]
    return {"answer": page.answer, "report": str(written), "runs": runs}


def _pair(stage: DesignedStage, sine: str, output: Path, bar: Any, say: Say) -> Pair:
    """The same motion without and with friction compensation."""
    records = []
    for name, without in (("without", ("friction",)), ("with", ())):
        place = output / f"{sine}-{name}.h5"
        said = say if sine == SINES[0] and without else None  # what a drive says at its first run holds for all
        with bar(f"{sine}, {name} friction compensation", 1.0) as update:
            trajectory = OWN / "trajectories" / f"{sine}.yaml"
            record = run(stage, trajectory, recording=place, without=without, progress=update, say=said)
        check_not_interrupted(record.summary)
        if record.summary["fault"]:
            raise StageError(f"the motion stopped: {record.summary['fault']}; the recording {record.path} shows why")
        records.append(record)
    return records[0], records[1]


def _page(pairs: list[Pair], output: Path) -> Page:
    from stagectl.report.figures import motion
    from stagectl.report.interactive import picture

    peaks = [[record.summary["tracking_error"]["peak"] for record in pair] for pair in pairs]
    bare, worst = (max(each) for each in zip(*peaks, strict=True))
    late, cycles = (
        sum(record.summary[name] for pair in pairs for record in pair) for name in ("late_cycles", "cycles")
    )
    figures = [_figure_pair(*pair) for pair in pairs]
    captions = [
        f"{figure.title}: the error peaks at {length(without, 'm')} without friction compensation, at "
        f"{length(compensated, 'm')} with it."
        for figure, (without, compensated) in zip(figures, peaks, strict=True)
    ]
    motion(figures).savefig(output / "first-light.png", dpi=130)
    return Page(
        "stagectl demo: a ball-screw stage over CAN at 2 kHz",
        f"At full amplitude the stage tracks all three sines within {length(worst, 'm')} with friction compensation; "
        f"without it the error peaks at {length(bare, 'm')}, {bare / worst:.0f} times as much.",
        [
            "Simulated: a virtual CANopen drive with the paper's ball-screw stage inside. Controller and drive are "
            "two processes that talk CAN over a bus of Unix sockets; PID at 40 Hz and perfect tracking feedforward "
            "in both runs, Ts 0.5 ms, nd = 1.",
            "Shaded in the figures: the full amplitude, where the error is taken.",
            f"{cycles} control cycles, {late} of them late. The virtual plant moves one period per SYNC, so a late "
            "cycle does not disturb it; on a machine it would.",
        ],
        [picture(motion([figure]), caption) for figure, caption in zip(figures, captions, strict=True)],
        [Table("Tracking error", _HEAD, [_row(*pair) for pair in pairs])],
        ["make run", *(f".venv/bin/stagectl replay {pair[1].path}" for pair in pairs)],
        narrow=True,
    )


_ERRORS = (f"{kind}, {how}" for kind in ("peak", "rms") for how in ("without", "with"))
_HEAD = ["motion", *_ERRORS, "peak current, with", "late cycles, both"]


def _row(*pair: MotionRecord) -> list[str]:
    bare, compensated = (record.summary for record in pair)
    errors = [length(run["tracking_error"][kind], "m") for kind in ("peak", "rms") for run in (bare, compensated)]
    late, cycles = (bare[name] + compensated[name] for name in ("late_cycles", "cycles"))
    current = f"{compensated['peak_current']:.2f} A"
    return [compensated["trajectory"], *errors, current, f"{late} of {cycles}"]


def _figure_pair(bare: MotionRecord, compensated: MotionRecord) -> Any:
    from stagectl.report.figures import Pair

    meta = bare.recording.meta
    title = f"{meta['trajectory'].removeprefix('sine-').removesuffix('hz')} Hz"
    return Pair(title, bare.samples, compensated.samples, meta["axis"]["travel_per_unit"], tuple(meta["steady"]))
