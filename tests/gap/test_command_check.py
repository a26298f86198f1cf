"""Cut A: the deployed law gives the logged commands again; where it does not, the cause that was put in is named."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import load_stage
from stagectl.gap.controller_check.command_check import CommandCheck, check_command, resolution
from stagectl.gap.logs.load_session import load
from tests.gap.captured import CONFIG, SINE, TRAPEZOID, Columns, edit, exported, recorded, rewrite

EMPS = Path(__file__).resolve().parents[3] / "shared" / "data" / "emps" / "DATA_EMPS.mat"


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return recorded(tmp_path_factory.mktemp("own"), SINE, 1)


@pytest.fixture(scope="module")
def original(recordings: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported(recordings, tmp_path_factory.mktemp("folder") / "a", setpoints=False)


@pytest.fixture
def folder(original: Path, tmp_path: Path) -> Path:
    shutil.copytree(original, tmp_path / "copy")
    return tmp_path / "copy"


def controller(folder: Path, change: Callable[[dict[str, Any]], dict[str, Any]]) -> CommandCheck:
    """CommandCheck where the description of the controller says otherwise than what ran."""
    edit(folder / "nominal.yaml", lambda found: found["controller"].update(change(found["controller"])))
    return check_command(load([folder]))


def test_our_own_command_to_the_last_bit(recordings: list[Path]) -> None:
    found = check_command(load(recordings))
    assert found.checked and found.agrees and found.worst == 0.0


def test_from_the_folder_alone_to_1e_5(folder: Path) -> None:
    """The description's promise; the limit is 1e-4 of some ampere."""
    session = load([folder])
    found = check_command(session)
    assert found.agrees and 0.0 < found.worst < 1e-5
    command = session.logs[0].command
    assert command is not None and found.limit == pytest.approx(1e-4 * float(np.sqrt(np.mean(command**2))))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: {"Ki": 2.0 * c["Ki"]}, "the integral gain looks like 0.5 of the nominal one"),
        (lambda c: {"Kp": c["Kp"] / 1.25}, "the proportional gain looks like 1.25 of the nominal one"),
        (lambda c: {"Kp": c["Kp"] / 1.04}, "yet the proportional gain looks like 1.04 of the nominal one"),
        (lambda c: {"Kd": 2.0 * c["Kd"], "Ki": 3.0 * c["Ki"]}, "the integral gain 0.333, the derivative gain 0.5"),
        (
            lambda c: {name: c[name] / 1.2 for name in ("Kp", "Ki", "Kd")},
            "the whole feedback looks like 1.2 of the nominal one",
        ),
        (lambda c: {"derivative_pole": 2.0 * c["derivative_pole"]}, "the derivative's filter looks like 0.5"),
        (lambda c: {"friction_weight": [], "friction_slip": []}, "the friction compensation seems to differ by \\+"),
        (
            lambda c: {"model_inertia": 1.5 * c["model_inertia"]},
            "the inertia of the feedforward seems to differ by -0.5",
        ),
    ],
)
def test_another_controller_is_named(
    folder: Path, change: Callable[[dict[str, Any]], dict[str, Any]], words: str
) -> None:
    found = controller(folder, change)
    assert found.checked and not found.agrees
    assert re.search(words, found.words), found.words


def _scaled(columns: Columns) -> Columns:
    columns["current_command_A"] *= 0.72
    return columns


def _delayed(columns: Columns) -> Columns:
    columns["current_command_A"] = np.concatenate([np.zeros(3), columns["current_command_A"][:-3]])
    return columns


def _clipped(columns: Columns) -> Columns:
    columns["current_command_A"] = np.clip(columns["current_command_A"], -4.0, 4.0)
    return columns


def _biased(columns: Columns) -> Columns:
    columns["current_command_A"] += 0.125
    return columns


def _dithered(columns: Columns) -> Columns:
    columns["current_command_A"] -= 0.05 * np.sin(0.3 * np.arange(len(columns["time_s"])))
    return columns


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_scaled, "0.72 times the recomputed one, as if it were an effort instead of a current"),
        (_delayed, "the command is logged 3 rows later than the description says"),
        (_clipped, r"a limit is active: the logged command stays within \[-4, 4\] A"),
    ],
)
def test_a_column_that_is_another_is_named(folder: Path, change: Callable[[Columns], Columns], words: str) -> None:
    rewrite(folder / "sine-1.csv", change)
    found = check_command(load([folder]))
    assert not found.agrees and re.search(words, found.words), found.words


def test_an_injection_that_is_not_in_the_command(folder: Path) -> None:
    """The file says that a dither was added; the logged command does not have it."""
    rows = len((folder / "sine-1.csv").read_text().splitlines()) - 1
    dither = "".join(f"{0.05 * math.sin(0.3 * k):.12f}\n" for k in range(rows))
    (folder / "dither.csv").write_text("injection_A\n" + dither)
    edit(folder / "captures.yaml", lambda found: found["captures"][0].update(injection="dither.csv"))
    found = check_command(load([folder]))
    assert not found.agrees and "the injected current seems to be missing from the logged command" in found.words
    edit(folder / "captures.yaml", lambda found: found["captures"][0].pop("injection"))
    rewrite(folder / "sine-1.csv", _dithered)
    assert "no single cause explains it" in check_command(load([folder])).words


def test_corners_of_the_reference_are_harmless(tmp_path: Path) -> None:
    """Where the acceleration jumps, the samples do not hold what the controller knew: half an ampere at some rows."""
    found = check_command(load([exported(recorded(tmp_path / "own", TRAPEZOID, 1), tmp_path / "out", setpoints=False)]))
    assert found.agrees and found.worst < 1e-5
    assert "corners of its reference the command differs by up to 0." in found.words


def _gap(columns: Columns) -> Columns:
    rows = np.r_[0:1000, 1020 : len(columns["time_s"])]
    return {name: column[rows] for name, column in columns.items()}


def test_gaps_are_passed_over(folder: Path) -> None:
    rewrite(folder / "sine-1.csv", _gap)
    found = check_command(load([folder]))
    assert found.agrees and "after gaps the integrator is taken as it was" in found.words


def test_a_command_in_steps_agrees_within_one(folder: Path) -> None:
    def stepped(columns: Columns) -> Columns:
        columns["current_command_A"] = 0.004 * np.rint(columns["current_command_A"] / 0.004)
        return columns

    rewrite(folder / "sine-1.csv", stepped)
    found = check_command(load([folder]))
    assert found.agrees and found.limit == pytest.approx(0.004, rel=1e-3) and 0.0015 < found.worst < 0.0025


def test_resolution() -> None:
    random = np.random.default_rng(3).normal(size=20_000)
    assert resolution(random) < 1e-6
    assert resolution(0.004 * np.rint(random / 0.004)) == pytest.approx(0.004)
    assert resolution(np.zeros(10)) == 0.0


@pytest.mark.parametrize(
    ("column", "words"), [("current_command_A", "no command was logged"), ("reference_rad", "no reference was logged")]
)
def test_what_is_missing_is_not_checked(folder: Path, column: str, words: str) -> None:
    rewrite(folder / "sine-1.csv", lambda columns: {n: v for n, v in columns.items() if n != column})
    found = check_command(load([folder]))
    assert not found.checked and words in found.words


def test_without_a_controller_nothing_is_checked(folder: Path) -> None:
    edit(folder / "nominal.yaml", lambda found: found.pop("controller"))
    found = check_command(load([folder]))
    assert not found.checked and "the deployed controller is not known" in found.words


def test_a_constant_may_be_in_the_integrator(folder: Path) -> None:
    """A record that begins at rest while the controller runs: harmless, and said."""
    rewrite(folder / "sine-1.csv", _biased)
    found = check_command(load([folder]))
    assert found.agrees and "it begins while the controller runs: 0.125 A are in its integrator" in found.words


DAHL = "  law: dahl\n  coulomb: 1 N m\n  range: 10 um\n"
FORM = "compensation:\n  form: displacement\n  velocity: 5 rad/s\n  slip: 0.01 rad\n  static: 1 N m\n"
FORM += "  positive: 0.9 N m\n  negative: 0.8 N m\n\n"


def _with(text: str, friction: str = "", layers: str = "", before: str = "") -> str:
    """Another ball screw: its friction replaced, layers of its control named, a block put in."""
    if friction:
        begin = text.index("friction:\n")
        text = text[:begin] + "friction:\n" + friction + "\n" + text[text.index("encoder:", begin) :]
    if layers:
        text = text.replace("control:\n", f"control:\n  layers: [{layers}]\n", 1)
    return text.replace("encoder:\n", before + "encoder:\n", 1)


@pytest.mark.parametrize(
    "changes",
    [{"layers": "ptc, friction, observer"}, {"friction": DAHL}, {"before": FORM}],
    ids=["observer", "Dahl's compensation", "a compensation of its own form"],
)
def test_every_part_of_our_controllers_survives(tmp_path: Path, changes: dict[str, str]) -> None:
    """In the words of nominal.yaml and back: the commands agree to 1e-5 A."""
    (tmp_path / "stage.yaml").write_text(_with((CONFIG / "ball-screw.yaml").read_text(), **changes))
    folder = exported(recorded(tmp_path / "own", SINE, 1, tmp_path / "stage.yaml"), tmp_path / "out", setpoints=False)
    found = check_command(load([folder]))
    assert found.agrees and found.worst < 1e-5, found.words


def test_a_cascade_survives_and_agrees(tmp_path: Path) -> None:
    folder = exported(recorded(tmp_path / "own", SINE, 1, "linear-slider"), tmp_path / "out", setpoints=False)
    session = load([folder])
    found = check_command(session)
    assert session.law is not None and session.law.cascaded
    assert found.agrees and found.worst < 1e-5


@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS record is not beside this repository (../shared/data/emps)")
def test_the_benchmark_is_told_from_a_wrong_controller() -> None:
    """0.0037 V rms are left, half a count of the position times kv: rounding, not another law."""
    session = load([EMPS], load_stage(CONFIG / "emps.yaml"))
    found = check_command(session)
    assert found.agrees and "what a count of the position makes" in found.words
    assert found.worst == pytest.approx(243.45 * 5e-8 / 1e-3, rel=0.02)  # one count
    assert session.law is not None
    slower = session.law._replace(cascade=session.law.cascade._replace(position=0.98 * 160.18))
    assert not check_command(session._replace(law=slower)).agrees
