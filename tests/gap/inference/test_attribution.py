"""Whose the gap is: blocks and coordinates of the effects, of the parameters, of the unexplained."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.gap.inference import attribution
from stagectl.gap.result.diagnosis import PARAMETERS, UNEXPLAINED, Coordinate, FoundEffect, Part

ECCENTRICITY = FoundEffect("encoder_eccentricity", (), 0.9, 0.0, {}, block="sensor", coordinate="position_mod_pitch")
INERTIA = FoundEffect("inertia", (), 1.0, 0.4, {}, parameter=True, coordinate="acceleration")
REST = (Part(UNEXPLAINED, "mechanics", "none", 0.15), Part(UNEXPLAINED, "drive", "none", 0.05))


def evidence(before: float, after: float) -> Any:
    """Residual efforts whose sums of squares are these, in one run of four rows without noise."""
    run = SimpleNamespace(weight=np.ones(4), paths=(None,))

    def rows(square: float) -> Any:
        return [[np.column_stack([np.full(4, np.sqrt(square / 4.0)), np.zeros(4)])]]

    base = SimpleNamespace(before=rows(before), after=rows(after))
    return SimpleNamespace(runs=[run], base=base, deviations=[[np.zeros((4, 2))]], beside=None)


def selection(gains: dict[str, float], left: tuple[float, float], block: str = "sensor") -> Any:
    effects = [SimpleNamespace(effect=SimpleNamespace(name=name, block=block)) for name in gains]
    return SimpleNamespace(fitted=SimpleNamespace(effects=effects), gains=gains, left=left)


def test_a_share_goes_to_the_effect_the_parameters_and_the_rest() -> None:
    selected = selection({"encoder_eccentricity": 15.0}, (5.0, -1.0))
    parts = attribution.parts_of(evidence(100.0, 20.0), selected, [ECCENTRICITY, INERTIA])
    assert [(part.name, part.block, part.share) for part in parts] == [
        ("encoder_eccentricity", "sensor", pytest.approx(0.15)),
        (PARAMETERS, "mechanics", pytest.approx(0.8)),
        (UNEXPLAINED, "mechanics", pytest.approx(0.05)),
        (UNEXPLAINED, "drive", 0.0),
    ]


def test_what_an_effect_takes_that_is_not_named_is_unexplained() -> None:
    doubted = FoundEffect("dead_time", (), 0.1, 0.0, {}, block="drive")
    parts = attribution.parts_of(evidence(20.0, 20.0), selection({"dead_time": 15.0}, (5.0, 0.0), "drive"), [doubted])
    assert parts == (Part(UNEXPLAINED, "mechanics", "none", 0.25), Part(UNEXPLAINED, "drive", "none", 0.75))
    named = [Part("dead_time", "drive", "frequency", 1.0)]
    assert attribution.of_named(named, [doubted]) == tuple(named)
    assert attribution.of_named(named, []) == (Part(UNEXPLAINED, "drive", "none", 1.0),)


def test_parameters_count_each_in_its_own_block() -> None:
    """A delay of the drive beside an inertia; the coordinate is that of the largest in the block."""
    delay = FoundEffect("dead_time", (), 1.0, 0.1, {}, block="drive", parameter=True)
    viscous = FoundEffect("viscous", (), 1.0, 0.3, {}, parameter=True, coordinate="speed")
    selected = selection({}, (20.0, 0.0))
    parts = attribution.parts_of(evidence(100.0, 20.0), selected, [viscous, delay, INERTIA])
    own = {part.block: (part.coordinate, part.share) for part in parts if part.name == PARAMETERS}
    assert own == {"mechanics": ("acceleration", pytest.approx(0.7)), "drive": ("none", pytest.approx(0.1))}
    assert attribution.blocks(parts, True, True)["drive"] == pytest.approx(0.125)


def test_the_block_is_that_of_the_named_effect_however_much_the_parameters_take() -> None:
    parts = [Part("encoder_eccentricity", "sensor", "position_mod_pitch", 0.1), Part(PARAMETERS, "mechanics", "", 0.7)]
    shares = attribution.blocks([*parts, *REST], True, True)
    assert shares == {"controller": 0.0, "drive": 0.0, "mechanics": 0.0, "sensor": 1.0}


def test_a_delay_of_the_drive_is_in_the_drive_beside_an_effect_of_the_mechanics() -> None:
    """Without a measured current it is a parameter of the model, and there is no cut of the drive."""
    parts = [
        Part("cogging", "mechanics", "position_mod_pitch", 0.3),
        Part(PARAMETERS, "mechanics", "acceleration", 0.4),
        Part(PARAMETERS, "drive", "none", 0.1),
    ]
    shares = attribution.blocks([*parts, *REST], True, False)
    assert (shares["mechanics"], shares["drive"]) == (pytest.approx(0.75), pytest.approx(0.25))


def test_without_an_effect_the_parameters_count_or_the_unexplained_where_it_is_more() -> None:
    assert attribution.blocks([Part(PARAMETERS, "sensor", "none", 0.5), *REST], True, True)["sensor"] == 1.0
    for taken in (0.0, 0.1):
        shares = attribution.blocks([Part(PARAMETERS, "sensor", "none", taken), *REST], True, True)
        assert (shares["mechanics"], shares["drive"]) == (pytest.approx(0.75), pytest.approx(0.25))


def test_a_cut_that_was_impossible_has_no_share() -> None:
    parts = [Part("cogging", "mechanics", "position_mod_pitch", 1.0), *REST]
    shares = attribution.blocks(parts, False, False)
    assert shares == {"controller": None, "drive": None, "mechanics": 1.0, "sensor": 0.0}


def test_the_coordinate_of_the_cause_comes_beside_what_orders_the_rest() -> None:
    parts = [
        Part("cogging", "mechanics", "position_mod_pitch", 0.6),
        Part(PARAMETERS, "mechanics", "speed", 5.0),
        *REST,
    ]
    found = attribution.with_coordinates(parts, [Coordinate("speed", 0.8), Coordinate("position_mod_pitch", 0.4)])
    assert [item.name for item in found] == ["position_mod_pitch", "speed"]
    assert [item.share for item in found] == pytest.approx([0.75 + 0.25 * 0.4, 0.25 * 0.8])
