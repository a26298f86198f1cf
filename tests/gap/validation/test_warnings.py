"""Copies, runs that were used twice, and a model that the loop does not confirm."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from stagectl.gap.validation.validate import NOTHING_CLOSER, NOTHING_HELD_OUT, warnings

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
