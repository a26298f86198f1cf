"""A session is what was recorded, whichever way it came; what is missing or wrong is said with its reason."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.config.stage_file import load_stage
from stagectl.gap.logs.load_session import load
from stagectl.gap.logs.nominal_model import trusted
from stagectl.gap.logs.session import GapError
from stagectl.gap.validation import rollouts
from tests.gap.captured import CONFIG, SINE, TRAPEZOID, Columns, edit, exported, recorded, rewrite

EMPS = Path(__file__).resolve().parents[3] / "shared" / "data" / "emps" / "DATA_EMPS.mat"
NOMINAL = """
stage: {kind: linear, position_unit: m, torque_unit: N, force_constant: 2.0, inertia: 3.0, encoder_step: 1e-8,
        accuracy: "inertia may be off by 10 percent; the force constant is meant to be right"}
friction: {law: dahl, coulomb: 4.0, stiffness: 1e5}
drive: {current_loop_s: 0.0002, delay_samples: 2, current_limit_A: null}
"""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return recorded(tmp_path_factory.mktemp("own"), SINE)


@pytest.fixture(scope="module")
def original(recordings: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported(recordings, tmp_path_factory.mktemp("folder") / "a", setpoints=False)


@pytest.fixture
def folder(original: Path, tmp_path: Path) -> Path:
    shutil.copytree(original, tmp_path / "copy")
    return tmp_path / "copy"


@pytest.mark.parametrize(("text", "stage"), [(SINE, "ball-screw"), (TRAPEZOID, "ball-screw"), (SINE, "linear-slider")])
def test_our_recordings_survive_the_folder(tmp_path: Path, text: str, stage: str) -> None:
    """The loop simulated again from recordings, and from the folder alone, is what was recorded (1e-9 rad | m)."""
    paths = recorded(tmp_path / "own", text, 1, stage)
    substeps = load_stage(CONFIG / f"{stage}.yaml").file.simulation.substeps
    own, again = load(paths), load([exported(paths, tmp_path / "out")])
    for session in (own, again):
        (log,) = session.logs
        assert log.command is not None
        rows = rollouts.simulated_log(session, session.stage, log, substeps)
        np.testing.assert_allclose(rollouts.column(rows, "measured"), log.position, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(rollouts.column(rows, "command"), log.command, rtol=0.0, atol=1e-9)
        assert log.valid.all() and log.exact
    np.testing.assert_array_equal(own.logs[0].setpoints, again.logs[0].setpoints)
    assert own.stage.mechanics == again.stage.mechanics and own.stage.drive == again.stage.drive
    assert again.notes == ()


def test_setpoints_by_the_reference_alone(recordings: list[Path], original: Path) -> None:
    """1e-5 A and 1e-9 rad beside those that the controller had, as the description promises."""
    own, again = load(recordings), load([original])
    for one, other in zip(own.logs, again.logs, strict=True):
        assert one.setpoints is not None and other.setpoints is not None
        apart = np.abs(one.setpoints - other.setpoints).max(axis=0)
        assert apart[0] < 1e-12 and apart[1] < 1e-9 and apart[2] < 1e-5 and apart[3] < 1e-5
        assert np.abs(one.setpoints[:, 2]).max() > 0.3 and np.abs(one.setpoints[:, 3]).max() > 1.0


def test_a_folder_of_recordings_is_the_recordings(recordings: list[Path]) -> None:
    session = load([recordings[0].parent])
    assert [log.name for log in session.logs] == ["sine-1.h5", "sine-2.h5"]
    assert [(log.experiment, log.repeat, log.held_out) for log in session.logs] == [
        ("sine", 1, False),
        ("sine", 2, False),
    ]


def test_injection_use_and_clock_survive(folder: Path) -> None:
    def change(found: dict[str, Any]) -> None:
        found["captures"][0] |= {"injection": "dither.csv", "start_s": 30.0, "experiment": "dithered"}
        found["captures"][1] |= {"use": "held-out", "repeat": 7}

    rows = len((folder / "sine-1.csv").read_text().splitlines()) - 1
    (folder / "dither.csv").write_text("injection_mA\n" + "".join(f"{k % 7}\n" for k in range(rows)))
    edit(folder / "captures.yaml", change)
    first, second = load([folder]).logs
    assert (first.start, first.experiment, first.held_out) == (30.0, "dithered", False)
    assert (second.held_out, second.repeat, second.injection) == (True, 7, None)
    assert first.injection is not None and first.setpoints is not None
    np.testing.assert_allclose(first.injection, 1e-3 * (np.arange(rows) % 7), rtol=1e-12)
    np.testing.assert_array_equal(first.setpoints[:, 6], first.injection)


def test_anti_windup_none_clamps_nothing(folder: Path) -> None:
    edit(folder / "nominal.yaml", lambda found: found["controller"].update(anti_windup="none", command_limit_A=None))
    session = load([folder])
    assert session.law is not None and session.law.current_limit == math.inf
    assert session.stage.drive.current_limit == load_stage(CONFIG / "ball-screw.yaml").stage.drive.current_limit


def test_a_foreign_model_with_defaults_that_are_said(tmp_path: Path) -> None:
    (tmp_path / "nominal.yaml").write_text(NOMINAL)
    rows = "".join(f"{1e-3 * k:.4f},{1e-3 * math.sin(0.01 * k):.9f}\n" for k in range(500))
    (tmp_path / "log.csv").write_text("time_s,position_m\n" + rows)
    session = load([tmp_path / "log.csv"])
    assert session.stage.friction.bristle[:3] == (4.0, 1e5, 1.0)
    assert session.stage.drive[1:4] == (2, math.inf, 2e-4)
    assert session.stage.mechanics[:3] == (3.0, 0.0, 0.0)
    assert session.trusted == {"force_constant"} and session.law is None and session.dt == pytest.approx(1e-3)
    said = " ".join(session.notes)
    for words in ("stage.viscous (0 N s/m)", "stage.bias (0 N)", "drive.current_limit_A (no limit)"):
        assert words in said
    told = " ".join(session.cannot_tell)
    for words in (
        "no measured current in log.csv",
        "no command in log.csv",
        "no reference in log.csv",
        "no force is known",
        "no deployed controller",
        "recorded once",
        "held-out",
        "start_s",
    ):
        assert words in told
    with pytest.raises(GapError, match="cannot be simulated in closed loop: the deployed controller is not known"):
        rollouts.simulated_log(session, session.stage, session.logs[0])


def test_what_the_owner_trusts() -> None:
    assert trusted("nominal values may be off by 10 to 15 percent; the force constant is meant to be right") == {
        "force_constant"
    }
    assert trusted("inertia and viscous friction are exact, but the force constant is not known") == {
        "inertia",
        "viscous",
    }
    assert trusted("how true they are of the machine is not known") == frozenset()


@pytest.mark.parametrize(
    ("block", "key", "value", "words"),
    [
        ("stage", "inertia", -0.01, r"nominal.yaml: stage.inertia = -0.01; must be a number in \(0, 1e6\] kg m\^2"),
        ("stage", "force_constant", None, "stage.force_constant is missing"),
        ("stage", "torque_unit", "kgcm", "stage.torque_unit = 'kgcm'; must be Nm"),
        ("drive", "delay_samples", 1.5, "drive.delay_samples = 1.5; must be a whole number"),
        ("drive", "current_limit_A", "much", "drive.current_limit_A = 'much'; must be a number"),
        ("friction", "law", "magic", "friction.law = 'magic'; must be .* one of stop-operator"),
        ("friction", "slip", [1e-3], r"friction.weight has \d+ entries, friction.slip has 1"),
        ("friction", "coulomb", 99.0, "friction.coulomb = 99.0; its weights sum up to"),
        ("controller", "Ki", math.inf, "controller.Ki = inf; must be a number"),
        ("controller", "discretisation", "zoh", "controller.discretisation = 'zoh'; must be .* tustin"),
        ("controller", "frame_samples", 3, "controller.frame_samples = 3; must be 2"),
        ("controller", "anti_windup", "clever", "controller.anti_windup = 'clever'; must be .* none, conditional"),
        (
            "controller",
            "derivative_pole",
            0.0,
            r"controller.derivative_pole = 0.0; must be a number in \(0, 1e9\] rad/s",
        ),
    ],
)
def test_values_that_cannot_be(folder: Path, block: str, key: str, value: Any, words: str) -> None:
    edit(folder / "nominal.yaml", lambda found: found[block].update({key: value}))
    with pytest.raises(GapError, match=words):
        load([folder])


def test_a_key_that_is_misspelt_is_said(folder: Path) -> None:
    edit(folder / "nominal.yaml", lambda found: found["stage"].update(pich=6.28))
    assert "stage.pich of nominal.yaml is not known and has no effect; did you mean pitch?" in load([folder]).notes


def _lost(columns: Columns) -> Columns:
    rows = np.r_[0:700, 900 : len(columns["time_s"])]
    return {name: column[rows] for name, column in columns.items()}


def _frozen(columns: Columns) -> Columns:
    columns["position_rad"][1000:] = columns["position_rad"][1000]
    return columns


def _switched_off(columns: Columns) -> Columns:
    columns["current_A"][1500:] = 0.0
    columns["current_command_A"][1500:] = 3.0
    return columns


def _empty(columns: Columns) -> Columns:
    columns["current_A"][800:810] = np.nan
    return columns


def _beyond(columns: Columns) -> Columns:
    columns["current_command_A"][600:620] = 40.0
    return columns


@pytest.mark.parametrize(
    ("change", "rows", "words"),
    [
        (_lost, slice(700, 900), "200 of .* rows are missing, up to 200 in a row, the first at 0.35 s"),
        (_frozen, slice(1001, 2000), "the position stays the same while the reference moves"),
        (_switched_off, slice(1500, 2000), "no current flows while the controller asks for it"),
        (_empty, slice(800, 810), "rows without current"),
        (_beyond, slice(600, 620), "the command exceeds the limit of"),
    ],
)
def test_rows_that_must_not_count(folder: Path, change: Callable[[Columns], Columns], rows: slice, words: str) -> None:
    whole = load([folder]).logs[0]
    rewrite(folder / "sine-1.csv", change)
    session = load([folder])
    log = session.logs[0]
    assert any(re.search(words, note) for note in session.notes), session.notes
    assert not log.valid[rows].any() and log.valid[:500].all() and session.logs[1].valid.all()
    assert log.rows == whole.rows and np.all(np.isfinite(log.position)) and log.exact
    assert log.setpoints is not None and whole.setpoints is not None  # a repeat knows what was asked for in a gap
    np.testing.assert_allclose(log.setpoints, whole.setpoints, atol=1e-9)


def test_instants_of_their_own_are_resampled(folder: Path) -> None:
    """A motion of 2.6 rad, its stamps off by up to 0.2 periods of 26 rad/s: the spline gives it back to 1e-9 rad."""

    def scattered(columns: Columns) -> Columns:
        time = columns["time_s"]
        moved = time + 1e-4 * np.sin(np.arange(len(time)) * 1.7)
        return columns | {"time_s": moved, "reference_rad": _sine(moved), "position_rad": _sine(moved)}

    rewrite(folder / "sine-1.csv", scattered)
    edit(folder / "captures.yaml", lambda found: found["captures"].pop())
    session = load([folder])
    log = session.logs[0]
    assert not log.exact and "time stamps scatter by 70.7 µs rms" in " ".join(session.notes)
    grid = session.dt * np.arange(log.rows, dtype=np.float64)
    np.testing.assert_allclose(log.position[10:-10], _sine(grid)[10:-10], rtol=0.0, atol=1e-9)


def _sine(time: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(2.6 * np.sin(10.0 * time), dtype=np.float64)


def test_another_rate_is_resampled(folder: Path) -> None:
    rewrite(folder / "sine-1.csv", lambda columns: {name: column[::2] for name, column in columns.items()})
    session = load([folder])
    assert [log.exact for log in session.logs] == [False, True]
    assert any("rows are 1 ms apart, the control period is 0.5 ms: resampled" in note for note in session.notes)
    assert session.logs[0].rows == session.logs[1].rows


def _shorter(folder: Path) -> None:
    rewrite(folder / "sine-2.csv", lambda columns: {name: column[:-100] for name, column in columns.items()})


def test_repeats_are_cut_to_one_length(folder: Path) -> None:
    whole = load([folder]).logs[0].rows
    _shorter(folder)
    session = load([folder])
    assert [log.rows for log in session.logs] == [whole - 100] * 2
    assert any("all are cut to" in note for note in session.notes)
    rewrite(folder / "sine-2.csv", lambda columns: {name: column[:800] for name, column in columns.items()})
    session = load([folder])
    assert [log.name for log in session.logs] == ["sine-1.csv"] and session.logs[0].rows == whole
    assert any("sine-2.csv is left out: it has 800 rows" in note for note in session.notes)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda c: c | {"reference_rad": 1.01 * c["reference_rad"]},
            "the reference of sine-2.csv differs from that of",
        ),
        (lambda c: {n: v[:50] for n, v in c.items()}, "sine-2.csv: 50 rows over"),
    ],
)
def test_repeats_that_are_none(folder: Path, change: Callable[[Columns], Columns], words: str) -> None:
    rewrite(folder / "sine-2.csv", change)
    with pytest.raises(GapError, match=words):
        load([folder])


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("use", "test", "use = 'test' in captures.yaml; must be diagnose or held-out"),
        ("start_s", "noon", "start_s = 'noon' in captures.yaml; must be a number"),
        ("file", "sine-2.csv", "sine-2.csv is there twice"),
    ],
)
def test_entries_that_cannot_be(folder: Path, key: str, value: str, words: str) -> None:
    edit(folder / "captures.yaml", lambda found: found["captures"][0].update({key: value}))
    with pytest.raises(GapError, match=words):
        load([folder])


def test_logs_that_do_not_belong_together(folder: Path, recordings: list[Path], tmp_path: Path) -> None:
    with pytest.raises(GapError, match=r"is a recording of ours, sine-1\.csv is not"):
        load([folder, recordings[0]])
    with pytest.raises(GapError, match=r"is of a rotary axis, .* is linear"):
        load([recordings[0]], load_stage(CONFIG / "linear-slider.yaml"))
    (other,) = recorded(tmp_path / "other", SINE, 1, "linear-slider")
    with pytest.raises(GapError, match="they are not of one machine in one state"):
        load([recordings[0], other.rename(other.with_name("slider.h5"))])
    (tmp_path / "nothing").mkdir()
    with pytest.raises(GapError, match=r"holds neither captures\.yaml nor recordings"):
        load([tmp_path / "nothing"])


def test_layers_may_differ_between_recordings(recordings: list[Path], tmp_path: Path) -> None:
    """The law is the same; what it knows beforehand is each recording's own."""
    (bare,) = recorded(tmp_path, SINE, 1, without=frozenset({"ptc", "friction"}))
    session = load([recordings[0], bare.rename(bare.with_name("bare.h5"))])
    assert session.logs[1].setpoints is not None and not session.logs[1].setpoints[:, 2:4].any()


@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS record is not beside this repository (../shared/data/emps)")
def test_the_benchmark_in_closed_loop() -> None:
    """Its published law and model leave 0.5 % of the tracking error's rms, and less than the published 0.0138 %."""
    session = load([EMPS], load_stage(CONFIG / "emps.yaml"))
    (log,) = session.logs
    assert session.law is not None and session.law.cascade[:2] == pytest.approx((160.18, 243.45))
    assert log.current is None and log.rows == 24841 and log.reference is not None
    rows = rollouts.simulated_log(session, session.stage, log)
    left = rollouts.column(rows, "measured") - log.position
    share = float(np.sqrt(np.mean(left**2) / np.mean((log.reference - log.position) ** 2)))
    assert 0.002 < share < 0.008
    relative = float(np.linalg.norm(left) / np.linalg.norm(log.position))
    assert 1e-6 < relative < 1.3752e-4
