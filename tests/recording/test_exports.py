"""Exports keep every bit, and a folder alone says how its commands came about."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pyarrow.parquet
import pytest
import yaml
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.io import loadmat
from scipy.linalg import expm

from stagectl.cli.records import SIMULATORS, Format
from stagectl.config.source import ConfigError
from stagectl.config.stage_file import load_stage
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.kernels.law import Setpoint
from stagectl.problem import ProblemKind
from stagectl.recording.exports import FORMATS, export
from stagectl.recording.hdf5 import Recording, RecordingError, open_recording, save
from stagectl.recording.imports import read
from stagectl.trajectories import Recorded, phases
from stagectl.units import StageError
from stagectl.workflows.motion import prepare
from stagectl.workflows.simulated_motion import pretend
from tests.problems import refused

Array = NDArray[Any]
CONFIG = Path(__file__).parents[2] / "config"
SINE = "type: sine\namplitude: 5 mm\nfrequency: 1.6 Hz\nperiods: 1\nramp: 0.5\n"


def recorded(folder: Path, name: str, stage: str = "ball-screw", without: frozenset[str] = frozenset()) -> Recording:
    trajectory = folder / f"{name}.yaml"
    trajectory.write_text(SINE)
    path = folder / f"{name}.h5"
    pretend(prepare(load_stage(CONFIG / f"{stage}.yaml"), trajectory, without, path))
    return open_recording(path)


@pytest.fixture(scope="module")
def sine(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return recorded(tmp_path_factory.mktemp("sine"), "sine")


def table(path: Path) -> dict[str, Array]:
    """A CSV file, read by the standard library."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def test_csv_keeps_every_bit_and_names_units(sine: Recording, tmp_path: Path) -> None:
    export([sine], "csv", tmp_path / "a.csv")
    columns = table(tmp_path / "a.csv")
    assert list(columns)[:2] == ["time_s", "reference_rad"]
    for header, name in (
        ("reference_rad", "reference"),
        ("target_rad", "target"),
        ("command_A", "command"),
        ("measured_rad", "measured"),
        ("late", "late"),
    ):
        np.testing.assert_array_equal(columns[header], sine.column(name))
    assert len(columns) == len(sine.samples.dtype.names or ())


def test_parquet_carries_units_and_meta(sine: Recording, tmp_path: Path) -> None:
    export([sine], "parquet", tmp_path / "a.parquet")
    columns = pyarrow.parquet.read_table(tmp_path / "a.parquet")
    for name in sine.samples.dtype.names or ():
        np.testing.assert_array_equal(columns[name].to_numpy(), sine.column(name))
    assert columns.schema.field("proportional").metadata[b"unit"] == b"A"
    assert json.loads(columns.schema.metadata[b"stagectl"])["law"] == sine.meta["law"]


def test_mat_is_a_struct_with_units(sine: Recording, tmp_path: Path) -> None:
    export([sine], "mat", tmp_path / "a.mat")
    content = loadmat(tmp_path / "a.mat", simplify_cells=True)
    np.testing.assert_array_equal(content["samples"]["measured"], sine.column("measured"))
    assert content["units"]["command"] == "A" and content["units"]["time"] == "s"
    assert json.loads(content["meta"])["name"] == "ball-screw stage A"


def frame_matrices(model: dict[str, float]) -> tuple[Array, Array, Array, Array]:
    """``Ad, Bd, A, B`` of the capture folder's description, by the matrix exponential."""
    a, gain = -model["model_viscous"] / model["model_inertia"], model["model_force_constant"] / model["model_inertia"]
    whole = expm(model["Ts"] * np.array([[0.0, 1.0, 0.0], [0.0, a, gain], [0.0, 0.0, 0.0]]))
    ad, bd = whole[:2, :2], whole[:2, 2]
    return ad, bd, ad @ ad, np.column_stack([ad @ bd, bd])


def frames(c: dict[str, Any], reference: Any, rows: int, advance: float) -> tuple[Array, Array]:
    """(u, y0) (rows,) of the perfect tracking recursion with this advance."""
    ad, bd, a, b = frame_matrices(c)
    u, y0 = np.zeros(rows), np.zeros(rows)
    for i in range(0, rows, 2):
        start, end = (reference(k * c["Ts"] + advance) for k in (i, i + 2))
        pair = np.linalg.solve(b, end - a @ start)
        u[i : i + 2] = pair
        y0[i], y0[i + 1] = start[0], (ad @ start + bd * pair[0])[0]
    return u, y0


def recomputed(folder: Path, file: str) -> tuple[Array, Array]:
    """Command from the folder alone, as its description says, and the recorded one; shares no code with the law."""
    c = yaml.safe_load((folder / "nominal.yaml").read_text())["controller"]
    rows = table(folder / file)
    time, position = rows["time_s"], rows["position_rad"]
    spline = make_interp_spline(time, rows["reference_rad"], k=5)

    def reference(t: float) -> Array:
        inside = min(max(t, time[0]), time[-1])
        return np.array([spline(inside), spline(inside, nu=1) if inside == t else 0.0])

    u, _ = frames(c, reference, len(time), c["feedforward_advance_s"])
    _, y0 = frames(c, reference, len(time), 0.0)
    weight, slip = np.array(c["friction_weight"]), np.array(c["friction_slip"])
    stops, last = np.zeros(len(weight)), rows["reference_rad"][0]
    ts, pole = c["Ts"], c["derivative_pole"]
    integral = derivative = before = 0.0
    command = np.zeros(len(time))
    for k in range(len(time)):
        error = y0[k] - position[k]
        integral += c["Ki"] * ts / 2 * (error + before)
        derivative = (2 - pole * ts) / (2 + pole * ts) * derivative
        derivative += 2 * c["Kd"] * pole / (2 + pole * ts) * (error - before)
        before = error
        here = reference(time[k] + c["friction_advance_s"])[0]
        stops, last = np.clip(stops + (here - last) / slip, -1.0, 1.0), here
        command[k] = c["Kp"] * error + integral + derivative + u[k] + weight @ stops / c["model_force_constant"]
    return command, rows["current_command_A"]


def test_the_folder_alone_gives_the_commands_again(sine: Recording, tmp_path: Path) -> None:
    """The claim of the capture folder's description: 1e-5 A; the command itself is above 1 A."""
    export([sine], "folder", tmp_path / "out")
    command, recorded_command = recomputed(tmp_path / "out", "sine-1.csv")
    assert np.abs(recorded_command).max() > 1.0
    assert np.abs(command - recorded_command).max() <= 1e-5


def test_gains_in_the_folder_are_the_published_ones(sine: Recording, tmp_path: Path) -> None:
    """Stage A at 40 Hz: a 991.31, Kp 833.30, Ki 55901, Kd 4.2749; L = 0.159 ms + 1 x 0.5 ms."""
    export([sine], "folder", tmp_path / "out")
    c = yaml.safe_load((tmp_path / "out" / "nominal.yaml").read_text())["controller"]
    assert [c["derivative_pole"], c["Kp"], c["Ki"], c["Kd"]] == pytest.approx([991.31, 833.30, 55901, 4.2749], rel=1e-5)
    assert c["feedforward_advance_s"] == pytest.approx(0.000659, rel=1e-12)
    assert c["friction_advance_s"] == pytest.approx(0.000909, rel=1e-12)
    assert c["anti_windup"].startswith("conditional integration")


def test_a_folder_comes_back_as_it_went(sine: Recording, tmp_path: Path) -> None:
    export([sine, sine], "folder", tmp_path / "out")
    captures = yaml.safe_load((tmp_path / "out" / "captures.yaml").read_text())["captures"]
    assert [
        (capture["file"], capture["experiment"], capture["repeat"], capture["use"], capture["start_s"])
        for capture in captures
    ] == [
        ("sine-1.csv", "sine", 1, "diagnose", 0.0),
        ("sine-2.csv", "sine", 2, "diagnose", 0.0),
    ]
    for back in read(tmp_path / "out"):
        assert set(back.samples.dtype.names or ()) == {
            "time",
            *Setpoint._fields,
            "command",
            "measured",
            "measured_current",
        }
        for name in back.samples.dtype.names or ():
            np.testing.assert_array_equal(back.column(name), sine.column(name))
        for name, value in sine.meta["axis"].items():
            assert back.meta["axis"][name] == (value if isinstance(value, str) else pytest.approx(value, rel=1e-15))
        again = export([back], "folder", tmp_path / "again")[0].path
        for name in ("nominal.yaml", "sine-1.csv", "sine-1-setpoints.csv"):
            assert (again / name).read_text() == (tmp_path / "out" / name).read_text()


def test_what_was_added_to_the_command_goes_along(sine: Recording, tmp_path: Path) -> None:
    """Learned and injected together, as a reader needs them to recompute the command."""
    samples = sine.samples.copy()
    samples["learned"] = 0.1 * np.sin(sine.column("time"))
    samples["injection"] = 0.2
    added = sine._replace(samples=samples)
    exported = export([added, sine], "folder", tmp_path / "out")[0]
    captures = yaml.safe_load((exported.path / "captures.yaml").read_text())["captures"]
    assert [capture.get("injection") for capture in captures] == ["sine-1-injection.csv", None]
    beside = table(exported.path / "sine-1-injection.csv")
    np.testing.assert_array_equal(beside["injection_A"], 0.2 + samples["learned"])
    np.testing.assert_array_equal(beside["time_s"], sine.column("time"))
    assert exported.notes == []
    back = read(exported.path)[0]
    for name in ("learned", "injection"):
        np.testing.assert_array_equal(back.column(name), samples[name])


def test_setpoints_that_do_not_fit_are_refused(sine: Recording, tmp_path: Path) -> None:
    folder = export([sine], "folder", tmp_path / "out")[0].path
    path = folder / "sine-1-setpoints.csv"
    text = path.read_text()
    path.write_text(text[: text.rindex("\n", 0, -1)])
    with refused(RecordingError, kind=ProblemKind.CONFLICT, file=path, column=""):
        read(folder)
    path.write_text(text.replace("target_rad", "target", 1))
    with refused(RecordingError, kind=ProblemKind.CONFLICT, file=path, column="target_rad"):
        read(folder)
    path.unlink()
    with refused(RecordingError, kind=ProblemKind.FILE, file=path):
        read(folder)


def test_layers_that_were_off_are_told(tmp_path: Path) -> None:
    bare = recorded(tmp_path, "bare", "linear-slider", frozenset({"ptc", "friction"}))
    export([bare], "folder", tmp_path / "out")
    nominal = yaml.safe_load((tmp_path / "out" / "nominal.yaml").read_text())
    assert nominal["controller"]["feedforward"].startswith("none")
    assert nominal["controller"]["friction_weight"] == []
    assert nominal["friction"]["coulomb"] == pytest.approx(4.5)
    assert nominal["friction"]["stribeck"]["velocity"] == 0.003
    assert nominal["stage"]["kind"] == "linear" and nominal["stage"]["travel_per_unit_mm"] == 1000.0


def test_the_sliders_stiffness_lets_it_ring_at_40_hz() -> None:
    """M (2 pi f)^2 = sum(alpha / delta); Stribeck's curve bounds what slips and stiffens nothing.

    The release itself is simulated in tests/studies/test_release.py.
    """
    setup = load_stage(CONFIG / "linear-slider.yaml")
    operators = setup.stage.friction.operators
    stiffness = float(np.sum(np.array(operators.weight) / np.array(operators.slip)))
    assert math.sqrt(stiffness / setup.stage.mechanics.inertia) / (2.0 * math.pi) == pytest.approx(40.0, abs=0.3)
    assert sum(operators.weight) * (1.0 + setup.stage.friction.stribeck.rise) == pytest.approx(5.3, rel=1e-3)


def test_captures_of_two_controllers_do_not_share_a_folder(sine: Recording, tmp_path: Path) -> None:
    other = recorded(tmp_path, "other", without=frozenset({"friction"}))
    with refused(RecordingError, kind=ProblemKind.CONFLICT, column="controller.friction_weight"):
        export([sine, other], "folder", tmp_path / "out")


def test_a_reference_becomes_a_trajectory(sine: Recording, tmp_path: Path) -> None:
    export([sine], "trajectory", tmp_path / "again.yaml")
    trajectory = load_trajectory(tmp_path / "again.yaml", axis_of(load_stage(CONFIG / "ball-screw.yaml")))
    motion = phases(trajectory).motion.at(sine.column("time"))
    scale = sine.meta["axis"]["travel_per_unit"]
    np.testing.assert_allclose(motion.position, sine.column("reference") * scale, atol=1e-12)
    assert "run_up" not in (tmp_path / "again.yaml").read_text()  # it begins and ends at rest


def test_run_up_and_run_out_begin_and_end_at_rest() -> None:
    """Consistent derivatives, no jump of the velocity, the record itself unchanged; half of v T either way."""
    time = np.linspace(3.0, 4.0, 1001)
    p = Recorded(time, 0.02 * np.sin(5.0 * time), run_up=0.3, run_out=0.2)
    t = np.linspace(0.0, 1.5, 15_001)
    x, v, a = p.at(t)
    first, last = 0.1 * math.cos(15.0), 0.1 * math.cos(20.0)
    assert p.duration == pytest.approx(1.5) and p.steady == pytest.approx((0.3, 1.3))
    assert p.initial_velocity == p.final_velocity == x[0] == v[0] == v[-1] == 0.0
    assert x[-1] == p.end == pytest.approx(0.15 * first + 0.02 * (math.sin(20.0) - math.sin(15.0)) + 0.1 * last)
    inside = (t >= 0.3) & (t <= 1.3)
    expected = 0.15 * first + 0.02 * (np.sin(5.0 * (t[inside] + 2.7)) - math.sin(15.0))
    np.testing.assert_allclose(x[inside], expected, atol=1e-12)
    assert np.abs(np.diff(v)).max() < 1.01e-4 * np.abs(a).max()
    np.testing.assert_allclose(np.gradient(x, t), v, atol=1e-4)
    assert np.abs(a[t < 0.3]).max() == pytest.approx(1.5 * abs(first) / 0.3, rel=1e-3)


def test_a_part_of_a_file_runs(tmp_path: Path) -> None:
    rows = "".join(f"{0.1 * k:.1f},{0.5 * k}\n" for k in range(40))
    (tmp_path / "a.csv").write_text(f"time_s,reference_mm\n{rows}")
    axis = axis_of(load_stage(CONFIG / "linear-slider.yaml"))
    (tmp_path / "a.yaml").write_text("type: csv\nfile: a.csv\npart: [1 s, 2000 ms]\nrun_up: 0.1 s\nrun_out: 100 ms\n")
    trajectory = phases(load_trajectory(tmp_path / "a.yaml", axis)).motion
    assert trajectory.duration == pytest.approx(1.2)
    assert trajectory.end == pytest.approx(5.0e-3 + 5.0e-3 * 0.1)
    (tmp_path / "a.yaml").write_text("type: csv\nfile: a.csv\npart: [5 s, 6 s]\n")
    with refused(ConfigError, kind=ProblemKind.CONFLICT, key="part", value="[5 s, 6 s]", unit="s"):
        load_trajectory(tmp_path / "a.yaml", axis)


def test_a_folder_does_not_take_the_place_of_a_file(sine: Recording, tmp_path: Path) -> None:
    notes = tmp_path / "notes.yaml"
    notes.write_text("mine\n")
    with refused(StageError, kind=ProblemKind.FILE, file=notes):
        export([sine], "folder", notes)
    assert notes.read_text() == "mine\n"


def test_what_cannot_be_exported_is_refused(sine: Recording, tmp_path: Path) -> None:
    with refused(RecordingError, kind=ProblemKind.CONFLICT, file=tmp_path / "a.csv"):
        export([sine, sine], "csv", tmp_path / "a.csv")
    with refused(RecordingError, kind=ProblemKind.VALUE):
        export([sine], "xls", None)
    with refused(RecordingError, kind=ProblemKind.MISSING, file=sine.path):
        export([sine._replace(samples=sine.samples[:0])], "csv", None)
    for to, name in (("csv", "x.parquet"), ("mat", "x.csv"), ("csv", "x.h5")):
        with refused(RecordingError, kind=ProblemKind.CONFLICT, file=tmp_path / name):
            export([sine], to, tmp_path / name)
        assert not (tmp_path / name).exists()
    (tmp_path / "file").write_text("")
    for to in ("csv", "folder"):
        with refused(RecordingError, kind=ProblemKind.FILE):
            export([sine], to, tmp_path / "file" / "a.csv")


def test_losses_are_said(sine: Recording, tmp_path: Path) -> None:
    broken = sine._replace(lost_rows=3, complete=False, ended="cut off")
    for to in ("csv", "folder"):
        notes = " ".join(export([broken], to, tmp_path / to)[0].notes)
        assert "3 rows were lost" in notes and "not complete: cut off" in notes


def test_a_machine_without_current_lacks_the_column(sine: Recording, tmp_path: Path) -> None:
    samples = sine.samples.copy()
    samples["measured_current"] = np.nan
    save(tmp_path / "dumb.h5", sine.meta, samples, "complete")
    recording = export([open_recording(tmp_path / "dumb.h5")], "folder", tmp_path / "out")[0]
    assert recording.notes == ["sine-1.csv: there is no current"]
    assert "current_A" not in table(tmp_path / "out" / "sine-1.csv")


def test_the_command_line_knows_every_format() -> None:
    assert set(get_args(Format)) - set(SIMULATORS) == set(FORMATS)
