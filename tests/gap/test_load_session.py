"""A session is what was recorded, by whichever way it came; what is missing or wrong is reported."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.config.stage_file import load_stage
from stagectl.gap.logs.load_session import load
from stagectl.gap.logs.session import GapError, LogError, NominalValueError
from stagectl.gap.logs.sources import Description
from stagectl.gap.validation import rollouts
from stagectl.problem import ProblemKind
from stagectl.recording.exports import write_csv
from stagectl.recording.guess.importing import import_log
from stagectl.recording.hdf5 import RecordingError, open_recording
from stagectl.recording.imports import store
from stagectl.recording.scales import Known
from tests.gap.captured import CONFIG, SINE, TRAPEZOID, Columns, edit, exported, recorded, rewrite
from tests.identification import synthetic
from tests.problems import refused

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
    not_given = ["nominal.yaml does not give stage.pitch (6.28319 m): the values in brackets are taken"]
    assert list(again.notes) == (not_given if stage == "linear-slider" else [])


def test_setpoints_by_the_reference_alone(recordings: list[Path], original: Path) -> None:
    """Within 1e-5 A and 1e-9 rad of those that the controller had, as the description promises."""
    own, again = load(recordings), load([original])
    for log, other in zip(own.logs, again.logs, strict=True):
        assert log.setpoints is not None and other.setpoints is not None
        apart = np.abs(log.setpoints - other.setpoints).max(axis=0)
        assert apart[0] < 1e-12 and apart[1] < 1e-9 and apart[2] < 1e-5 and apart[3] < 1e-5
        assert np.abs(log.setpoints[:, 2]).max() > 0.3 and np.abs(log.setpoints[:, 3]).max() > 1.0


def test_a_folder_of_recordings_is_the_recordings(recordings: list[Path]) -> None:
    session = load([recordings[0].parent])
    assert [log.name for log in session.logs] == ["sine-1.h5", "sine-2.h5"]
    assert [(log.experiment, log.repeat, log.held_out) for log in session.logs] == [
        ("sine", 1, False),
        ("sine", 2, False),
    ]


def test_injection_use_and_clock_survive(folder: Path) -> None:
    def change(capture: dict[str, Any]) -> None:
        capture["captures"][0] |= {"injection": "dither.csv", "start_s": 30.0, "experiment": "dithered"}
        capture["captures"][1] |= {"use": "held-out", "repeat": 7}

    rows = len((folder / "sine-1.csv").read_text().splitlines()) - 1
    (folder / "dither.csv").write_text("injection_mA\n" + "".join(f"{k % 7}\n" for k in range(rows)))
    edit(folder / "captures.yaml", change)
    first, second = load([folder]).logs
    assert (first.start, first.experiment, first.held_out) == (30.0, "dithered", False)
    assert (second.held_out, second.repeat, second.injection) == (True, 7, None)
    assert first.injection is not None and first.setpoints is not None
    np.testing.assert_allclose(first.injection, 1e-3 * (np.arange(rows) % 7), rtol=1e-12)
    np.testing.assert_array_equal(first.setpoints[:, 6], first.injection)


def test_a_whole_export_as_csv_holds_its_setpoints(recordings: list[Path], tmp_path: Path) -> None:
    """With the stage beside it, but no controller; the control period is then that of its rows."""
    write_csv(open_recording(recordings[0]), tmp_path / "log.csv")
    session, own = load([tmp_path / "log.csv"], load_stage(CONFIG / "ball-screw.yaml")), load(recordings[:1])
    assert session.law is None and session.dt == pytest.approx(own.dt)
    np.testing.assert_array_equal(session.logs[0].setpoints, own.logs[0].setpoints)


def test_anti_windup_none_clamps_nothing(folder: Path) -> None:
    edit(
        folder / "nominal.yaml", lambda capture: capture["controller"].update(anti_windup="none", command_limit_A=None)
    )
    session = load([folder])
    assert session.law is not None and session.law.current_limit == math.inf
    assert session.stage.drive.current_limit == load_stage(CONFIG / "ball-screw.yaml").stage.drive.current_limit


def test_a_foreign_model_with_defaults_in_the_notes(tmp_path: Path) -> None:
    (tmp_path / "nominal.yaml").write_text(NOMINAL)
    rows = "".join(f"{1e-3 * k:.4f},{1e-3 * math.sin(0.01 * k):.9f}\n" for k in range(500))
    (tmp_path / "log.csv").write_text("time_s,position_m\n" + rows)
    session = load([tmp_path / "log.csv"])
    assert session.stage.friction.bristle[:3] == (4.0, 1e5, 1.0)
    assert session.stage.drive[1:4] == (2, math.inf, 2e-4)
    assert session.stage.mechanics[:3] == (3.0, 0.0, 0.0)
    assert session.law is None and session.dt == pytest.approx(1e-3)
    notes = " ".join(session.notes)
    defaults = ("viscous (0 N s/m)", "bias (0 N)", "pitch (6.28319 m)")
    for default in (*(f"stage.{each}" for each in defaults), "drive.current_limit_A (no limit)"):
        assert default in notes
    assert len(session.cannot_tell) == 8
    missing = ("current", "command", "reference", "force", "controller", "once", "held-out", "start_s")
    for token, sentence in zip(missing, session.cannot_tell, strict=True):
        assert token in sentence
    with pytest.raises(GapError, match="controller"):
        rollouts.simulated_log(session, session.stage, session.logs[0])


@pytest.mark.parametrize(
    ("block", "key", "value", "rule"),
    [
        ("stage", "inertia", -0.01, "(0, 1e6] kg m^2"),
        ("stage", "force_constant", None, "(0, "),
        ("stage", "torque_unit", "kgcm", "Nm"),
        ("drive", "delay_samples", 1.5, "whole"),
        ("drive", "current_limit_A", "much", " A"),
        ("friction", "law", "magic", "stop-operator"),
        ("friction", "slip", [1e-3], "1 entries"),
        ("friction", "coulomb", 99.0, "sum"),
        ("friction", "viscous", 99.0, "stage.viscous"),
        ("controller", "Ki", math.inf, "[-1e15, 1e15]"),
        ("controller", "discretisation", "zoh", "tustin"),
        ("controller", "frame_samples", 3, "2"),
        ("controller", "anti_windup", "clever", "none, conditional"),
        ("controller", "derivative_pole", 0.0, "(0, 1e9] rad/s"),
    ],
)
def test_values_that_cannot_be(folder: Path, block: str, key: str, value: Any, rule: str) -> None:
    edit(folder / "nominal.yaml", lambda nominal: nominal[block].update({key: value}))
    with pytest.raises(NominalValueError) as caught:
        load([folder])
    error = caught.value
    assert (error.place, error.key, error.value) == (folder / "nominal.yaml", f"{block}.{key}", value)
    assert rule in error.rule


def test_the_viscous_friction_may_stand_with_the_friction(folder: Path) -> None:
    viscous = load([folder]).stage.mechanics.viscous

    def moved(nominal: dict[str, Any]) -> None:
        nominal["friction"]["viscous"] = nominal["stage"].pop("viscous")

    edit(folder / "nominal.yaml", moved)
    session = load([folder])
    assert session.stage.mechanics.viscous == viscous > 0.0 and "viscous" not in " ".join(session.notes)


@pytest.mark.parametrize(
    ("block", "key", "meant"),
    [("stage", "pich", "pitch"), ("", "contoller", "controller"), ("friction.stribeck", "velocty", "velocity")],
)
def test_a_misspelt_key_is_noted_with_the_nearest_one(folder: Path, block: str, key: str, meant: str) -> None:
    def misspelt(nominal: dict[str, Any]) -> None:
        nominal["friction"]["stribeck"] = {"rise": 0.1, "velocity": 1.0}
        place = nominal
        for name in filter(None, block.split(".")):
            place = place[name]
        place[key] = 6.28

    edit(folder / "nominal.yaml", misspelt)
    notes = load([folder]).notes
    assert [note for note in notes if key in note and note.endswith(f"{meant}?")]


def test_a_misspelt_key_of_an_entry_is_noted(folder: Path) -> None:
    edit(folder / "captures.yaml", lambda capture: capture["captures"][0].update(strat_s=3.0))
    assert any("strat_s" in note and "start_s?" in note for note in load([folder]).notes)


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
    ("change", "rows", "token"),
    [
        (_lost, slice(700, 900), "0.35 s"),
        (_frozen, slice(1001, 2000), "position"),
        (_switched_off, slice(1500, 2000), "current"),
        (_empty, slice(800, 810), "current"),
        (_beyond, slice(600, 620), "limit"),
    ],
)
def test_rows_that_must_not_count(folder: Path, change: Callable[[Columns], Columns], rows: slice, token: str) -> None:
    whole = load([folder]).logs[0]
    rewrite(folder / "sine-1.csv", change)
    session = load([folder])
    log = session.logs[0]
    assert any(note.startswith("sine-1.csv: ") and token in note for note in session.notes), session.notes
    assert not log.valid[rows].any() and log.valid[:500].all() and session.logs[1].valid.all()
    assert log.rows == whole.rows and np.all(np.isfinite(log.position)) and log.exact
    assert log.setpoints is not None and whole.setpoints is not None  # a repeat knows the reference in a gap
    np.testing.assert_allclose(log.setpoints, whole.setpoints, atol=1e-9)


def test_instants_of_their_own_are_resampled(folder: Path) -> None:
    """A motion of 2.6 rad, its stamps off by up to 0.2 periods of 26 rad/s: the spline gives it back to 1e-9 rad."""

    def scattered(columns: Columns) -> Columns:
        time = columns["time_s"]
        moved = time + 1e-4 * np.sin(np.arange(len(time)) * 1.7)
        return columns | {"time_s": moved, "reference_rad": _sine(moved), "position_rad": _sine(moved)}

    rewrite(folder / "sine-1.csv", scattered)
    edit(folder / "captures.yaml", lambda capture: capture["captures"].pop())
    session = load([folder])
    log = session.logs[0]
    assert not log.exact and "70.7 µs" in " ".join(session.notes)
    grid = session.dt * np.arange(log.rows, dtype=np.float64)
    np.testing.assert_allclose(log.position[10:-10], _sine(grid)[10:-10], rtol=0.0, atol=1e-9)


def _sine(time: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(2.6 * np.sin(10.0 * time), dtype=np.float64)


def test_another_rate_is_resampled(folder: Path) -> None:
    rewrite(folder / "sine-1.csv", lambda columns: {name: column[::2] for name, column in columns.items()})
    session = load([folder])
    assert [log.exact for log in session.logs] == [False, True]
    assert any("1 ms" in note and "0.5 ms" in note for note in session.notes)
    assert session.logs[0].rows == session.logs[1].rows


def _shorter(folder: Path) -> None:
    rewrite(folder / "sine-2.csv", lambda columns: {name: column[:-100] for name, column in columns.items()})


def test_repeats_are_cut_to_one_length(folder: Path) -> None:
    whole = load([folder]).logs[0].rows
    _shorter(folder)
    session = load([folder])
    assert [log.rows for log in session.logs] == [whole - 100] * 2
    assert any(f"{whole - 100} to {whole}" in note for note in session.notes)
    rewrite(folder / "sine-2.csv", lambda columns: {name: column[:800] for name, column in columns.items()})
    session = load([folder])
    assert [log.name for log in session.logs] == ["sine-1.csv"] and session.logs[0].rows == whole
    assert any("sine-2.csv" in note and "800 rows" in note for note in session.notes)


@pytest.mark.parametrize(
    ("change", "reason", "logs"),
    [
        (lambda c: c | {"reference_rad": 1.01 * c["reference_rad"]}, "signal", ("sine-2.csv", "sine-1.csv")),
        (lambda c: {n: v[:50] for n, v in c.items()}, "short", ("sine-2.csv",)),
    ],
)
def test_repeats_that_are_none(
    folder: Path, change: Callable[[Columns], Columns], reason: str, logs: tuple[str, ...]
) -> None:
    rewrite(folder / "sine-2.csv", change)
    with pytest.raises(LogError) as caught:
        load([folder])
    assert (caught.value.reason, caught.value.logs) == (reason, logs)


@pytest.mark.parametrize(
    ("key", "value", "reason", "log"),
    [
        ("use", "test", "entry", "sine-1.csv"),
        ("start_s", "noon", "entry", "sine-1.csv"),
        ("file", "sine-2.csv", "duplicate", "sine-2.csv"),
    ],
)
def test_entries_that_cannot_be(folder: Path, key: str, value: str, reason: str, log: str) -> None:
    edit(folder / "captures.yaml", lambda capture: capture["captures"][0].update({key: value}))
    with pytest.raises(LogError) as caught:
        load([folder])
    assert (caught.value.reason, caught.value.logs) == (reason, (log,)) and repr(value).strip("'") in str(caught.value)


def test_logs_that_do_not_belong_together(folder: Path, recordings: list[Path], tmp_path: Path) -> None:
    own = recordings[0]
    (other,) = recorded(tmp_path / "other", SINE, 1, "linear-slider")
    slider = other.rename(other.with_name("slider.h5"))
    for paths, stage, reason, logs in (
        ([folder, own], None, "mixed", (own.name, "sine-1.csv")),
        ([own], load_stage(CONFIG / "linear-slider.yaml"), "axis", (own.name,)),
        ([own, slider], None, "machine", (slider.name, own.name)),
    ):
        with pytest.raises(LogError) as caught:
            load(paths, stage)
        assert (caught.value.reason, caught.value.logs) == (reason, logs)


def test_a_log_is_read_as_import_reads_it(tmp_path: Path) -> None:
    """Headers of a drive's scope; a folder of such logs, too, but not one without any log."""
    header = "Time [s],Actual position [rad],Iq [A]"
    log = synthetic.write_csv(tmp_path / "scope.csv", synthetic.motion(), header)
    for given in (log, tmp_path):
        session = load([given], load_stage(CONFIG / "ball-screw.yaml"))
        assert session.logs[0].current is not None and len(session.logs) == 1
        assert any("current is taken from 3" in note for note in session.notes)
    (tmp_path / "nothing").mkdir()
    with refused(RecordingError, kind=ProblemKind.MISSING):
        load([tmp_path / "nothing"])


def test_logs_of_one_machine_may_have_any_names(tmp_path: Path) -> None:
    """Guessed logs, which are named by their files; the same as recordings, and in a folder of captures."""
    setup, names = load_stage(CONFIG / "ball-screw.yaml"), ("a", "b")
    header = "Time [s],Actual position [rad],Iq [A]"
    logs = [synthetic.write_csv(tmp_path / f"{name}.csv", synthetic.motion(), header) for name in names]
    imported = [import_log(log, setup, None, Known(), unsure=False)[0].recording for log in logs]
    ours = [store([recording], log, log.with_suffix(".h5"))[0] for recording, log in zip(imported, logs, strict=True)]
    for given in (logs, ours):
        assert len(load(given, setup).logs) == 2
    assert len(load([exported(ours, tmp_path / "out")], setup).logs) == 2


OWN = {"time_s": "t [s]", "reference_rad": "x_soll [rad]", "position_rad": "x_act [rad]", "current_A": "Iq [A]"}
WORDS = {"time": "t [s]", "reference": "x_soll [rad]", "position": "x_act [rad]", "current": "Iq [A]"}


@pytest.mark.parametrize("words", [None, WORDS])
def test_a_folder_of_captures_may_have_headers_of_its_own(folder: Path, words: dict[str, str] | None) -> None:
    """They are guessed as those of a lone log are, or named; what the two YAML files say holds all the same."""
    known = load([folder])
    for name in ("sine-1.csv", "sine-2.csv"):
        rewrite(folder / name, lambda columns: {OWN.get(column, column): values for column, values in columns.items()})
    session = load([folder], said=Description(words))
    assert session.law == known.law and [log.experiment for log in session.logs] == ["sine", "sine"]
    for log, same in zip(session.logs, known.logs, strict=True):
        assert log.reference is not None and same.reference is not None and log.current is not None
        np.testing.assert_array_equal(log.position, same.position)
        np.testing.assert_array_equal(log.reference, same.reference)
        np.testing.assert_array_equal(log.current, same.current)
    assert any("position is taken from" in note for note in session.notes) == (words is None)


@pytest.mark.parametrize("words", [None, {"time": "time_s", "position": "position_rad"}])
def test_a_folder_of_another_kind_of_axis_is_refused(folder: Path, words: dict[str, str] | None) -> None:
    setup, beside = load_stage(CONFIG / "ball-screw.yaml"), folder / "nominal.yaml"
    assert load([folder], setup, Description(words)).kind == "rotary"
    edit(beside, lambda nominal: nominal["stage"].update(kind="linear", position_unit="m"))
    with refused(RecordingError, kind=ProblemKind.CONFLICT, file=beside):
        load([folder], setup, Description(words))


def test_layers_may_differ_between_recordings(recordings: list[Path], tmp_path: Path) -> None:
    """The law is the same; each recording has its own feedforward."""
    (bare,) = recorded(tmp_path, SINE, 1, without=frozenset({"ptc", "friction"}))
    session = load([recordings[0], bare.rename(bare.with_name("bare.h5"))])
    assert session.logs[1].setpoints is not None and not session.logs[1].setpoints[:, 2:4].any()


@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS record is not next to this repository (../shared/data/emps)")
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


def _thinned(path: Path, source: Path, every: int, *left_out: str) -> Path:
    """Every so many rows of a recording as another program would log them, without some of its columns."""
    samples = open_recording(source).samples[::every]
    columns = {"position_rad": "measured", "command_A": "command", "current_A": "measured_current"}
    kept = {name: samples[ours] for name, ours in columns.items() if name not in left_out}
    rows = np.column_stack([5e-4 * every * np.arange(len(samples)), *kept.values()])
    np.savetxt(path, rows, delimiter=",", header=",".join(["time_s", *kept]), comments="")
    return path


def test_a_log_slower_than_the_loop_says_nothing_of_the_drive(recordings: list[Path], tmp_path: Path) -> None:
    """Between its rows lie commands that it does not hold: what moves the axis is the measured current."""
    setup = load_stage(CONFIG / "ball-screw.yaml")
    slow, fast = (load([_thinned(tmp_path / f"{k}.csv", recordings[0], k)], setup) for k in (4, 1))
    (log,), (whole,) = slow.logs, fast.logs
    assert (log.held, log.commanded, whole.held, whole.commanded) == (False, False, True, True)
    assert log.command is not None and log.current is not None
    np.testing.assert_allclose(log.driving[:-1], 0.5 * (log.current[1:] + log.current[:-1]))
    assert slow.stage.drive[:4] == (0.0, 0, math.inf, 0.0) and fast.stage.drive == setup.stage.drive
    assert len(slow.cannot_tell) == len(fast.cannot_tell) + 1 and "control.period" in slow.cannot_tell[0]


def test_a_delay_counts_control_periods_whatever_the_log(recordings: list[Path], tmp_path: Path) -> None:
    setup = load_stage(CONFIG / "ball-screw.yaml")
    late = setup.stage.drive.delay_samples * setup.dt
    drive = load([_thinned(tmp_path / "slow.csv", recordings[0], 4, "current_A")], setup).stage.drive
    assert (drive.delay_samples, drive.dead_time) == (0, pytest.approx(late)) and late < 2e-3


@pytest.mark.parametrize(("second", "starts"), [(25.0, [0.0, 25.0]), (0.0, [0.0, 0.0]), (0.1, [0.0, 0.0])])
def test_logs_that_follow_each_other_are_of_one_clock(
    recordings: list[Path], tmp_path: Path, second: float, starts: list[float]
) -> None:
    """Time stamps that go on from log to log tell when each was recorded; those that overlap tell nothing."""
    paths = [_thinned(tmp_path / f"{name}.csv", recordings[0], 1) for name in ("a", "b")]
    rows = np.loadtxt(paths[1], delimiter=",", skiprows=1)
    rows[:, 0] += second
    np.savetxt(paths[1], rows, delimiter=",", header="time_s,position_rad,command_A,current_A", comments="")
    session = load(paths, load_stage(CONFIG / "ball-screw.yaml"))
    assert [log.start for log in session.logs] == pytest.approx(starts)
    assert any("session clock" in sentence for sentence in session.cannot_tell) == (starts[1] == 0.0)
