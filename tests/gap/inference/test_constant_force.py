"""A constant force and an asymmetry share the probability that the data leave them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import stagectl as sc
from stagectl.gap.inference import constant_force
from stagectl.gap.result.diagnosis import FoundEffect
from stagectl.gap.selection import established, refine
from tests.gap.captured import CONFIG, as_csv
from tests.gap.drawn import by_night, diagnosed, drawn

REVERSALS = "micro-8 sine-1.6 held-sine-b held-micro"


def of_sine(change: dict[str, float], folder: Path) -> FoundEffect:
    """The one effect that is named in a log of the ball screw with a `change`: one sine, at one speed."""
    stage = sc.load_stage(CONFIG / "ball-screw.yaml")
    ran = sc.simulate(stage, CONFIG / "trajectories" / "sine-0.8hz.yaml", plant=stage.changed(change))
    (named,) = sc.diagnose(as_csv(ran, folder / "sine.csv"), stage=stage, advice=False).named
    return named


def of_foreign(effect: str, seed: int, experiments: str, folder: Path) -> dict[str, FoundEffect]:
    """What is named on a machine of the exam that has this `effect`."""
    return {found.name: found for found in diagnosed(drawn(folder, seed, effect, experiments=experiments)).named}


@pytest.mark.parametrize(
    "change", [{"friction.asymmetry": 0.05}, pytest.param({"mechanics.bias": 0.04}, marks=by_night)]
)
def test_one_motion_leaves_the_two_in_doubt(tmp_path: Path, change: dict[str, float]) -> None:
    """In this law of friction they are one and the same but for the first reversal."""
    named = of_sine({**change, "simulation.current_noise": 45e-3}, tmp_path)
    assert {named.name, *named.alternatives} >= {"coulomb_asymmetry", "bias"} and 0.5 <= named.probability < 0.9


def test_a_viscous_asymmetry_is_no_constant_force(tmp_path: Path) -> None:
    """At one speed a constant force takes a part of it; neither inertia nor friction has changed."""
    named = of_sine({"mechanics.viscous_asymmetry": 0.1, "simulation.current_noise": 5e-3}, tmp_path)
    size = named.parameters["size"]
    assert named.name == "viscous_asymmetry" and size.low <= 0.1 <= size.high < 0.12


@by_night
def test_what_the_data_leave_open_is_in_doubt(tmp_path: Path) -> None:
    """A machine whose reversals tell the two apart hardly at all: about as probable as each other."""
    (found,) = of_foreign("bias", 41, "", tmp_path).values()
    assert {found.name, *found.alternatives} >= {"bias", "coulomb_asymmetry"} and 0.4 < found.probability < 0.7


@pytest.mark.parametrize(
    ("effect", "seed", "experiments"),
    [("bias", 42, REVERSALS), ("cable_spring", 2, "scan sine-1.6 held-sine-b")],
)
def test_reversals_and_places_tell_them_apart(tmp_path: Path, effect: str, seed: int, experiments: str) -> None:
    """Where the law of friction does; a spring beside the middle of the travel gives a constant force, too.

    The other way round, an asymmetry that is no constant force: `tests/gap/test_diagnose.py`.
    """
    found = of_foreign(effect, seed, experiments, tmp_path)
    assert found[effect].probability > 0.5
    assert {"bias", "coulomb_asymmetry", "cable_spring"} & {*found} == {effect}


@pytest.mark.parametrize("stays", [True, False])
def test_where_nothing_stands_in_its_place_the_bias_stays_free(monkeypatch: pytest.MonkeyPatch, stays: bool) -> None:
    """A belt that no simulation confirmed left a wrist with no constant force at all."""
    belt = SimpleNamespace(effect=SimpleNamespace(name="compliance"))
    nominal = SimpleNamespace(values=lambda _: [belt], verdict=SimpleNamespace(sets=[None]))
    compared = SimpleNamespace(
        bias=0.2,
        fixed="fixed",
        nominal=SimpleNamespace(model=None, effects=()),
        beside=(None, nominal),
        of_effects=dict,
    )
    fitted = SimpleNamespace(effects=(belt,) if stays else ())
    found: Any = SimpleNamespace(fitted=SimpleNamespace(effects=()), probability={}, _replace=lambda **_: "as it was")
    after = SimpleNamespace(fitted=fitted, probability={}, _replace=lambda **_: "in its place")
    for place, value in (
        (
            constant_force,
            {"_compared": lambda *_: compared, "_matters": lambda *_: True, "joined": lambda *_: []},
        ),
        (refine, {"nuisances": lambda _: ["bias"], "refine": lambda *_: None}),
        (established, {"established": lambda *_: after}),
    ):
        for name, stub in value.items():
            monkeypatch.setattr(place, name, stub)
    anything: Any = "free"
    expected = ("fixed", "in its place") if stays else ("free", "as it was")
    assert constant_force.settled(anything, anything, found, lambda _: None) == expected
