"""The command check: the deployed law gives the logged commands again; else the cause that was put in is named."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import load_stage
from stagectl.gap.controller_check import recomputed_command
from stagectl.gap.controller_check.command_check import CommandCheck, check_command, resolution
from stagectl.gap.logs.deployed_controller import DIFFERENCES
from stagectl.gap.logs.deployed_setpoints import differenced
from stagectl.gap.logs.load_session import load
from stagectl.kernels.law import OUTPUT_COLUMNS
from stagectl.recording.replay import recomputed
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
    """The check with a description of the controller that differs from the one that ran."""
    edit(folder / "nominal.yaml", lambda nominal: nominal["controller"].update(change(nominal["controller"])))
    return check_command(load([folder]))


def test_our_own_command_to_the_last_bit(recordings: list[Path]) -> None:
    check = check_command(load(recordings))
    assert check.checked and check.agrees and check.worst == 0.0


def test_from_the_folder_alone_to_1e_5(folder: Path) -> None:
    """The description's promise; the limit is 1e-4 of some ampere."""
    session = load([folder])
    check = check_command(session)
    assert check.agrees and 0.0 < check.worst < 1e-5
    command = session.logs[0].command
    assert command is not None and check.limit == pytest.approx(1e-4 * float(np.sqrt(np.mean(command**2))))


@pytest.mark.parametrize(
    ("change", "kind", "term", "value"),
    [
        (lambda c: {"Ki": 2.0 * c["Ki"]}, "factor", "integral", 0.5),
        (lambda c: {"Kp": c["Kp"] / 1.25}, "factor", "proportional", 1.25),
        (lambda c: {"Kp": c["Kp"] / 1.04}, "factor", "proportional", 1.04),
        (lambda c: {name: c[name] / 1.2 for name in ("Kp", "Ki", "Kd")}, "factor", "feedback", 1.2),
        (lambda c: {"derivative_pole": 2.0 * c["derivative_pole"]}, "pole", "derivative", 0.5),
        (lambda c: {"model_inertia": 1.5 * c["model_inertia"]}, "model", "inertia", -0.5),
    ],
)
def test_another_controller_is_named(
    folder: Path, change: Callable[[dict[str, Any]], dict[str, Any]], kind: str, term: str, value: float
) -> None:
    check = controller(folder, change)
    assert check.checked and not check.agrees and check.cause is not None
    assert (check.cause.kind, check.cause.term) == (kind, term)
    assert check.cause.value == pytest.approx(value, rel=0.01) and 0.0 <= check.cause.left < 0.1
    assert check.log == "sine-1.csv" and check.worst > 0.0 and check.cause.described in check.words


def test_two_wrong_gains_are_named_together(folder: Path) -> None:
    check = controller(folder, lambda c: {"Kd": 2.0 * c["Kd"], "Ki": 3.0 * c["Ki"]})
    assert check.cause is not None and check.cause.kind == "several"
    assert "integral gain 0.333" in check.words and "derivative gain 0.5" in check.words


def test_a_missing_compensation_is_named(folder: Path) -> None:
    check = controller(folder, lambda c: {"friction_weight": [], "friction_slip": []})
    assert check.cause is not None and (check.cause.kind, check.cause.term) == ("model", "friction")
    assert 0.5 < check.cause.value < 1.5


def test_a_wrong_gain_within_the_limit_does_not_pass(folder: Path) -> None:
    check = controller(folder, lambda c: {"Kp": c["Kp"] / 1.04})
    assert not check.agrees and check.worst <= check.limit


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
    ("change", "kind", "value"),
    [(_scaled, "command_factor", 0.72), (_delayed, "shift", 3.0), (_clipped, "limit", 4.0)],
)
def test_a_column_that_is_another_is_named(
    folder: Path, change: Callable[[Columns], Columns], kind: str, value: float
) -> None:
    rewrite(folder / "sine-1.csv", change)
    check = check_command(load([folder]))
    assert not check.agrees and check.cause is not None
    assert (check.cause.kind, check.cause.term) == (kind, "command")
    assert check.cause.value == pytest.approx(value, rel=0.01)


@pytest.mark.parametrize(("logged", "expected"), [([3.0, -4.0], [3.0, -4.0]), ([3.0, -7.0], [3.0, -7.0])])
def test_a_controller_logs_its_command_before_or_behind_its_limit(logged: list[float], expected: list[float]) -> None:
    """Of 3 and -7 A, behind a limit of 4 A: nothing differs in either log."""
    assert recomputed_command._as_logged(np.array([3.0, -7.0]), np.array(logged), 4.0).tolist() == expected


def test_a_factor_that_is_a_unit_names_the_unit(folder: Path) -> None:
    rewrite(folder / "sine-1.csv", _scaled)
    assert "effort" in check_command(load([folder])).words


def test_an_injection_that_is_not_in_the_command(folder: Path) -> None:
    """The file says that a dither was added; the logged command does not have it."""
    rows = len((folder / "sine-1.csv").read_text().splitlines()) - 1
    dither = "".join(f"{0.05 * math.sin(0.3 * k):.12f}\n" for k in range(rows))
    (folder / "dither.csv").write_text("injection_A\n" + dither)
    edit(folder / "captures.yaml", lambda capture: capture["captures"][0].update(injection="dither.csv"))
    cause = check_command(load([folder])).cause
    assert cause is not None and (cause.kind, cause.term) == ("factor", "added") and abs(cause.value) < 0.02
    edit(folder / "captures.yaml", lambda capture: capture["captures"][0].pop("injection"))
    rewrite(folder / "sine-1.csv", _dithered)
    cause = check_command(load([folder])).cause
    assert cause is not None and cause.kind == "none"


def test_corners_of_the_reference_are_harmless(tmp_path: Path) -> None:
    """Where the acceleration jumps, the samples do not hold what the controller knew: half an ampere at some rows."""
    check = check_command(load([exported(recorded(tmp_path / "own", TRAPEZOID, 1), tmp_path / "out", setpoints=False)]))
    assert check.agrees and check.worst < 1e-5
    assert check.harmless == {"corner"}


def _gap(columns: Columns) -> Columns:
    rows = np.r_[0:1000, 1020 : len(columns["time_s"])]
    return {name: column[rows] for name, column in columns.items()}


def test_gaps_are_passed_over(folder: Path) -> None:
    rewrite(folder / "sine-1.csv", _gap)
    check = check_command(load([folder]))
    assert check.agrees and check.harmless == {"gap"}


def _wound_otherwise(columns: Columns) -> Columns:
    """Behind a limit of 3 A, out of which the integrator comes with 50 mA less than it went in with, each time."""
    command = columns["current_command_A"]
    at = np.abs(command) >= 3.0
    taken = 0.05 * np.cumsum(np.diff(at.astype(float), prepend=0.0) < 0.0)
    columns["current_command_A"] = np.clip(np.where(at, command, command - taken), -3.0, 3.0)
    return columns


@pytest.mark.parametrize(("gain", "agrees"), [(1.0, True), (1.05, False)])
def test_what_the_integrator_does_at_the_limit_is_taken_from_the_log(folder: Path, gain: float, agrees: bool) -> None:
    """A wrong gain differs away from the limit as well."""
    rewrite(folder / "sine-1.csv", _wound_otherwise)
    check = controller(folder, lambda c: {"command_limit_A": 3.0, "Kd": c["Kd"] * gain})
    assert check.agrees is agrees and ("limit" in check.harmless) is agrees


def test_a_command_in_steps_agrees_within_one(folder: Path) -> None:
    def stepped(columns: Columns) -> Columns:
        columns["current_command_A"] = 0.004 * np.rint(columns["current_command_A"] / 0.004)
        return columns

    rewrite(folder / "sine-1.csv", stepped)
    check = check_command(load([folder]))
    assert check.agrees and check.limit == pytest.approx(0.004, rel=1e-3) and 0.0015 < check.worst < 0.0025


def test_resolution() -> None:
    random = np.random.default_rng(3).normal(size=20_000)
    assert resolution(random) < 1e-6
    assert resolution(0.004 * np.rint(random / 0.004)) == pytest.approx(0.004)
    assert resolution(np.zeros(10)) == 0.0


@pytest.mark.parametrize(("column", "missing"), [("current_command_A", "command"), ("reference_rad", "reference")])
def test_what_is_missing_is_not_checked(folder: Path, column: str, missing: str) -> None:
    rewrite(folder / "sine-1.csv", lambda columns: {n: v for n, v in columns.items() if n != column})
    check = check_command(load([folder]))
    assert not check.checked and check.agrees and check.missing == missing


def test_without_a_controller_nothing_is_checked(folder: Path) -> None:
    edit(folder / "nominal.yaml", lambda nominal: nominal.pop("controller"))
    check = check_command(load([folder]))
    assert not check.checked and check.agrees and check.missing == "controller"


def test_a_constant_may_be_in_the_integrator(folder: Path) -> None:
    """A record that begins at rest while the controller runs: harmless, with a note."""
    rewrite(folder / "sine-1.csv", _biased)
    check = check_command(load([folder]))
    assert check.agrees and check.harmless == {"beginning"} and "0.125 A" in check.words


DAHL = "  law: dahl\n  coulomb: 1 N m\n  range: 10 um\n"
FORM = "compensation:\n  form: displacement\n  velocity: 5 rad/s\n  slip: 0.01 rad\n  static: 1 N m\n"
FORM += "  positive: 0.9 N m\n  negative: 0.8 N m\n\n"
TABLE = "compensation:\n  form: table\n  displacement: [0 um, 2 um, 20 um]\n  force: [-1 N m, 0 N m, 1 N m]\n\n"
GMS = "compensation:\n  form: gms\n  weight: [0.4 N m, 0.6 N m]\n  slip: [1 um, 5 um]\n"
GMS += "  stribeck: {rise: 0.2, velocity: 5 rad/s}\n\n"
RHEOLOGY = "compensation: {form: rheology, coulomb: 1 N m, range: 15 um, exponent: 3}\n\n"  # steep below 2


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
    [
        {"layers": "ptc, friction, observer"},
        {"friction": DAHL},
        *({"before": form} for form in (FORM, TABLE, GMS, RHEOLOGY)),
    ],
    ids=["observer", "Dahl's compensation", "a compensation of its own form", "table", "gms", "rheology"],
)
def test_every_part_of_our_controllers_survives(tmp_path: Path, changes: dict[str, str]) -> None:
    """Written to nominal.yaml and read back: the commands agree to 1e-5 A."""
    (tmp_path / "stage.yaml").write_text(_with((CONFIG / "ball-screw.yaml").read_text(), **changes))
    folder = exported(recorded(tmp_path / "own", SINE, 1, tmp_path / "stage.yaml"), tmp_path / "out", setpoints=False)
    check = check_command(load([folder]))
    assert check.agrees and check.worst < 1e-5, check.words


def test_a_cascade_survives_and_agrees(tmp_path: Path) -> None:
    folder = exported(recorded(tmp_path / "own", SINE, 1, "linear-slider"), tmp_path / "out", setpoints=False)
    session = load([folder])
    check = check_command(session)
    assert session.law is not None and session.law.cascaded
    assert check.agrees and check.worst < 1e-5


@pytest.mark.parametrize("kind", DIFFERENCES)
def test_a_velocity_of_differences_is_named_and_can_be_described(tmp_path: Path, kind: str) -> None:
    """A drive takes the velocity of the reference from its values: half a period early or late, or by both rows."""
    folder = exported(recorded(tmp_path / "own", SINE, 1, "linear-slider"), tmp_path / "out", setpoints=False)
    session = load([folder])
    (log,) = session.logs
    assert session.law is not None and log.setpoints is not None
    terms = recomputed(session.law, differenced(log.setpoints, kind, session.dt), log.position)
    command = terms[:, OUTPUT_COLUMNS["command"]]
    rewrite(next(folder.glob("*.csv")), lambda columns: {**columns, "current_command_A": command})
    check = check_command(load([folder]))
    assert not check.agrees and check.cause is not None
    assert check.cause.kind == "reference_velocity" and kind in check.cause.words
    assert controller(folder, lambda _: {"reference_velocity": kind}).agrees


@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS record is not next to this repository (../shared/data/emps)")
def test_the_benchmark_is_separated_from_a_wrong_controller() -> None:
    """0.0037 V rms are left, half a count of the position times kv: rounding, not another law."""
    session = load([EMPS], load_stage(CONFIG / "emps.yaml"))
    check = check_command(session)
    assert check.agrees and check.limit == pytest.approx(243.45 * (160.18 + 2.0 / 1e-3) * 5e-8)  # one count
    assert check.worst == pytest.approx(243.45 * 5e-8 / 1e-3, rel=0.02)  # one count
    assert session.law is not None
    slower = session.law._replace(cascade=session.law.cascade._replace(position=0.98 * 160.18))
    assert not check_command(session._replace(law=slower)).agrees
