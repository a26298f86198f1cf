"""`identify` as a user types it: the answer in four forms, and every mistake in words."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from stagectl.config.stage_file import load_stage
from stagectl.identification import capture_checks
from tests.cli.conftest import Command
from tests.conftest import CONFIG
from tests.identification.synthetic import TC, D, J, motion, write_csv

STAGE = CONFIG / "ball-screw.yaml"
LEAST_SQUARES = ("identify", "least-squares", STAGE)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in, with a log."""
    monkeypatch.chdir(tmp_path)
    write_csv(tmp_path / "log.csv", motion())
    return tmp_path


def test_the_answer(command: Command) -> None:
    code, out, err = command(*LEAST_SQUARES, "log.csv", "--json", "-")
    assert code == 0
    answer: dict[str, Any] = json.loads(out)
    assert (answer["method"], answer["stage"], answer["held_out"]) == ("least-squares", "ball-screw stage A", [])
    for name, value, unit in (("inertia", J, "kg m^2"), ("viscous", D, "N m s/rad"), ("coulomb", TC, "N m")):
        parameter = answer["parameters"][name]
        assert set(parameter) == {"value", "low", "high", "unit"} and parameter["unit"] == unit
        assert parameter["low"] < parameter["value"] < parameter["high"]
        assert parameter["value"] == pytest.approx(value, rel=0.02)
    (capture,) = answer["captures"]
    assert (capture["name"], capture["rows"], capture["current"]) == ("log.csv", 20000, "measured_current")
    assert answer["changes"]["mechanics.inertia"] == answer["parameters"]["inertia"]["value"]
    assert answer["table"] is None and {"identifiability", "notes", "details"} <= set(answer)
    for words in ("95 % interval", "log.csv: 20000 rows every 0.5 ms, taken from measured_current", "force residual"):
        assert words in err


def test_the_page_is_written_where_it_is_asked_for_or_beside_the_recordings(command: Command, folder: Path) -> None:
    assert "report: recordings/" in command(*LEAST_SQUARES, "log.csv")[2]
    (page,) = (folder / "recordings").glob("*-identify-least-squares*.html")
    text = page.read_text()
    for words in ("Found: inertia 0.01", "Position and current of log.csv.", "<h2>Parameters</h2>", "data:image/png"):
        assert words in text
    assert "report: out/page.html" in command(*LEAST_SQUARES, "log.csv", "--report", "out/page.html")[2]
    assert len(list((folder / "recordings").iterdir())) == 1


def test_write_patches_and_says_what(command: Command, folder: Path) -> None:
    mine = folder / "mine.yaml"
    assert "wrote mine.yaml, a copy of" in command(*LEAST_SQUARES, "log.csv", "--write", "mine.yaml")[2]
    file = load_stage(mine).file
    assert file.mechanics.inertia == pytest.approx(J, rel=0.02)
    before, after = STAGE.read_text().splitlines(), mine.read_text().splitlines()
    assert len(before) == len(after)
    differing = {old.split(":")[0].strip() for old, new in zip(before, after, strict=True) if old != new}
    assert {"inertia", "viscous"} <= differing <= {"inertia", "viscous", "coulomb", "bias"}
    err = command("identify", "least-squares", "mine.yaml", "log.csv", "--write", "mine.yaml")[2]
    assert "wrote mine.yaml: nothing has changed" in err


def test_write_refuses_what_is_not_this_machine(
    command: Command, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(capture_checks, "implausible", lambda values, setup: ["inertia is 11, 0.01 in the stage file"])
    mine = folder / "mine.yaml"
    mine.write_text(STAGE.read_text())
    code, out, err = command("identify", "least-squares", mine, "log.csv", "--write", mine, "--json", "-")
    assert code == 2 and json.loads(out)["notes"][0] == "inertia is 11, 0.01 in the stage file"
    assert "nothing is written, as inertia is 11" in err
    assert mine.read_text() == STAGE.read_text()
    assert command("identify", "least-squares", mine, "log.csv", "--write", mine, "--doubtful")[0] == 0
    assert mine.read_text() != STAGE.read_text()


def test_a_log_without_a_header(command: Command, folder: Path) -> None:
    write_csv(folder / "bare.csv", motion(), header="")
    code, _, err = command(*LEAST_SQUARES, "bare.csv")
    assert code == 2 and "current is taken from 3 in A, 30 % sure" in err
    assert "--columns 'time=1:s,position=2:rad,current=3:A'" in err
    code, _, err = command(*LEAST_SQUARES, "bare.csv", "--columns", "time=1,position=2:rad,current=3")
    assert code == 0 and "bare.csv: 20000 rows" in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("identify", "guessing", STAGE, "log.csv"), "least-squares: inertia, viscous and Coulomb friction and offset"),
        (("identify", "least-squares", "none.yaml", "log.csv"), "none.yaml cannot be read"),
        (("identify", "least-squares", CONFIG / "emps.yaml", "log.csv"), "position in rad on a linear axis: "),
        ((*LEAST_SQUARES, "none.csv"), "none.csv: no such file or folder"),
        ((*LEAST_SQUARES, "none.h5"), "none.h5: no such file or folder"),
        ((*LEAST_SQUARES, "log.csv", "--delay", "2 mm"), "--delay 2 mm: 'mm' does not measure s; write a time such as"),
        ((*LEAST_SQUARES, "log.csv", "--delay", "0.2ms"), "--delay is not an option of least-squares"),
        ((*LEAST_SQUARES, "log.csv", "--seed", "3"), "--seed is not an option of least-squares"),
        ((*LEAST_SQUARES, "log.csv", "--every", "1s"), "--every 1s is of --watch: leave it out, or"),
        ((*LEAST_SQUARES, "log.csv", "--within", "0.2"), "--within 0.2 is of --watch"),
        ((*LEAST_SQUARES, "empty"), "empty holds neither recordings"),
        ((*LEAST_SQUARES, "log.csv", "log.csv"), "log.csv is there twice"),
        ((*LEAST_SQUARES, "log.csv", "--columns", "t"), "--columns t: 't' must be QUANTITY=COLUMN"),
        ((*LEAST_SQUARES, "log.csv", "--columns", "time=1,position=2"), "neither a current nor a command, so no force"),
        ((*LEAST_SQUARES, "log.csv", "--current", "command"), "it has no command; --current must be a column that it"),
    ],
)
def test_mistakes_end_in_words(command: Command, folder: Path, arguments: tuple[object, ...], words: str) -> None:
    (folder / "empty").mkdir()
    code, out, err = command(*arguments)
    assert (code, out) == (2, "")
    assert words in err and "Traceback" not in err
    assert {path.name for path in folder.iterdir()} == {"log.csv", "empty"}


def test_one_direction_only_is_refused(command: Command, folder: Path) -> None:
    """Without a reversal, Coulomb friction and offset are one number."""
    columns = {name: values[1790:3600] for name, values in motion().items()}
    write_csv(folder / "one-way.csv", columns)
    code, _, err = command(*LEAST_SQUARES, "one-way.csv")
    assert code == 2 and "one-way.csv: share of the samples in the rarer direction" in err
    assert "record one" in err
