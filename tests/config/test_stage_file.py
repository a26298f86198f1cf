"""A stage file is read once and designed once."""

from __future__ import annotations

import math
import pickle

import pytest

from stagectl import design
from stagectl.config.stage_file import Setup, load_stage
from tests.conftest import CONFIG


@pytest.fixture
def designs(monkeypatch: pytest.MonkeyPatch) -> list[design.Settings]:
    """The controls that have been designed."""
    controls: list[design.Settings] = []

    def counted(p: object, control: design.Settings) -> object:
        controls.append(control)
        return designed(p, control)  # type: ignore[arg-type]

    designed = design.design
    monkeypatch.setattr(design, "design", counted)
    return controls


def test_a_stage_is_designed_once(designs: list[design.Settings]) -> None:
    setup = load_stage(CONFIG / "ball-screw.yaml")
    assert setup.controller is setup.controller
    assert len(designs) == 1
    assert pickle.loads(pickle.dumps(setup)).controller.law == setup.controller.law
    assert len(designs) == 1


def test_a_changed_stage_is_designed_anew(designs: list[design.Settings]) -> None:
    setup = load_stage(CONFIG / "ball-screw.yaml")
    assert isinstance(setup.file.control, design.Control)
    slower = setup.file.control._replace(bandwidth=20.0)
    changed = setup.having(control=slower)
    assert isinstance(changed, Setup)
    assert changed.controller.law.feedback.proportional < setup.controller.law.feedback.proportional
    assert designs == [setup.file.control, slower]


def test_reading_alone_designs_nothing(designs: list[design.Settings]) -> None:
    load_stage(CONFIG / "ball-screw.yaml", designed=False)
    assert designs == []


def test_the_margins_are_those_of_the_loop_that_runs(ball_screw: Setup) -> None:
    assert math.degrees(ball_screw.margins.phase) == pytest.approx(25.8, abs=0.05)
    assert ball_screw.margins.stable


def test_layers_are_switched_off_one_by_one(ball_screw: Setup) -> None:
    whole = ball_screw.controller
    assert whole.without(frozenset()) == whole
    ahead = whole.without({"ptc"}).feedforward
    assert (ahead.with_ptc, ahead.with_friction) == (False, True)
    ahead = whole.without({"friction"}).feedforward
    assert (ahead.with_ptc, ahead.with_friction) == (True, False)
