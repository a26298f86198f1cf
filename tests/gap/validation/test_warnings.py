"""Copies, runs that were used twice, and a model that the loop does not confirm."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

import stagectl as sc
from stagectl.gap.result.diagnosis import FoundEffect
from stagectl.gap.validation.validate import NOTHING_CLOSER, NOTHING_HELD_OUT, scale_doubt, warnings
from tests.gap.captured import CONFIG

STAGE: Any = object()
OTHER: Any = object()
EVIDENCE: Any = SimpleNamespace(runs=[SimpleNamespace(logs=("a",))])


def session(*held_out: bool) -> Any:
    return SimpleNamespace(stage=STAGE, logs=[SimpleNamespace(held_out=held) for held in held_out])


def test_nothing_is_said_of_a_sound_session() -> None:
    assert warnings(session(False, True), EVIDENCE, OTHER) == []


def test_a_model_that_the_loop_does_not_confirm() -> None:
    assert warnings(session(False, True), EVIDENCE, STAGE) == [NOTHING_CLOSER]


def test_copies_and_runs_that_were_used_twice() -> None:
    copied, used_twice = warnings(session(False, False), EVIDENCE, OTHER)
    assert copied.startswith("1 repeats") and used_twice == NOTHING_HELD_OUT


@pytest.mark.parametrize(
    ("name", "probability", "doubted"), [("inertia", 0.9, True), ("inertia", 0.4, False), ("viscous", 0.9, False)]
)
def test_a_value_that_the_logs_do_not_tell_is_no_wrong_unit(name: str, probability: float, doubted: bool) -> None:
    """A wrist that hardly accelerates leaves its inertia anywhere between nothing and a lot."""
    nominal = sc.load_stage(CONFIG / "ball-screw.yaml").setup.stage
    light = nominal._replace(mechanics=nominal.mechanics._replace(inertia=1e-3 * nominal.mechanics.inertia))
    assert bool(scale_doubt(nominal, light, [FoundEffect(name, (), probability, 0.3, {})])) is doubted
