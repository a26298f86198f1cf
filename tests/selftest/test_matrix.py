"""The self-test: a column of the matrix, its limits by independent figures, and that it can fail."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from stagectl.config.stage_file import Setup
from stagectl.drives import faults
from stagectl.drives.brake import Brake
from stagectl.drives.bus.frames import frame
from stagectl.drives.bus.virtual_time import Timeline, Wire
from stagectl.drives.homing import Homing
from stagectl.kernels import stage
from stagectl.realtime import states
from stagectl.realtime.states import Event, State
from stagectl.report.selftest import digest, page
from stagectl.selftest import case, limits, matrix
from stagectl.selftest.case import named
from tests.conftest import CONFIG, ROOT, half_second, movable

SOME = ("cable-out", "encoder-stuck", "drive-disabled", "clock-skewed", "controller-dead")


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Some faults in all states, by the command, interpreted as it runs."""
    folder = tmp_path_factory.mktemp("selftest")
    stage_file = folder / "stage.yaml"
    stage_file.write_text(half_second(movable((CONFIG / "ball-screw.yaml").read_text())))
    words = ["selftest", str(stage_file), "--json", str(folder / "out.json")]
    words += ["--report", str(folder / "page.html"), "--signed", "A. Tester"]
    words += [word for name in SOME for word in ("--only", name)]
    done = subprocess.run(
        [sys.executable, "-m", "stagectl", *words],
        cwd=ROOT, env={**os.environ, "XDG_RUNTIME_DIR": str(folder)}, capture_output=True, text=True, timeout=900,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = json.loads((folder / "out.json").read_text())
    answer["page"] = (folder / "page.html").read_text(encoding="utf-8")
    return answer


def test_each_case_ends_within_its_limits(result: dict[str, Any]) -> None:
    cases = result["faults"]
    assert len(cases) == 11 * len(SOME) == result["passed"]
    for row in cases:
        assert row["passed"], row
        if row["stop_time"] is not None and row["stop_time_limit"] is not None:
            assert 0.0 <= row["stop_time"] <= row["stop_time_limit"]
            assert 0.0 <= row["stop_distance"] <= row["stop_distance_limit"]


def test_a_moving_axis_stops_as_the_time_outs_say(result: dict[str, Any]) -> None:
    moving = {case["name"]: case for case in result["faults"] if case["state"] == "moving"}
    assert moving["cable-out"]["reason"] == "FEEDBACK_LOST"
    assert 0.45 < moving["cable-out"]["stop_time"] < 0.75  # time-outs of 500 ms, the heartbeat 600 ms at most
    assert 0.45 < moving["controller-dead"]["stop_time"] < 0.65
    assert moving["controller-dead"]["category"] == 1
    assert moving["drive-disabled"]["category"] == 0
    assert moving["clock-skewed"]["category"] is None
    assert moving["encoder-stuck"]["reason"] in ("FREEZE", "FOLLOWING_ERROR")
    speed = result["speed"] / result["travel_per_unit"]
    assert moving["cable-out"]["stop_distance"] == pytest.approx(speed * moving["cable-out"]["stop_time"], rel=0.15)


def test_the_axis_is_tried_in_every_state_of_its_table(result: dict[str, Any]) -> None:
    tried = {case["state"] for case in result["faults"]}
    states = set(State) - {
        State.ENGAGING,
        State.DRIVE_HOMING,
    }  # of an axis with a brake, or such a drive
    assert tried == {named(state) for state in states}
    cases = {(case["name"], case["state"]): case for case in result["faults"]}
    for state in ("moving", "homing", "stopping"):
        assert cases["cable-out", state]["reason"] == "FEEDBACK_LOST"
        assert 0.45 < cases["cable-out", state]["stop_time"] < 0.75
        assert cases["encoder-stuck", state]["category"] == 0
    assert cases["cable-out", "enabling"]["reason"] == "DRIVE_FAULT"  # given up after its five seconds
    assert cases["cable-out", "quick stopping"]["stop_time"] < 0.05  # its ramp is the drive's: it needs no cable
    assert cases["drive-disabled", "quick stopping"]["category"] == 0
    assert cases["clock-skewed", "homing"]["category"] is None


def test_an_axis_whose_brake_engages_is_tried_too(ball_screw: Setup) -> None:
    setup = ball_screw.having(brake=Brake("drive", 0.03, 0.2))
    wild = ("encoder-stuck", "encoder-jump", "encoder-reversed", "current-stuck", "cable-out", "controller-dead")
    bench = matrix.virtual(setup, frozenset(wild))
    assert bench.states[-1] is State.ENGAGING
    cases = list(matrix.matrix(bench._replace(states=bench.states[-1:])))
    assert all(row.passed for row in cases), cases


def test_an_axis_that_its_drive_homes_is_tried_too(ball_screw: Setup) -> None:
    """Where our law does not act: what a lost partner or a fault of the drive's leads to; encoders are its affair."""
    setup = ball_screw.having(homing=Homing("drive", 1.0, 1.0, number=34))
    seen = (
        "cable-out",
        "controller-dead",
        "drive-fault",
        "drive-disabled",
        "node-reboot",
        "emergency",
        "feedback-lost",
    )
    bench = matrix.virtual(setup, frozenset(seen))
    assert bench.states[-1] is State.DRIVE_HOMING
    cases = list(matrix.matrix(bench._replace(states=bench.states[-1:])))
    assert len(cases) == len(seen) and all(row.passed for row in cases), cases
    assert all(row.stop_time is not None and row.stop_distance > 1e-3 for row in cases)


def test_a_state_that_the_table_does_not_lead_to_is_found_out(ball_screw: Setup) -> None:
    bench = matrix.virtual(ball_screw, frozenset({"drive-fault"}))._replace(states=(State.MOVING,))
    (row,) = matrix.matrix(bench)
    assert row.passed and row.reason in ("DRIVE_FAULT", "EMERGENCY")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(states.TABLE, (State.QUICK_STOPPING, Event.FAILED), State.DISABLED)  # a fault that is forgotten
        (row,) = matrix.matrix(bench)
    assert not row.passed and row.words == "ended in state disabled; must be: fault"


def test_the_page_is_signed_and_shows_every_case(result: dict[str, Any], tmp_path: Path) -> None:
    assert "A. Tester" in result["page"] and digest(result)[:16] in result["page"]
    assert result["page"].count("passed</td>") == 2 * len(result["faults"])  # in the matrix, and as a row
    failed = [{**result["faults"][0], "passed": False, "words": "too late"}, *result["faults"][1:]]
    shown = page({**result, "faults": failed}, tmp_path / "p.html").read_text(encoding="utf-8")
    assert "NOT PASSED" in shown and "too late" in shown
    assert digest({**result, "faults": failed}) != digest(result)


def test_coasting_follows_its_closed_form(ball_screw: Setup) -> None:
    p = ball_screw.stage
    assert stage.sliding(p.friction) == pytest.approx(1.0)  # N m, as the stage file says
    v, x, t, dt = 20.0, 0.0, 0.0, 1e-6
    while v > 0.0:
        v -= (1.0 + p.mechanics.viscous * v) / p.mechanics.inertia * dt
        x, t = x + v * dt, t + dt
    limit = limits.coast(p, 20.0)
    assert limit.distance == pytest.approx(1.5 * x, rel=1e-3)
    assert limit.time == pytest.approx(1.5 * t, rel=1e-3)


def test_a_limit_that_is_too_tight_is_found_out(ball_screw: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(case, "limit", lambda *_: limits.Limit(1e-3, 1e-6))
    (row,) = matrix.matrix(matrix.virtual(ball_screw, frozenset({"drive-fault"}))._replace(states=(State.MOVING,)))
    assert not row.passed and row.words in ("too late", "still moves", "too far")


def test_a_drive_that_hears_its_stop_by_no_pdo_hears_it_by_sdo(ball_screw: Setup) -> None:
    """Many drives have no time-out of the RPDO: one whose commands are lost keeps its last current for ever."""
    setup = ball_screw.with_wire(rpdo_timeout=0.0)
    states = (State.MOVING, State.STOPPING, State.QUICK_STOPPING)
    bench = matrix.virtual(setup, frozenset({"command-lost"}))._replace(states=states)
    cases = {row.state: row for row in matrix.matrix(bench)}
    assert all(row.passed and row.category == 1 for row in cases.values()), cases
    for state in ("stopping", "quick stopping"):
        assert (cases[state].stop_time or 0.0) < 0.1  # at once, and not by the ten seconds after which it is given up
    assert cases["moving"].reason == "CLAMPED"  # where the motion wants another current, and the last one flows on
    assert 0.01 < (cases["moving"].stop_time or 0.0) < 0.5


@pytest.mark.parametrize("name", ["loop-stalled", "frames-delayed"])
def test_an_axis_that_stands_in_a_late_loop_is_stopped_where_the_stage_file_says_so(
    slow_screw: Setup, name: str
) -> None:
    """By 10 late cycles in a row, as by default; 2000 go by unnoticed."""
    realtime = slow_screw.file.realtime._replace(late_limit=10)
    for setup, reason in (
        (slow_screw.having(realtime=realtime), "LATE"),
        (slow_screw, ""),
    ):
        bench = matrix.virtual(setup, frozenset({name}))._replace(states=(State.STANDING,))
        assert [(row.passed, row.reason) for row in matrix.matrix(bench)] == [(True, reason)]


def test_what_an_axis_may_do_that_was_braking_follows_from_the_motion_it_makes(slow_screw: Setup) -> None:
    """Pushed back by the current that braked, in steps of 1 us, not by the closed form; then on the drive's ramp."""
    p, calm, row = slow_screw.stage, 800.0, faults.FAULT_TYPES["controller-dead"]
    t, v, x, dt = 0.505, 0.0, 0.0, 1e-6  # the time-out of 500 ms, and a look at it
    for _ in range(round(t / dt)):
        v += (calm - (2.0 * 1.0 + p.mechanics.viscous * v) / p.mechanics.inertia) * dt
        x += v * dt
    limit = limits.turned(slow_screw, row, faults.default("cable-out"), calm)
    stop = 1.5 * v / (5.0 / 12e-3 * 2.0 * math.pi)
    assert limit.time == pytest.approx(t + stop + 0.06, rel=0.01)
    assert limit.distance == pytest.approx(x + stop * v / 2.0 + 1.5 * v * 0.008, rel=0.01)


def test_frames_take_their_time_on_the_wire_one_after_the_other() -> None:
    time = Timeline()
    here, there = Wire(time, 1e6).ends
    here.send(frame(0x185, bytes(8)))
    here.send(frame(0x080))
    assert there.receive(1e-5) is None and time.now() == 1e-5
    assert there.receive(1.0) == frame(0x185, bytes(8)) and time.now() == pytest.approx(135e-6)
    assert there.receive(1.0) == frame(0x080) and time.now() == pytest.approx(190e-6)
    assert there.receive(0.5) is None and time.now() == pytest.approx(0.50019)
    assert all(row.required.category is None or row.required.noticed for row in faults.TABLE)
