"""What the diagnosis is measured against: each baseline on one trial of the exam's machine, and its own arithmetic."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow.csv
import pytest
from stagectl_studies.baselines.__main__ import answer
from stagectl_studies.baselines.blackbox import since_reversal
from stagectl_studies.baselines.sparse import bic_of, greedy
from stagectl_studies.machine.stage_trial import stage_trial
from stagectl_studies.machine.trials import Options as Drawn
from stagectl_studies.machine.trials import draw

from stagectl.gap.effects.effect import Definition
from stagectl.gap.logs.load_session import load
from stagectl.gap.logs.session import Array, Session
from stagectl.gap.selection.candidates import Form
from stagectl.gap.validation import rollouts
from stagectl.gap.validation.rollouts import column

NAMES = ("refit", "ladder", "sparse", "blackbox", "oracle")
HIDDEN = "viscous_asymmetry"


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Session]:
    """A machine of the exam with one hidden effect, and what every baseline says of it."""
    place = tmp_path_factory.mktemp("baselines")
    stage_trial(draw(3, "single", Drawn(short=True, effects=(HIDDEN,), scale=2.0)), place)
    answer(place / "captures", place, NAMES, ((), (HIDDEN,)))
    return place, load([place / "captures"])


def said(place: Path, name: str) -> dict[str, Any]:
    reply: dict[str, Any] = json.loads((place / name / "answer.json").read_text())
    return reply


def effects(place: Path, name: str) -> list[str]:
    return [effect["name"] for effect in said(place, name)["effects"] if not effect["parameter"]]


def gap(session: Session, folder: Path) -> float:
    """RMS of what the predictions of the held-out runs lack (rad)."""
    held = [log for log in session.logs if log.held_out]
    assert sorted(path.name for path in folder.iterdir()) == sorted(Path(log.name).name for log in held)
    lacking = []
    for log in held:
        position = pyarrow.csv.read_csv(folder / Path(log.name).name)["position_rad"].to_numpy()
        lacking.append(log.position - position)
    return float(np.sqrt(np.mean(np.concatenate(lacking) ** 2)))


def nominal(session: Session) -> float:
    held = [log for log in session.logs if log.held_out]
    rows = rollouts.simulated_logs(session, session.stage, held)
    lacking = [log.position - column(row, "measured")[: log.rows] for log, row in zip(held, rows, strict=True)]
    return float(np.sqrt(np.mean(np.concatenate(lacking) ** 2)))


def test_what_each_of_them_names(answered: tuple[Path, Session]) -> None:
    place, _ = answered
    assert effects(place, "refit") == [] and effects(place, "blackbox") == []
    assert effects(place, "oracle") == [HIDDEN]  # nothing but what it was told
    assert HIDDEN in effects(place, "sparse")
    assert HIDDEN not in effects(place, "ladder")  # its rungs do not hold it
    assert said(place, "oracle")["verdict"] == "effects" and said(place, "blackbox")["verdict"] == "none"


def test_how_far_each_of_them_closes_the_gap(answered: tuple[Path, Session]) -> None:
    place, session = answered
    before = nominal(session)
    left = {name: gap(session, place / name / "predictions") for name in NAMES}
    assert left["oracle"] < 0.5 * before
    assert left["oracle"] < left["refit"] < before  # values of the model take a part of what they do not explain
    assert left["blackbox"] < 0.5 * before  # learnt from the training runs alone


def matrix(columns: Array, y: Array) -> Array:
    whole = np.column_stack([columns, y])
    squares: Array = whole.T @ whole
    return squares


def form(effect: str, *names: str) -> Form:
    return Form(cast(Definition, Named(effect)), {}, (1.0,) * len(names), names)


class Named:
    def __init__(self, name: str) -> None:
        self.name = name


FORMS = [(form("a", "1"), [1]), (form("a", "2"), [2]), (form("b", "3", "4"), [3, 4]), (form("c", "5"), [5])]


def test_the_greedy_path_takes_one_form_of_each_effect_as_long_as_the_criterion_falls() -> None:
    random = np.random.default_rng(5)
    x = random.standard_normal((4000, 6))
    x[:, 2] = 0.9 * x[:, 1] + 0.4 * x[:, 2]  # another form of the same effect takes much of it
    y = 7.0 * x[:, 0] + 2.0 * x[:, 1] + 0.5 * x[:, 3] - 0.5 * x[:, 4] + random.standard_normal(4000)
    chosen = greedy(matrix(x, y), [0], FORMS, 4000.0)
    assert [(entry.effect.name, entry.names) for entry in chosen] == [("a", ("1",)), ("b", ("3", "4"))]
    assert greedy(matrix(x, random.standard_normal(4000)), [0], FORMS, 4000.0) == []


def test_the_criterion() -> None:
    assert bic_of(8.0, 4.0) == pytest.approx(4.0 * np.log(2.0))
    assert np.isfinite(bic_of(0.0, 4.0))


def test_displacement_since_the_last_reversal() -> None:
    position = np.array([0.0, 1.0, 2.0, 1.5, 1.0, 1.5])
    speed = np.array([1.0, 1.0, 1.0, -1.0, -1.0, 1.0])
    assert since_reversal(position, speed).tolist() == [0.0, 1.0, 2.0, 0.0, -0.5, 0.0]
