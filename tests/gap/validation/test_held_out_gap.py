"""Sums over half strokes and the closure that follows from them, on signals whose sums are known."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.config.stage_file import load_stage
from stagectl.gap.logs.session import Log, Session
from stagectl.gap.residuals import friction_family
from stagectl.gap.validation import held_out_gap, rollouts
from stagectl.gap.validation.held_out_gap import JudgedLog, StrokeSums
from stagectl.kernels import rollout
from tests.conftest import CONFIG
from tests.gap.drawn import drawn

STROKES = [slice(0, 4), slice(4, 8)]
ZERO = np.zeros((8, rollout.WIDTH))


def log(position: NDArray[np.float64], name: str = "a", experiment: str = "sine") -> Log:
    valid = np.ones(len(position), dtype=bool)
    return Log(name, experiment, 1, True, 0.0, position, None, None, None, None, valid)


def judged(*positions: NDArray[np.float64]) -> list[JudgedLog]:
    return [JudgedLog(log(position, name), STROKES) for name, position in zip("abc", positions, strict=False)]


def test_squares_are_summed_over_half_strokes_and_rows_that_do_not_count_are_left_out() -> None:
    (item,) = judged(np.arange(8.0))
    item.log.valid[7] = False
    sums = held_out_gap.squares([item], [ZERO], "position")
    assert sums.squares.tolist() == [0.0 + 1.0 + 4.0 + 9.0, 16.0 + 25.0 + 36.0]
    assert sums.samples.tolist() == [4.0, 3.0]
    assert held_out_gap.remaining([item], [ZERO]) == 91.0


def test_a_current_that_was_not_measured_has_no_gap() -> None:
    assert held_out_gap.squares(judged(np.ones(8)), [ZERO], "current").squares.tolist() == [0.0, 0.0]


def test_the_floor_of_repeats_is_half_their_mean_squared_difference() -> None:
    """Two that differ by 2 everywhere: 4 / 2 a sample in each of them, the variance of a single one."""
    sums = held_out_gap.floor(judged(np.ones(8), -np.ones(8)), [ZERO, ZERO], "position")
    assert sums.squares.tolist() == [16.0] * 2 and sums.samples.tolist() == [8.0] * 2


def test_what_was_recorded_once_is_as_noisy_as_the_repeats() -> None:
    once = JudgedLog(log(np.full(8, 5.0), "c", "scan"), STROKES)
    sums = held_out_gap.floor([*judged(np.ones(8), -np.ones(8)), once], [ZERO] * 3, "position")
    assert sums.squares.sum() / sums.samples.sum() == pytest.approx(2.0)
    assert held_out_gap.floor([once], [ZERO], "position").squares.sum() == 0.0


def test_a_repeat_makes_no_interval_narrower() -> None:
    """What a model leaves is the same in each repeat of a half stroke, in whatever order the logs come."""
    rng = np.random.default_rng(1)
    strokes = [slice(4 * k, 4 * k + 4) for k in range(10)]
    paths = {name: np.repeat(rng.normal(size=10), 4) for name in ("sine", "scan")}
    zero, shrunk = np.zeros((40, rollout.WIDTH)), np.zeros((40, rollout.WIDTH))
    place = rollout.COLUMNS.index("measured")

    def intervals(repeats: int) -> tuple[float, float]:
        order = [(name, number) for number in range(repeats) for name in paths]
        logs = [JudgedLog(log(paths[name], f"{name}{number}", name), strokes) for name, number in order]
        simulated = []
        for name, _ in order:
            shrunk[:, place] = paths[name] * (1.0 - 0.3 * np.abs(paths[name]))
            simulated.append(shrunk.copy())
        before = held_out_gap.squares(logs, [zero] * len(logs), "position")
        after = held_out_gap.squares(logs, simulated, "position")
        gap = held_out_gap.gap(before, after, held_out_gap.floor(logs, simulated, "position"), "m")
        return gap.low, gap.high

    assert intervals(3) == pytest.approx(intervals(1), rel=1e-9)


def test_a_difference_that_the_model_predicts_is_no_noise() -> None:
    drifted = ZERO.copy()
    drifted[:, rollout.COLUMNS.index("measured")] = -2.0
    assert not held_out_gap.floor(judged(np.ones(8), -np.ones(8)), [ZERO, drifted], "position").squares.any()


def test_without_repeats_the_floor_is_zero() -> None:
    assert not held_out_gap.floor(judged(np.ones(8)), [ZERO], "position").squares.any()


def sums_of(value: float, strokes: int = 20) -> StrokeSums:
    return StrokeSums(np.full(strokes, value), np.full(strokes, 10.0))


def test_the_closure_counts_above_the_floor() -> None:
    gap = held_out_gap.gap(sums_of(101.0), sums_of(2.0), sums_of(1.0), "rad", 0.5)
    assert (gap.closure, gap.low, gap.high) == pytest.approx((0.99, 0.99, 0.99))
    assert (gap.before, gap.after, gap.floor) == pytest.approx((math.sqrt(10.1), math.sqrt(0.2), math.sqrt(0.1)))
    assert (gap.unit, gap.predicted) == ("rad", 0.5)


def test_nothing_above_the_floor_has_no_closure() -> None:
    """Before and after are noise: their difference over nothing is no share, and no interval holds it."""
    sums = [StrokeSums(np.array(squares), np.ones(4)) for squares in ([1.0, 2.0] * 2, [1.0, 2.0] * 2, [2.0, 1.0] * 2)]
    below = held_out_gap.gap(sums[0], sums[1], sums[2], "m")
    assert np.isnan([below.closure, below.low, below.high]).all()
    barely = held_out_gap.gap(sums[0]._replace(squares=np.array([1.0, 2.0, 1.0, 2.5])), sums[1], sums[2], "m")
    assert np.isfinite(barely.closure) and np.isnan([barely.low, barely.high]).all()


def test_the_interval_of_the_closure_widens_with_the_scatter_of_the_half_strokes() -> None:
    """One half stroke in two closes wholly, the other not at all: 1/2, and by sampling 20 of them +- 2 sqrt(1/80)."""
    after = StrokeSums(np.tile([0.0, 100.0], 10), np.full(20, 10.0))
    gap = held_out_gap.gap(sums_of(100.0), after, sums_of(0.0), "m")
    assert gap.closure == pytest.approx(0.5)
    assert gap.high - gap.low == pytest.approx(4.0 * math.sqrt(1.0 / 80.0), rel=0.2)


def test_a_trace_is_of_the_first_repeat_of_each_run() -> None:
    logs = [log(np.ones(8), "a"), log(np.zeros(8), "b"), log(np.ones(8), "c", "stairs")]
    traces = held_out_gap.traces([JudgedLog(each, STROKES) for each in logs], [ZERO] * 3, [ZERO] * 3, 0.1, 1e-3)
    assert [trace.file for trace in traces] == ["a", "c"]
    assert traces[0].before.tolist() == [-1.0] * 8 and traces[0].time[-1] == pytest.approx(7e-3)


def session_of(dt: float = 1e-3) -> Session:
    stage = load_stage(CONFIG / "ball-screw.yaml")
    law = stage.controller.law
    return Session(Path(), "rotary", 1.0, "m", dt, stage.stage, law, ())


def test_the_friction_of_an_earlier_motion_does_not_count() -> None:
    session = session_of()._replace(law=None)
    zone = friction_family.length(session.stage.friction)
    (item,) = held_out_gap.judged_logs(session, [log(np.linspace(0.0, 30.0 * zone, 301))])
    assert not item.log.valid[:30].any() and item.log.valid[32:].all()
    assert item.strokes[0].start == 0 and item.strokes[-1].stop == 301


def test_a_start_after_a_rest_is_not_judged_until_the_loop_has_settled() -> None:
    """From the end of the rest: three zones of travel, and the time in which a 40 Hz loop forgets."""
    session = session_of()
    zone = friction_family.length(session.stage.friction)
    stroke = np.linspace(0.0, 60.0 * zone, 601)
    resting = np.concatenate([stroke, np.full(400, stroke[-1]), stroke[-1] + stroke])
    (item,) = held_out_gap.judged_logs(session, [log(resting)._replace(reference=resting)])
    ((begin, end),) = item.rests
    hidden = np.flatnonzero(~item.log.valid[begin:]) + begin
    assert begin == pytest.approx(600, abs=12) and end == pytest.approx(1000, abs=12)
    assert hidden[0] == end and 1030 + 30 <= hidden[-1] <= 1030 + 100 and len(hidden) == hidden[-1] - end + 1


def test_a_log_of_steps_within_the_rolling_zone_is_judged_whole() -> None:
    session = session_of()
    zone = friction_family.length(session.stage.friction)
    steps = np.repeat(zone * np.arange(12.0), 300)
    (item,) = held_out_gap.judged_logs(session, [log(steps)._replace(reference=steps)])
    assert len(item.rests) > 5 and item.log.valid.all()


def test_creep_at_rest_is_no_gap_and_ringing_is() -> None:
    time = 1e-3 * np.arange(500.0)
    creep, ringing = 1e-6 * (time + time**2), 1e-6 * np.sin(2.0 * np.pi * 60.0 * time)
    zero = np.zeros((500, rollout.WIDTH))
    for signal, left in ((creep, 0.0), (ringing, 0.5e-12)):
        item = JudgedLog(log(signal), [slice(0, 500)], ((0, 500),))
        sums = held_out_gap.squares([item], [zero], "position")
        assert sums.squares.sum() / 500.0 == pytest.approx(left, rel=0.05, abs=1e-20)


@pytest.mark.parametrize("seed", [601, 602, 603])
def test_the_loop_of_a_machine_as_its_model_meets_its_noise(tmp_path: Path, seed: int) -> None:
    """The machine of the exam, whose friction creeps at rest: with its starts the gap is 3 to 4 times the floor."""
    session = drawn(tmp_path, seed, stratum="null-exact")
    held = [each for each in session.logs if each.held_out]
    items = held_out_gap.judged_logs(session, held)
    rows = rollouts.simulated_logs(session, session.stage, held)
    found, least = (of(items, rows, "position") for of in (held_out_gap.squares, held_out_gap.floor))
    gap = held_out_gap.gap(found, found, least, "rad")
    assert 0.8 * gap.floor < gap.before < 1.3 * gap.floor
    assert sum(item.log.valid.sum() for item in items) > 0.75 * sum(each.valid.sum() for each in held)
