"""Which logs are simulated, which share a simulation, and which cannot be."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import load_stage
from stagectl.gap.logs.session import GapError
from stagectl.gap.validation import rollouts
from tests.conftest import CONFIG

STAGE = load_stage(CONFIG / "ball-screw.yaml").stage


def log(name: str, experiment: str = "sine", start: float = 0.0, position: float = 0.0) -> Any:
    rows = {"position": np.full(20, position), "command": np.zeros(20), "driving": np.zeros(20), "carried": 0.0}
    return SimpleNamespace(
        name=name, experiment=experiment, start=start, held_out=False, setpoints=None, current=None, **rows
    )


def simulated(monkeypatch: pytest.MonkeyPatch, stage: Any, logs: list[Any]) -> list[Any]:
    monkeypatch.setattr(rollouts, "simulated_log", lambda session, model, log: log.name)
    session: Any = SimpleNamespace(dt=5e-4)
    return rollouts.simulated_logs(session, stage, logs)


def test_repeats_from_one_place_share_a_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    logs = [log("a"), log("b", start=9.0), log("c", position=1e-3), log("d", "stairs")]
    assert simulated(monkeypatch, STAGE, logs) == ["a", "a", "c", "d"]


def test_repeats_of_an_aging_machine_do_not(monkeypatch: pytest.MonkeyPatch) -> None:
    warming = STAGE._replace(friction=STAGE.friction._replace(warming=STAGE.friction.warming._replace(rise=0.1)))
    assert simulated(monkeypatch, warming, [log("a"), log("b", start=9.0)]) == ["a", "b"]


@pytest.mark.parametrize("law", [None, object()])
def test_a_loop_that_is_not_known_is_refused(law: Any) -> None:
    session: Any = SimpleNamespace(law=law)
    with pytest.raises(GapError, match="cannot_tell"):
        rollouts.of_log(session, log("a"))


def test_nothing_can_be_predicted_where_nothing_is_held_out(tmp_path: Any) -> None:
    session: Any = SimpleNamespace(logs=(log("a"),))
    with pytest.raises(GapError, match="use: held-out"):
        rollouts.write_predictions(session, STAGE, tmp_path)
