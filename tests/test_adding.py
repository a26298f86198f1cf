"""The blocks of the page on adding things work in the files that they name."""

from __future__ import annotations

import ast
import importlib
import re
import textwrap
import tomllib
from typing import Any

import pytest
from stagectl_studies.effect_pictures.scenes import SIZES

from stagectl.config.stage_file import Setup
from stagectl.drives.canopen.presets import Preset
from stagectl.gap.effects import library
from stagectl.gap.experiment_design.stage_scale import scale_of
from stagectl.kernels.friction import StopOperators
from tests.printed import DOCS

BLOCK = re.compile(r'^( *)```(\w+) title="(stagectl/[^"]+)"\n(.*?)^ *```', re.DOTALL | re.MULTILINE)
BLOCKS = {place: textwrap.dedent(code) for _, _, place, code in BLOCK.findall((DOCS / "adding.md").read_text())}


def _run(place: str) -> dict[str, Any]:
    """The names of the module at `place` after its block was appended; its tables are copies."""
    module = importlib.import_module(place.removesuffix(".py").replace("/", "."))
    names = {name: dict(value) if isinstance(value, dict) else value for name, value in vars(module).items()}
    exec(compile(BLOCKS[place], place, "exec"), names)
    return names


def test_the_page_has_these_blocks() -> None:
    assert {place.rpartition("/")[2] for place in BLOCKS} == {
        "friction_laws.py",
        "effects.toml",
        "mechanics.py",
        "presets.py",
        "catalogue.py",
    }


def test_the_friction_law_makes_operators() -> None:
    law = _run("stagectl/config/friction_laws.py")["Iwan"]
    operators = law(coulomb=0.8, shortest=1e-6, longest=1e-3).operators()
    assert isinstance(operators, StopOperators) and sum(operators.weight) == pytest.approx(0.8)


def test_the_record_and_the_parameters_make_an_effect() -> None:
    ((name, record),) = tomllib.loads(BLOCKS["stagectl/gap/effects/effects.toml"]).items()
    parameters = _run("stagectl/gap/effects/mechanics.py")["PARAMETERS"][name]
    effect = library._effect(name, record)._replace(parameters=parameters)
    assert effect.label == "second cogging harmonic" and set(effect.look_alikes) <= set(library.EFFECTS)
    assert effect.parameters is not None and effect.parameters(SIZES) is not None


def test_the_preset_is_one() -> None:
    place = "stagectl/drives/canopen/presets.py"
    (row,) = ast.parse(BLOCKS[place]).body
    assert isinstance(row, ast.Expr)
    module = vars(importlib.import_module("stagectl.drives.canopen.presets"))
    (preset,) = eval(compile(ast.Expression(row.value), place, "eval"), dict(module))
    assert isinstance(preset, Preset) and preset.name == "acme-one"


def test_the_recipe_moves(ball_screw: Setup) -> None:
    recipe = _run("stagectl/gap/experiment_design/catalogue.py")["RECIPES"]["sine-within-presliding"]
    assert all(part.duration > 0.0 for part in recipe.motion(scale_of(ball_screw)))
