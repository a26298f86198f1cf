"""The captures: repeatable, of the stated ranges, true to their definitions, and independent of stagectl."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from tests.foreign_plants import capture_cases, friction, motions, oracle
from tests.foreign_plants.nominal import nominal

HERE = Path(__file__).parent
SOURCES = [path for path in HERE.glob("*.py") if not path.name.startswith("test_")]


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.name)
def test_the_machine_shares_nothing(path: Path) -> None:
    allowed = {"numpy", "numba", "scipy", "yaml", *sys.stdlib_module_names}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        assert all(name.split(".")[0] in allowed or name.startswith("tests.foreign_plants") for name in names)


def test_the_nominal_axis_is_that_of_the_stage_file(ball_screw: Setup) -> None:
    axis, stage = nominal(), ball_screw.stage
    assert (axis.inertia, axis.viscous) == (stage.mechanics.inertia, stage.mechanics.viscous)
    assert (axis.coulomb, axis.rolling_zone) == (pytest.approx(1.0), pytest.approx(9e-6 * 2.0 * np.pi / 0.012))
    assert (axis.speed, axis.travel) == (pytest.approx(50.0 * np.pi), pytest.approx(0.05 * 2.0 * np.pi / 0.012))


def test_any_range_of_seeds_has_all_conditions() -> None:
    settings = [capture_cases.setting_of(seed) for seed in range(240)]
    pairs = {(setting.law, setting.motion) for setting in settings[48:72]}
    assert pairs == {(law, motion) for law in friction.LAWS for motion in motions.MOTIONS}
    assert {setting.counts for setting in settings} == {2**20, 20_000, 4_096}
    assert {(setting.duration, setting.row) for setting in settings} == {
        *((10.0, row) for row in (0.5e-3, 1e-3, 5e-3, 10e-3)),
        *((1.0, row) for row in (0.5e-3, 1e-3)),
    }
    assert 0.4 < np.mean([setting.column == "measured" for setting in settings]) < 0.6


def test_machines_are_within_their_stated_ranges() -> None:
    axis = nominal()
    for seed in range(200):
        setting = capture_cases.setting_of(seed)
        plant = capture_cases.plant_of(np.random.default_rng(seed), setting)
        drive, period = plant.drive, plant.controller.period
        assert abs(plant.mechanics.inertia / axis.inertia - 1.0) <= 0.15
        assert plant.friction.shares.sum() == pytest.approx(1.0)
        if setting.column == "command":
            late = capture_cases.command_delay(drive, period)
        else:
            late = capture_cases.current_delay(drive, period)
        assert 0.0 <= late + plant.encoder.age <= capture_cases.LONGEST_DELAY + 0.3e-3


def _short(law: str, seed: int) -> capture_cases.Setting:
    return capture_cases.setting_of(seed, law)._replace(duration=1.0, row=0.5e-3, lead_in=0.3, motion="chirp")


def _even(setting: capture_cases.Setting) -> capture_cases.Capture:
    """Without ripple and cogging, which no oracle knows."""
    plant = capture_cases.plant_of(np.random.default_rng(setting.seed), setting)
    mechanics = plant.mechanics._replace(ripple=0.0, cogging=0.0)
    return capture_cases.moved(setting, plant._replace(mechanics=mechanics))


def test_a_seed_gives_one_log(tmp_path: Path) -> None:
    logs = []
    for name in ("a.csv", "b.csv"):
        capture = capture_cases.capture_of(_short("dahl", 5)._replace(column="measured", reference=True))
        capture_cases.write(tmp_path / name, capture.columns)
        logs.append((tmp_path / name).read_text())
    assert logs[0] == logs[1]
    assert logs[0].splitlines()[0] == "time_s,position_rad,current_command_A,reference_rad,current_A"
    assert len(logs[0].splitlines()) == 2001


@pytest.mark.parametrize("law", friction.LAWS)
def test_the_oracle_holds_the_truth(law: str) -> None:
    """Within four standard deviations where no ripple bends it, and knowing less never narrows an interval."""
    for seed in (11, 12, 13):
        capture = _even(_short(law, seed))
        told, truth = oracle.oracle(capture), capture.truth._asdict()
        for name in oracle.PARAMETERS:
            assert abs(told.estimates[name] - truth[name]) < 2.0 * told.shape_known[name]
            assert told.law_known[name] >= told.shape_known[name] > 0.0


@pytest.mark.parametrize("column", ["command", "measured"])
@pytest.mark.parametrize(("row", "seed"), [(0.5e-3, 31), (0.5e-3, 32), (1e-3, 33), (5e-3, 34)])
def test_the_delay_is_what_the_log_shows(column: str, row: float, seed: int) -> None:
    """The definition of the package, from the log alone: within 8 us, or four standard deviations where it is noisy."""
    setting = _short("dahl", seed)._replace(column=column, row=row, counts=2**20, noise=0.01, duration=2.0)
    capture = _even(setting)
    shown = oracle.oracle(capture)
    off = shown.estimates["delay"] - capture.truth.delay
    assert abs(off) < max(2.0 * shown.law_known["delay"], 8e-6)
    assert shown.law_known["delay"] < 0.05 * row
