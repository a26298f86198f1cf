"""The page of a run: its axes fit what was driven, and an open loop has a page, too."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import numpy as np
import pytest

import stagectl as sc
from stagectl.api.record import MotionRecord
from stagectl.evaluation import evaluate
from stagectl.problem import ProblemKind
from stagectl.recording.hdf5 import RecordingError
from stagectl.report.panels import picture
from stagectl.report.run import _panels, page
from tests.conftest import CONFIG
from tests.problems import refused

FORTH = "type: trapezoid\ndistance: 20 mm\nvelocity: 50 mm/s\nacceleration: 0.5 m/s^2\n"


def simulated(motion: Path) -> MotionRecord:
    return sc.simulate(sc.load_stage(CONFIG / "ball-screw.yaml"), motion)


def panels(run: MotionRecord) -> dict[str, tuple[float, float] | None]:
    """Limits of each panel, by the first word of its caption."""
    shown = _panels(run.recording.samples, run.recording.meta)
    return {caption.partition(":")[0]: frame.ylim for _, frame, caption in shown}


def test_the_axis_fits_what_was_driven(tmp_path: Path) -> None:
    """A way from 0 to 20 mm is not drawn from -20 mm on; there is room for the legend."""
    (tmp_path / "forth.yaml").write_text(FORTH)
    position = panels(simulated(tmp_path / "forth.yaml"))["Position"]
    assert position == pytest.approx((-4.0, 24.0), abs=0.1)


def test_the_peak_of_the_start_is_told_apart(tmp_path: Path) -> None:
    """Nobody knows the friction before a motion: its first peak must not hide the rest."""
    (tmp_path / "forth.yaml").write_text(FORTH)
    run = simulated(tmp_path / "forth.yaml")
    whole, later = (run.summary[name]["peak"] for name in ("tracking_error", "tracking_error_after_start"))
    limits = panels(run)["Tracking error"]
    assert later < 0.1 * whole and limits is not None
    assert limits[1] < 1e9 * whole
    frame, caption = next(
        shown[1:] for shown in _panels(run.recording.samples, run.recording.meta) if "error" in shown[2]
    )
    assert frame.outside is not None and caption.endswith(f"Its peak lies outside: {frame.outside[0]}.")
    assert frame.outside[0].startswith(f"{1e9 * whole:.0f} nm at ")


def test_the_current_of_an_axis_at_rest(tmp_path: Path) -> None:
    (tmp_path / "forth.yaml").write_text(FORTH)
    at_rest = simulated(tmp_path / "forth.yaml").summary["current_at_rest"]
    assert at_rest is not None and at_rest < 0.1
    assert simulated(CONFIG / "experiments" / "current-sine-1.6hz-5a.yaml").summary["current_at_rest"] is None


def test_an_open_loop_has_no_tracking_error_to_draw() -> None:
    assert set(panels(simulated(CONFIG / "experiments" / "current-sine-1.6hz-5a.yaml"))) == {"Position", "Current"}


def test_the_page_holds_each_row(tmp_path: Path) -> None:
    """A zoom ends at samples, not at the buckets of a picture; a row costs a few bytes."""
    (tmp_path / "forth.yaml").write_text(FORTH)
    run = simulated(tmp_path / "forth.yaml")
    samples, meta = run.recording.samples, run.recording.meta
    lines, frame, _ = _panels(samples, meta)[1]
    ((curve,),) = [panel["lines"] for panel in json.loads(picture(lines, frame, "error").plot)]
    error = np.frombuffer(base64.b64decode(curve["y"]), "<f4")
    np.testing.assert_allclose(error, lines[0].y, rtol=1e-6)
    np.testing.assert_allclose(np.linspace(*curve["x"]), samples["time"], atol=1e-9)
    assert len(json.dumps(curve)) < 6 * len(samples) + 200


def test_a_report_says_which_rows_the_disk_did_not_take() -> None:
    """The run did not end early: its last rows are missing."""
    run = simulated(CONFIG / "trajectories" / "sine-1.6hz.yaml").recording
    kept = run._replace(samples=run.samples[:300], lost_rows=len(run.samples) - 300)
    assert f"{kept.lost_rows} of {len(run.samples)} rows" in page(kept, []).answer
    assert kept.lost_rows > 0 and "ended before" not in page(kept, []).answer
    empty = kept._replace(samples=run.samples[:0], lost_rows=len(run.samples))
    with refused(RecordingError, kind=ProblemKind.MISSING):
        page(empty, [])
    assert not evaluate(empty.samples, empty.meta)["in_position"]
