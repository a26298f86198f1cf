"""What is proposed for which models: by hand, by repeats, for what no run has shown."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from stagectl.gap.experiment_design import experiment_proposal, operating_range
from stagectl.gap.experiment_design.operating_range import LoggedExtremes
from stagectl.gap.inference import verdict
from stagectl.gap.result.diagnosis import FoundEffect

NOTHING: Any = None


@pytest.mark.parametrize(
    ("names", "proposal"),
    [
        (("inertia", "force_constant"), "added mass"),
        (("jitter", "dead_time"), "timestamps"),
        (("bias", "current_offset"), "power-off reading"),
    ],
)
def test_what_bears_on_most_is_done_by_hand_and_the_quicker_of_two(names: tuple[str, ...], proposal: str) -> None:
    chosen = experiment_proposal.by_hand(names)
    assert chosen is not None and (chosen.name, chosen.separates) == (proposal, names)


def test_nothing_by_hand_bears_on_everything() -> None:
    assert experiment_proposal.by_hand(("viscous_nonlinear",)) is None


@pytest.mark.parametrize(("separation", "repeats"), [(10.0, "Three"), (5.0, "4 repeats"), (0.01, "999 repeats")])
def test_a_separation_grows_with_the_root_of_the_repeats(separation: float, repeats: str) -> None:
    assert repeats in experiment_proposal.repeats_needed(separation)


def test_a_simulation_that_diverged_separates_nothing() -> None:
    assert experiment_proposal._smallest([3.0, 2.0]) == 2.0
    assert experiment_proposal._smallest([3.0, float("nan")]) == experiment_proposal._smallest([]) == 0.0


def test_at_least_one_is_tried_and_no_more_than_the_time_allows() -> None:
    assert experiment_proposal._within("abc", [99.0, 1.0, 1.0], 3, 10.0) == ["a"]
    assert experiment_proposal._within("abc", [4.0, 4.0, 4.0], 3, 10.0) == ["a", "b"]
    assert experiment_proposal._within("abc", [1.0, 1.0, 1.0], 2, 10.0) == ["a", "b"]


@pytest.mark.parametrize(("begins", "start"), [(0.0, 0.5), (0.5, 0.5), (0.3, 0.3), (0.95, 0.5)])
def test_a_start_near_an_end_leaves_no_room(begins: float, start: float) -> None:
    assert operating_range._start(LoggedExtremes(0.0, 1.0, begins, 1.0, 1.0, 1.0)) == start


AMBIGUOUS = FoundEffect("backlash", ("presliding",), 0.6, 0.3, {})
CLEAR = FoundEffect("cogging", (), 0.9, 0.5, {})
SHIFT = FoundEffect("inertia", ("force_constant",), 0.9, 0.5, {}, parameter=True)


@pytest.mark.parametrize(
    ("named", "models"),
    [((CLEAR, AMBIGUOUS), {"backlash": "fitted", "presliding": "rival"}), ((CLEAR, SHIFT), {"nominal": "stage"})],
)
def test_the_first_ambiguous_effect_is_separated_from_its_alternatives(
    monkeypatch: pytest.MonkeyPatch, named: tuple[FoundEffect, ...], models: dict[str, str]
) -> None:
    asked = []
    monkeypatch.setattr(experiment_proposal, "propose", lambda session, models, floor: asked.append((models, floor)))
    monkeypatch.setattr(verdict, "rivals", lambda e, selected, effect: {"presliding": "rival"})
    session: Any = SimpleNamespace(stage="stage")
    diagnosis: Any = SimpleNamespace(named=named, gap=SimpleNamespace(floor=2e-7))
    selected: Any = SimpleNamespace(fitted=SimpleNamespace(equipped=SimpleNamespace(stage="fitted")))
    experiment_proposal.next_experiment(session, diagnosis, selected, NOTHING)
    assert asked == [(models, 2e-7)]
