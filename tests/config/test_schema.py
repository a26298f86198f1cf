"""The JSON schema that editors use: valid itself, true to the shipped files, and it notices mistakes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from stagectl.config.schema import SCHEMAS
from tests.conftest import CONFIG


def found(schema: str, text: str) -> list[str]:
    """What an editor would mark in this file."""
    validator = jsonschema.Draft202012Validator(SCHEMAS[schema]())
    return [error.message for error in validator.iter_errors(yaml.safe_load(text))]


@pytest.mark.parametrize("name", SCHEMAS)
def test_it_is_a_schema_and_pure_json(name: str) -> None:
    schema = SCHEMAS[name]()
    jsonschema.Draft202012Validator.check_schema(schema)
    assert json.loads(json.dumps(schema, allow_nan=False)) == schema


@pytest.mark.parametrize("path", sorted(set(CONFIG.glob("*.yaml")) - {CONFIG / "xy.yaml"}), ids=lambda path: path.stem)
def test_shipped_stages_are_good(path: Path) -> None:
    assert found("stage", path.read_text()) == []


@pytest.mark.parametrize("path", sorted((CONFIG / "trajectories").glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_trajectories_are_good(path: Path) -> None:
    assert found("trajectory", path.read_text()) == []


STAGE = (CONFIG / "ball-screw.yaml").read_text()
VARIANTS = [
    ("cpu", "priority: 80", "priority: 80\n  cpu: 1"),
    ("no cpu", "priority: 80", "priority: 80\n  cpu: null"),
    ("encoder step", "counts_per_revolution: 1048576", "step: 1e-5 rad"),
    ("Stribeck with a pure number", "elements: 12", "elements: 12\n  stribeck: {rise: 0.2, velocity: 3 mm/s}"),
    ("Stribeck in percent", "elements: 12", "elements: 12\n  stribeck: {rise: 20 %, velocity: 3 mm/s}"),
    ("objects", "node: 5", "node: 5\n    rpdo: [0x6040_00, 0x6071_00]"),
    ("no wire", STAGE[STAGE.index("    kind: canopen") : STAGE.index("control:")], "    kind: simulated\n\n"),
]


@pytest.mark.parametrize(("old", "new"), [variant[1:] for variant in VARIANTS], ids=[v[0] for v in VARIANTS])
def test_what_the_loader_takes_is_good(old: str, new: str) -> None:
    assert STAGE.count(old) == 1
    assert found("stage", STAGE.replace(old, new)) == []


MISTAKES = [
    ("lead: 12 mm", "lead: 12"),
    ("lead: 12 mm", 'lead: "12"'),
    ("lead: 12 mm", "lead: mm"),
    ("lead: 12 mm", "lead: [12 mm]"),
    ("lead: 12 mm", "lead: 12,5 mm"),
    ("lead: 12 mm", "lead: １２ mm"),
    ("lead: 12 mm", "led: 12 mm"),
    ("lead: 12 mm", "lead:"),
    ("bandwidth: 40 Hz", "bandwidth: .nan"),
    ("bandwidth: 40 Hz", "bandwidth: 1e400"),
    ("kind: rotary", "kind: round"),
    ("elements: 12", "elements: 12.5"),
    ("elements: 12", "elements: 65"),
    ("elements: 12", "elements: 0"),
    ("elements: 12", "elements: 12\n  stribeck: {rise: a lot}"),
    ("elements: 12", "elements: 12\n  stribeck: {rise: 11}"),
    ("law: rolling", "law: rollin"),
    ("kind: canopen", "kind: cannopen"),
    ("travel: [-50 mm, 50 mm]", "travel: [-50 mm]"),
    ("travel: [-50 mm, 50 mm]", "travel: 50 mm"),
    ("clock: sync", "clock: never"),
    ("command_object: 0x6071_00", "command_object: torque"),
    ("  inertia: 0.010 kg m^2\n", ""),
    ("motor:\n  force_constant: 0.72 N m/A\n", ""),
]


@pytest.mark.parametrize(
    ("old", "new"), MISTAKES, ids=[new.strip() or f"no {old[:8].strip()}" for old, new in MISTAKES]
)
def test_mistakes_of_a_stage_are_noticed(old: str, new: str) -> None:
    assert STAGE.count(old) == 1
    assert found("stage", STAGE.replace(old, new))


SEQUENCE = """\
type: sequence
parts:
  - {type: dwell, duration: 1 s}
  - {type: sequence, parts: [{type: csv, file: a.csv}]}
"""


def test_trajectories_within_trajectories() -> None:
    assert found("trajectory", SEQUENCE) == []
    assert found("trajectory", SEQUENCE.replace("duration", "time"))
    assert found("trajectory", SEQUENCE.replace("file: a.csv", "file: 1"))


@pytest.mark.parametrize(
    "text", ["type: sin\n", "amplitude: 2 mm\n", "[]", "null", "type: dwell\nduration: 1\n", "a: 1"]
)
def test_mistakes_of_a_trajectory_are_noticed(text: str) -> None:
    assert found("trajectory", text)


def test_every_field_says_what_it_is() -> None:
    for build in SCHEMAS.values():
        assert list(_undescribed(build())) == []


def _undescribed(schema: dict[str, Any], name: str = "") -> Iterator[str]:
    for key, part in schema.get("properties", {}).items():
        if not {"description", "const", "oneOf", "anyOf"} & set(part):
            yield f"{name}.{key}"
        yield from _undescribed(part, f"{name}.{key}")
