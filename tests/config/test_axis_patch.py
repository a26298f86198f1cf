"""Values of one axis among several: they become entries of that axis, and the other axes stay as they are."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

import stagectl as sc
from stagectl.config.patch import write
from stagectl.config.source import ConfigError
from tests.conftest import CONFIG


@pytest.fixture
def plane(tmp_path: Path) -> Path:
    shutil.copytree(CONFIG / "drives", tmp_path / "drives")
    return Path(shutil.copy(CONFIG / "xy.yaml", tmp_path))


def axis_of(plane: Path, name: str) -> Path:
    return plane.with_name(f"{plane.name}#{name}")


@pytest.mark.parametrize("name", ["x", "y"])
@pytest.mark.parametrize("copy", ["xy.yaml", "xy2.yaml", "xy.yaml#x"])
def test_values_go_to_their_axis(plane: Path, name: str, copy: str) -> None:
    before = {axis: sc.load_stage(axis_of(plane, axis)).setup.file for axis in "xy"}
    text, target = plane.read_text(), plane.with_name(copy.partition("#")[0])
    write(axis_of(plane, name), plane.with_name(copy), {"mechanics.inertia": 0.009, "control.bandwidth": 7.5})
    after = {axis: sc.load_stage(axis_of(target, axis)).setup.file for axis in "xy"}
    other = "y" if name == "x" else "x"
    assert after[name].mechanics.inertia == 0.009
    assert sc.load_stage(axis_of(target, name)).loop.bandwidth == 7.5
    assert after[other] == before[other]
    assert target.read_text().partition("\naxis:")[2] == text.partition("\naxis:")[2]  # with all comments


def test_a_block_that_is_replaced_is_the_axis_own(plane: Path) -> None:
    friction: dict[str, Any] = {"law": "stop-operators", "weight": [0.4, 0.5], "slip": [1e-3, 2e-3]}
    write(axis_of(plane, "x"), plane, {"friction": friction})
    assert sc.load_stage(axis_of(plane, "x")).setup.stage.friction.operators.weight == pytest.approx([0.4, 0.5])
    assert len(sc.load_stage(axis_of(plane, "y")).setup.stage.friction.operators.weight) == 12


def test_a_stage_is_saved_into_its_axis(plane: Path) -> None:
    saved = sc.load_stage(axis_of(plane, "x")).changed({"mechanics.inertia": 0.011}).save(plane)
    assert (saved.path, saved.setup.stage.mechanics.inertia) == (axis_of(plane, "x"), 0.011)
    assert sc.load_stage(axis_of(plane, "y")).setup.stage.mechanics.inertia == 0.008


def test_an_unusable_value_leaves_the_file(plane: Path) -> None:
    text = plane.read_text()
    with pytest.raises(ConfigError):
        write(axis_of(plane, "x"), plane, {"mechanics.inertia": -1.0})
    assert plane.read_text() == text
