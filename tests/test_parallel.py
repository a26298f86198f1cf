"""Many rollouts at once: the order of the items, the first exception, the same bits, and all cores at work."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl import design, parallel
from stagectl.config.stage_file import load_stage
from stagectl.kernels import rollout, stage

BALL_SCREW = Path(__file__).parents[1] / "config" / "ball-screw.yaml"


def _rollout(amplitude: float, count: int = 8000) -> NDArray[np.float64]:
    loop, x, inputs, dt = _inputs(amplitude, count)
    rollout.closed_loop(loop, x, inputs, dt, 4)
    return inputs[2]


def _inputs(amplitude: float, count: int) -> tuple[rollout.Loop, stage.State, tuple[NDArray[np.float64], ...], float]:
    setup = load_stage(BALL_SCREW)
    law = design.design(setup.stage, setup.file.control).law
    setpoints = np.zeros((count, rollout.SETPOINTS))
    setpoints[:, 1] = amplitude * np.sin(2.0 * np.pi * 1.6 * setup.dt * np.arange(count))
    setpoints[:, 7] = 1.0
    inputs = (setpoints, np.zeros((count, 2)), np.zeros((count, rollout.WIDTH)))
    return rollout.Loop(law, setup.stage), stage.at_rest(setup.stage), inputs, setup.dt


def test_items_of_one_key_share_what_is_made_of_the_first() -> None:
    made: list[str] = []

    def upper(word: str) -> str:
        made.append(word)
        return word.upper()

    words = ["one", "two", "other", "too"]
    found = parallel.once_for_each(upper, words, [word[0] for word in words])
    assert found == ["ONE", "TWO", "ONE", "TWO"] and sorted(made) == ["one", "two"]


def test_order_of_the_items() -> None:
    def slow_at_first(number: int) -> int:
        time.sleep(0.02 if number == 0 else 0.0)
        return number * number

    assert parallel.in_parallel(slow_at_first, range(7)) == [0, 1, 4, 9, 16, 25, 36]
    assert parallel.in_parallel(slow_at_first, []) == []


def test_exception_of_the_first_item_that_fails() -> None:
    done = []

    def fails(number: int) -> None:
        if number in (1, 3):
            raise ValueError(f"item {number}")
        time.sleep(0.001)
        done.append(number)

    with pytest.raises(ValueError, match="item 1"):
        parallel.in_parallel(fails, range(200))
    assert len(done) < 190  # what had not begun is cancelled


def test_parallel_rollouts_have_the_same_bits() -> None:
    amplitudes = [0.3, 0.7, 1.1, 1.9, 2.6]
    alone = [_rollout(amplitude) for amplitude in amplitudes]
    for rows, other in zip(alone, parallel.in_parallel(_rollout, amplitudes), strict=True):
        assert np.array_equal(rows, other)


def test_kernel_leaves_the_lock_to_other_threads() -> None:
    _rollout(1.0, 10)  # compiled
    loop, x, inputs, dt = _inputs(1.0, 400_000)  # half a second of one core
    thread = threading.Thread(target=rollout.closed_loop, args=(loop, x, inputs, dt, 4))
    turns = 0
    thread.start()
    while thread.is_alive():
        time.sleep(0.002)
        turns += 1
    assert turns > 3  # with the lock held, this thread has its turn when the kernel has ended
