"""`config check` and `config schema`: what they say, and the exit code that a script goes by."""

from __future__ import annotations

import json
import os
from pathlib import Path
from unittest.mock import Mock

import jsonschema
import pytest
import yaml

from stagectl.config.machine_file import axes_of
from tests.cli.conftest import Command
from tests.conftest import CONFIG

STAGES = sorted(CONFIG.glob("*.yaml"))
MOTIONS = sorted((CONFIG / "trajectories").glob("*.yaml"))


def test_everything_that_is_shipped_is_good(command: Command) -> None:
    code, out, err = command("config", "check", *STAGES, *MOTIONS)
    assert (code, out) == (0, "")
    axes = [axis for path in STAGES for axis in axes_of(path)]  # a file of several axes is a line each
    assert len(axes) == len(STAGES) + 1  # xy.yaml
    assert len(err.splitlines()) == len(axes) + len(MOTIONS)
    assert all(line.startswith("good") for line in err.splitlines())
    assert "ball-screw stage A, bandwidth 40 Hz at 0.5 ms; phase margin 25.8 deg (at least 20)" in err
    assert "travel -50 mm to 50 mm, 300 mm/s, 15 A" in err
    assert "sine-0.8hz.yaml: trajectory of 5 s" in err  # 2 periods and 2 ramps at 0.8 Hz


def test_an_interface_that_was_never_tried_is_not_called_good(command: Command, tmp_path: Path) -> None:
    text = (CONFIG / "ball-screw.yaml").read_text().replace("eds: drives/", f"eds: {CONFIG}/drives/")
    for interface, good in (("socketcan", True), ("pcan", False)):
        (tmp_path / "stage.yaml").write_text(text.replace("interface: embedded", f"interface: {interface}"))
        code, _, err = command("config", "check", tmp_path / "stage.yaml")
        assert code == 0 and err.startswith("good" if good else "valid") and ("warning" in err) != good


def test_the_stage_of_many_trajectories_is_read_twice(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once to be checked itself, once for all that must keep to its limits."""
    from stagectl.config import stage_file

    load = Mock(wraps=stage_file.load_stage)
    monkeypatch.setattr(stage_file, "load_stage", load)
    sines = [path for path in MOTIONS if path.name.startswith("sine")]
    code, _, err = command("config", "check", CONFIG / "ball-screw.yaml", *sines)
    assert code == 0 and err.count("within the limits of") == len(sines)
    assert load.call_count == 2


def test_the_margin_is_that_of_the_loop_with_its_observer(command: Command, tmp_path: Path) -> None:
    text = (CONFIG / "ball-screw.yaml").read_text().replace("eds: drives/", f"eds: {CONFIG}/drives/")
    watched = tmp_path / "watched.yaml"
    watched.write_text(text.replace("  margin: 20 deg\n", "  margin: 20 deg\n  layers: [ptc, friction, observer]\n"))
    code, _, err = command("config", "check", watched)
    assert code == 0
    assert (
        "phase margin 21.8 deg (at least 20), gain margin 7.7 dB" in err
    )  # 25.8 deg and 8.4 dB without; as `tune` shows both
    assert "with the observer" in err


def test_exit_codes_and_the_worst_of_many(command: Command, tmp_path: Path) -> None:
    bad = tmp_path / "bad.yaml"
    bad.write_text("type: dwell\nduration: 1\n")
    assert command("config", "check", MOTIONS[0])[0] == 0
    assert command("config", "check", bad, MOTIONS[0])[0] == 1
    assert command("config", "check", tmp_path / "absent.yaml")[0] == 2
    assert command("config", "check", tmp_path)[0] == 2
    code, out, err = command("config", "check", MOTIONS[0], tmp_path / "absent.yaml", bad)
    assert (code, out) == (2, "")
    assert [line.split()[0] for line in err.splitlines()] == ["good", "error:", "error:"]
    assert f"duration = 1; the unit is missing; must lie in (0, 86400] s ({bad}:2)" in err


def test_a_pipe_is_refused_and_not_waited_for(command: Command, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    code, _, err = command("config", "check", tmp_path / "pipe")
    assert code == 2
    assert "is not a file" in err


@pytest.mark.parametrize("name", ["[/bold] [red]", "[/]", ":warning: stage", "[link=x]y", "a \\", "\\["])
def test_what_looks_like_markup_is_shown_as_it_stands(command: Command, tmp_path: Path, name: str) -> None:
    (tmp_path / "drives").symlink_to(CONFIG / "drives")
    text = (CONFIG / "ball-screw.yaml").read_text()
    stage = tmp_path / "stage.yaml"
    stage.write_text(text.replace("ball-screw stage A", f"'{name}'"))
    code, _, err = command("config", "check", stage)
    assert code == 0
    assert f": {name}, bandwidth 40 Hz" in err
    stage.write_text(text.replace("kind: rotary", f"kind: '{name}'"))
    code, _, err = command("config", "check", stage)
    assert code == 1
    assert f"axis.kind = {name}; must be one of rotary, linear" in err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("amplitude: 2 mm\n", "type is missing"),
        ("axis: {kind: rotary}\n", "motor is missing"),
        ("[]\n", "must be a block of `key: value` lines"),
        ("axis:\n  kind: linear\ntype: sine\n", "axis is not known"),
    ],
)
def test_it_knows_a_stage_from_a_trajectory(command: Command, tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "what.yaml").write_text(text)
    code, _, err = command("config", "check", tmp_path / "what.yaml")
    assert code == 1
    assert words in err


def test_an_angle_needs_no_stage_to_be_checked(command: Command, tmp_path: Path) -> None:
    (tmp_path / "turn.yaml").write_text("type: sine\namplitude: 10 deg\nfrequency: 1 Hz\nperiods: 1\n")
    assert command("config", "check", tmp_path / "turn.yaml")[0] == 0


@pytest.mark.parametrize(("name", "file"), [("stage", STAGES[0]), ("trajectory", MOTIONS[0])])
def test_the_schema_on_standard_output(command: Command, name: str, file: Path) -> None:
    code, out, err = command("config", "schema", name)
    assert (code, err) == (0, "")
    schema = json.loads(out)
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(yaml.safe_load(file.read_text()), schema)


def test_an_unknown_schema(command: Command) -> None:
    code, out, err = command("config", "schema", "drive")
    assert (code, out, err) == (2, "", "error: schema = drive; must be one of stage, trajectory\n")
