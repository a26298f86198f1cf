"""The records of the effects agree with each other, with the stage model, and with the experiments."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from stagectl_studies.effect_pictures.scenes import SIZES

from stagectl.config.stage_file import Setup
from stagectl.gap.effects.effect import FAMILIES, Data, definition
from stagectl.gap.effects.library import (
    EFFECTS,
    UnknownEffectError,
    coordinate_label,
    definitions,
    excluded,
    label,
    look_alikes,
)
from stagectl.gap.experiment_design import catalogue
from stagectl.gap.experiment_design.catalogue import MANUAL
from stagectl.gap.result.diagnosis import BLOCKS

OF_BATTERY = {"sine", "stairs", "scan", "micro", "steps", "multisine", "sine-strong"}
SEARCHED = {definition.name for definition in definitions(SIZES)}


def test_records_name_only_what_exists() -> None:
    recipes = {recipe.family or name for name, recipe in catalogue.RECIPES.items()}
    experiments = OF_BATTERY | recipes | {manual.name for manual in MANUAL}
    for effect in EFFECTS.values():
        assert effect.family in FAMILIES and effect.block in BLOCKS
        assert set(effect.experiments) <= experiments, effect.name
        assert {*effect.look_alikes, *effect.generalisations} <= set(EFFECTS)
        assert not effect.extends or effect.extends in EFFECTS


def test_effects_look_alike_both_ways() -> None:
    pairs = {(a, b): data for a, effect in EFFECTS.items() for b, data in effect.look_alikes.items()}
    assert pairs == {(b, a): data for (a, b), data in pairs.items()}
    assert look_alikes("force_constant", Data.ALL) == ("current_gain",)
    assert look_alikes("bias", Data.ALL) == ()
    assert look_alikes("bias", Data.WITHOUT_CURRENT | Data.ONE_SPEED) == ("current_offset", "coulomb_asymmetry")


def test_an_effect_that_is_searched_is_no_parameter_of_the_model() -> None:
    nominal = {name for name, effect in EFFECTS.items() if effect.nominal}
    assert not SEARCHED & nominal
    assert set(EFFECTS) - SEARCHED - nominal == {"jitter", "current_quantisation", "controller"}
    without = SIZES._replace(voltage=0.0, session=(0.0,), orders={}, rotates=False)
    assert SEARCHED - {definition.name for definition in definitions(without)} == {
        "voltage_saturation",
        "friction_step",
        "encoder_interpolation",
        "cogging_map",
        "gravity",
    }
    uncommanded = {definition.name for definition in definitions(SIZES._replace(commanded=False))}
    assert SEARCHED - uncommanded == {
        "dead_time",
        "torque_path",
        "current_loop",
        "current_saturation",
        "voltage_saturation",
    }


def _differences(before: Any, after: Any, place: str = "") -> Iterator[str]:
    """Dotted places at which two stage models differ."""
    if not hasattr(before, "_fields"):
        yield from () if np.array_equal(before, after) else (place,)
        return
    for name in before._fields:
        yield from _differences(getattr(before, name), getattr(after, name), f"{place}.{name}" if place else name)


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_changes_the_places_of_its_record_and_no_others(name: str, ball_screw: Setup) -> None:
    effect = EFFECTS[name]
    parameters = definition(effect, SIZES)
    if parameters is None:
        return
    changed: set[str] = set()
    for choice, side in ((0, 1.0), (-1, 1.0), (0, -1.0)):
        values = {shape.name: shape.grid[choice] for shape in parameters.shapes}
        values |= {p.name: max(side * p.typical[0], p.low) for p in parameters.amplitudes}
        stage = ball_screw.stage
        stage = stage._replace(friction=stage.friction._replace(bristle=stage.friction.bristle._replace(coulomb=1.0)))
        changed |= set(_differences(stage, parameters.apply(stage, values)))
    assert {place for place in effect.places if any(f"{c}.".startswith(f"{place}.") for c in changed)} == set(
        effect.places
    )
    assert all(any(f"{c}.".startswith(f"{place}.") for place in effect.places) for c in changed)


def test_labels() -> None:
    assert label("bias") == "constant force on the axis" and label("brand_new_effect") == "brand new effect"
    assert (
        coordinate_label("position_mod_pitch") == "position modulo the pitch" and coordinate_label("speed") == "speed"
    )


def test_excluded_names_are_checked() -> None:
    assert excluded(["dwell, bias", "jitter"]) == ("dwell", "bias", "jitter")
    with pytest.raises(UnknownEffectError) as refused:
        excluded(["backlas"])
    assert refused.value.value == "backlas" and "backlash" in refused.value.range
    assert "backlash" in str(refused.value)
