"""When the loop stops: every limit from both sides, and that a drive's own fault comes first."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from stagectl import design
from stagectl.config.stage_file import Setup
from stagectl.drives.drive import Fault, Feedback
from stagectl.kernels import rollout
from stagectl.motion_limits import LimitError
from stagectl.plan import plan
from stagectl.problem import ProblemKind
from stagectl.realtime.envelope import acceleration, braking, check_braking, envelope
from stagectl.realtime.safety import FRESH, Envelope, Observation, Watch, detail, judge, words
from stagectl.realtime.stops import STOPS, Category
from stagectl.simulation import simulate
from stagectl.trajectories import Sine
from tests.conftest import varied
from tests.problems import refused

DT = 1e-3
P = Envelope(low=-1.0, high=2.0, speed=10.0, following_error=0.1, late_limit=5)


def seen(position: float, error: float = 0.0, **changes: Any) -> Observation:
    feedback = Feedback(position, changes.get("current", 0.0), 0x27, changes.get("fault", Fault.NONE))
    return Observation(
        feedback, changes.get("reference", 0.0), error, changes.get("command", 0.0), changes.get("time", DT)
    )


def judged(p: Envelope, rows: list[Observation], x: Watch = FRESH) -> tuple[Fault, int]:
    """The first fault of these periods, and in which of them."""
    for k, now in enumerate(rows):
        fault, x = judge(p, x, now)
        if fault:
            return fault, k
    return Fault.NONE, len(rows)


@pytest.mark.parametrize(
    ("position", "speed", "error", "expected"),
    [
        (0.0, 0.0, 0.0, Fault.NONE),
        (-1.0, -9.999999, -0.1, Fault.NONE),
        (2.0, 9.999999, 0.1, Fault.NONE),
        (2.0000001, 0.0, 0.0, Fault.TRAVEL),
        (-1.0000001, 0.0, 0.0, Fault.TRAVEL),
        (0.0, 10.000001, 0.0, Fault.SPEED),
        (0.0, -10.000001, 0.0, Fault.SPEED),
        (0.0, 0.0, 0.1000001, Fault.FOLLOWING_ERROR),
        (0.0, 0.0, -0.1000001, Fault.FOLLOWING_ERROR),
        (0.0, 0.0, math.nan, Fault.FOLLOWING_ERROR),
        (math.nan, 0.0, 0.0, Fault.JUMP),
    ],
)
def test_each_limit(position: float, speed: float, error: float, expected: Fault) -> None:
    before = Watch(position=position - speed * DT if position == position else 0.0, speed=speed, reference=0.0)
    assert judge(P, before, seen(position, error))[0] is expected


@pytest.mark.parametrize("fault", [f for f in Fault if f is not Fault.NONE])
def test_the_drives_own_fault_comes_first(fault: Fault) -> None:
    assert judge(P, FRESH, seen(99.0, 99.0, fault=fault))[0] is fault


def test_a_first_position_that_is_no_number_stops_too() -> None:
    assert judge(P, FRESH, seen(math.nan, math.nan))[0] is Fault.FOLLOWING_ERROR
    assert judge(P, FRESH, seen(math.nan, 0.0))[0] is Fault.TRAVEL


def test_every_fault_has_words_and_a_way_out_of_its_own() -> None:
    assert set(STOPS) == set(Fault) - {Fault.NONE}
    assert len({words(fault) for fault in STOPS}) == len(STOPS)
    assert words(Fault.NONE) == ""
    assert all(stop.words and stop.next for stop in STOPS.values())
    assert all(category.words.startswith(f"category {category.value}: ") for category in Category)


def test_the_following_error_ramps_with_the_references_speed() -> None:
    p = P._replace(error_ramp=0.01)  # 0.1 at rest, 0.15 at 5 a second
    for error, speed, expected in ((0.149, 5.0, Fault.NONE), (0.151, 5.0, Fault.FOLLOWING_ERROR)):
        x = Watch(position=0.0, reference=-speed * DT)
        assert judge(p, x, seen(0.0, error))[0] is expected
        x = Watch(position=0.0, reference=speed * DT)
        assert judge(p, x, seen(0.0, -error))[0] is expected
    assert judge(p, Watch(position=0.0, reference=0.0), seen(0.0, 0.149))[0] is Fault.FOLLOWING_ERROR


def test_the_following_error_has_a_time_but_twice_the_limit_has_none() -> None:
    p = P._replace(error_time=0.0105)
    assert judged(p, [seen(0.0, 0.11)] * 10) == (Fault.NONE, 10)
    assert judged(p, [seen(0.0, 0.11)] * 20) == (Fault.FOLLOWING_ERROR, 10)
    assert judged(p, [*[seen(0.0, 0.11)] * 9, seen(0.0), *[seen(0.0, 0.11)] * 9]) == (Fault.NONE, 19)
    assert judged(p, [seen(0.0), seen(0.0, 0.201)]) == (Fault.FOLLOWING_ERROR, 1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_room_to_brake(sign: float) -> None:
    """From 4 a second at 20 a second squared: 0.4 of way; the following error is granted beyond the end."""
    p = P._replace(low=-1.0, high=1.0, deceleration=20.0, following_error=0.01)
    for start, expected in ((0.609, Fault.NONE), (0.612, Fault.BRAKING)):
        x = Watch(position=sign * (start - 4.0 * DT), speed=sign * 4.0, reference=0.0)
        assert judge(p, x, seen(sign * start))[0] is expected
    away = Watch(position=sign * 0.999, speed=-sign * 4.0, reference=0.0)
    assert judge(p, away, seen(sign * (0.999 - 4.0 * DT)))[0] is Fault.NONE  # towards the middle there is room


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_jump_is_what_no_force_explains(sign: float) -> None:
    p = P._replace(jump=1e-3, acceleration=100.0)
    at = Watch(position=0.5, speed=sign * 2.0, reference=0.0)
    way = 2.0 * DT
    most = way + 1e-3 + way + 100.0 * DT * DT  # the second `way`: the cycle may be one period out of time
    for way, expected in ((0.99 * most, Fault.NONE), (1.01 * most, Fault.JUMP)):
        assert judge(p, at, seen(0.5 + sign * way))[0] is expected
    assert judge(p, FRESH, seen(0.5))[0] is Fault.NONE  # the first position is no jump
    late = seen(0.5 + sign * 6.0 * 2.0 * DT, time=6 * DT)  # a stall of six periods at the same speed is none
    assert judge(p, at, late)[0] is Fault.NONE


def test_a_frozen_encoder_shows_on_the_way_of_the_reference() -> None:
    p = P._replace(freeze=0.0095, following_error=1.0)
    moving = [seen(0.5, 0.0, reference=1e-3 * k) for k in range(100)]
    assert judged(p, moving) == (Fault.FREEZE, 10)
    counted = [
        now._replace(feedback=now.feedback._replace(position=0.5 + 1e-9 * (k // 9))) for k, now in enumerate(moving)
    ]
    assert judged(p, counted) == (Fault.NONE, 100)
    assert judged(p, [seen(0.5)] * 1000) == (Fault.NONE, 1000)  # who stands is not frozen


def test_a_frozen_encoder_shows_under_current_in_open_loop() -> None:
    p = P._replace(breakaway=2.0, freeze_time=0.0205)
    assert judged(p, [seen(0.5, command=2.1)] * 100) == (Fault.FREEZE, 21)
    assert judged(p, [seen(0.5, command=-2.1)] * 100) == (Fault.FREEZE, 21)
    assert judged(p, [seen(0.5, command=1.9)] * 100) == (Fault.NONE, 100)


def test_current_beyond_its_peak_for_its_time() -> None:
    p = P._replace(current=10.0, current_time=0.0055)
    assert judged(p, [seen(0.0, current=-10.1)] * 5) == (Fault.NONE, 5)
    assert judged(p, [seen(0.0, current=-10.1)] * 9) == (Fault.CURRENT, 5)
    assert judged(p, [seen(0.0, current=math.nan, command=9.9)] * 9) == (Fault.NONE, 9)


def test_i2t_trips_when_the_thermal_model_says() -> None:
    """Twice the continuous current: after tau ln(4/3), the closed form of the first-order model."""
    p = P._replace(continuous_current=2.0, thermal_time=1.0)
    hot = int(math.log(4.0 / 3.0) / DT)
    fault, when = judged(p, [seen(0.0, current=4.0)] * 1000)
    assert fault is Fault.OVERLOAD
    assert when == pytest.approx(hot, abs=2)
    assert judged(p, [seen(0.0, current=1.99)] * 10000)[0] is Fault.NONE
    assert judged(p, [seen(0.0, current=math.nan, command=4.0)] * 1000) == (Fault.OVERLOAD, when)


def test_the_stage_files_envelope(ball_screw: Setup) -> None:
    p, limits = envelope(ball_screw), ball_screw.file.limits
    assert (p.low, p.high, p.speed) == (*limits.travel, 1.1 * limits.speed)
    assert (p.following_error, p.error_ramp) == (limits.following_error, 0.0)
    assert acceleration(ball_screw) == pytest.approx((15.0 * 0.72 + 1.0) / 0.010)
    assert p.deceleration == braking(ball_screw) == pytest.approx((15.0 * 0.72 + 1.0) / 0.010)  # less than the ramp
    ramped = limits._replace(following_error_at_rest=0.25 * limits.following_error, deceleration=7.0)
    other = envelope(ball_screw.having(limits=ramped))
    assert other.following_error + other.error_ramp * limits.speed == pytest.approx(limits.following_error)
    assert other.deceleration == 7.0


@pytest.mark.parametrize("amplitude", [0.003, 0.00001])
def test_nothing_stops_a_good_run(ball_screw: Setup, amplitude: float) -> None:
    """With noise on encoder and current, fast and slow: no false alarm in any row."""
    noisy = varied(ball_screw, current_noise=0.05, encoder_noise=1e-5)
    running = design.design(noisy.stage, noisy.file.control)
    rows = simulate(noisy, plan(noisy, Sine(amplitude, 3.2, 2.0, 1.0), running.feedforward), running.law)
    p, x, command = envelope(noisy), FRESH, 0.0
    assert len(rows) > 1000
    for row in rows:
        feedback = Feedback(row["measured"], row["measured_current"], 0x27, Fault.NONE)
        fault, x = judge(p, x, Observation(feedback, row["reference"], row["error"], command, noisy.dt))
        assert fault is Fault.NONE, row["time"]
        command = row["current"]
    assert np.ptp(rows["measured"]) * noisy.file.axis.travel_per_unit > 1.5 * amplitude
    assert set(rows.dtype.names or ()) == set(rollout.COLUMNS)


FOLLOWED = P._replace(
    current_floor=0.5, current_share=0.1, current_settling=5e-3, unfollowed_time=0.02, frozen=0.1, frozen_time=0.01
)


def driven(commands: list[float], current: Any, moving: float = 1e-5) -> list[Observation]:
    """Periods under these commands; `current(k)` is what the drive reports."""
    return [seen(moving * k, command=command, current=current(k)) for k, command in enumerate(commands)]


def test_a_drive_that_gives_another_current_is_told() -> None:
    """A clamp at 2 A that nobody told, and a drive that follows with a lag of two periods and three of dead time."""
    sine = [5.0 * math.sin(0.05 * k) for k in range(1000)]
    clamped = driven(sine, lambda k: min(max(sine[k], -2.0), 2.0))
    fault, period = judged(FOLLOWED, clamped)
    assert fault is Fault.CLAMPED
    assert 20 <= period < 100

    lagging, x = [0.0] * 3, 0.0
    for command in sine:
        x += (command - x) * 0.4
        lagging.append(x)
    assert judged(FOLLOWED, driven(sine, lambda k: lagging[k])) == (Fault.NONE, 1000)
    square = [5.0 * (-1) ** (k // 25) for k in range(1000)]
    assert judged(FOLLOWED, driven(square, lambda k: square[max(k - 2, 0)])) == (Fault.NONE, 1000)


def test_a_drive_that_reports_no_current_is_not_suspected() -> None:
    assert judged(FOLLOWED, driven([5.0] * 1000, lambda _: math.nan)) == (Fault.NONE, 1000)


def test_an_answer_that_repeats_while_the_command_changes_is_frozen() -> None:
    ramp = [0.2 + 0.01 * k for k in range(50)]
    fault, period = judged(FOLLOWED, driven(ramp, lambda _: 0.25, moving=0.0))
    assert fault is Fault.FREEZE
    assert 18 <= period <= 22  # 0.1 A later, and 10 ms
    assert judged(FOLLOWED, driven([0.3] * 500, lambda _: 0.3, moving=0.0)) == (Fault.NONE, 500)  # it may stand
    jump = [0.3] * 100 + [0.6] * 5  # the drive has not answered yet
    assert judged(FOLLOWED, driven(jump, lambda _: 0.3, moving=0.0)) == (Fault.NONE, 105)


def test_an_axis_that_runs_away_is_of_the_wrong_sign() -> None:
    away = seen(-0.11, error=0.11, command=4.0)
    assert "0x607E" in detail(Fault.FOLLOWING_ERROR, FRESH._replace(speed=-1.0), away)
    assert detail(Fault.FOLLOWING_ERROR, FRESH._replace(speed=1.0), away) == ""  # it comes
    assert detail(Fault.FOLLOWING_ERROR, FRESH._replace(speed=-100.0), away) == ""  # a jump: all in one period


def test_the_fault_names_both_currents() -> None:
    clamped = seen(0.0, command=5.0, current=2.0)
    text = detail(Fault.CLAMPED, FRESH, clamped)
    assert "2 A" in text and "5 A" in text and "bit 11" not in text
    limited = clamped._replace(feedback=clamped.feedback._replace(statusword=0x0E37))
    assert "bit 11" in detail(Fault.CLAMPED, FRESH, limited)


@pytest.mark.parametrize(
    ("weak", "key"),
    [
        ({"limits": {"deceleration": 1e-3}}, "limits.deceleration"),
        ({"wire": {"quick_stop_deceleration": 1e-3}}, "drive.wire.quick_stop_deceleration"),
    ],
)
def test_a_motion_that_would_be_stopped_for_its_braking_does_not_begin(
    ball_screw: Setup, weak: dict[str, Any], key: str
) -> None:
    screw, file = ball_screw, ball_screw.file
    rows = plan(screw, Sine(5e-3, 1.6, 2.0, 1.0), screw.controller.feedforward).setpoints
    check_braking(screw, rows)
    slow = screw.having(limits=file.limits._replace(**weak.get("limits", {}))).with_wire(**weak.get("wire", {}))
    with refused(LimitError, kind=ProblemKind.LIMIT, key=key):
        check_braking(slow, rows)
