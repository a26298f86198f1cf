"""The exported FMU: FMPy finds nothing wrong with it, and its master gives our positions to the last bit."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest

from stagectl.config.stage_file import Setup, load_stage
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.interchange.export import ExportError
from stagectl.interchange.fmu import archive, description
from stagectl.interchange.fmu.archive import to_fmu
from stagectl.interchange.fmu.variables import variables
from stagectl.interchange.round_trip import Array, commands
from stagectl.kernels import effects, jit, stage
from stagectl.kernels.plant import Transmission
from stagectl.kernels.plant_with_effects import opposing
from tests.conftest import CONFIG, Command, Run
from tests.kernels.affected import affected

AXES = ["ball-screw.yaml", "linear-slider.yaml", "emps.yaml", "odrive.yaml"]  # one of several: `test_the_command`
GEARED = Transmission(0.3, 80.0, 0.03, 1e-4, 0.6)
LOADS = [Transmission(), GEARED, *(GEARED._replace(load_friction=share) for share in (0.0, 1.0))]
SHOWN = ("position", "velocity", "measured", "current", "reported_current", "friction")


def with_effects(setup: Setup, transmission: Transmission = Transmission(), **changes: Any) -> Setup:  # noqa: B008
    return setup._replace(stage=affected(setup.stage, transmission)._replace(**changes))


def ours(setup: Setup, current: Array) -> dict[str, Array]:
    """What the outputs are at the beginnings of the periods."""
    p, x, rows = setup.stage, stage.at_rest(setup.stage), []
    for command in current.tolist():
        seen = stage.measured(p.encoder, x, stage.SILENT)
        rows.append(
            (x.position, x.velocity, seen, x.current, stage.reported(p.drive, x, setup.dt), opposing(p.mechanics, x))
        )
        x = stage.period(p, x, command, stage.SILENT, setup.dt, setup.file.simulation.substeps)
    return dict(zip(SHOWN, np.array(rows).T, strict=True))


def theirs(setup: Setup, path: Path, current: Array, **start: float) -> dict[str, Array]:
    result = fmpy.simulate_fmu(
        str(path), output_interval=setup.dt, stop_time=(len(current) - 1) * setup.dt, output=list(SHOWN),
        input=archive._signals(setup, current), start_values=start,
    )  # fmt: skip
    return {name: result[name] for name in SHOWN}


def same(setup: Setup, path: Path, current: Array, **start: float) -> None:
    here, there = ours(setup, current), theirs(setup, path, current, **start)
    for name in SHOWN:
        np.testing.assert_array_equal(there[name], here[name], err_msg=name)


@pytest.mark.parametrize("name", AXES)
def test_every_axis_to_the_last_bit(name: str, tmp_path: Path) -> None:
    """Validation without findings is part of the export; the three motions are the page's."""
    setup = load_stage(CONFIG / name)
    exported = to_fmu(setup, tmp_path / "axis.fmu")
    assert exported.worst() == {"axis.fmu": (0.0, 0.0)}
    same(setup, tmp_path / "axis.fmu", commands(setup)["sliding"])


@pytest.mark.parametrize("transmission", LOADS, ids=["rigid", "geared", "no friction at the load", "all of it"])
def test_every_effect_to_the_last_bit(ball_screw: Setup, tmp_path: Path, transmission: Transmission) -> None:
    setup = with_effects(ball_screw, transmission)
    exported = to_fmu(setup, tmp_path / "axis.fmu")
    assert exported.lost == ["drive.jitter = 1e-05: it draws random numbers"]
    for current in commands(setup).values():
        same(setup, tmp_path / "axis.fmu", current)


@pytest.mark.parametrize("code", range(1, len(effects.COORDINATES)))
def test_every_residual_table(ball_screw: Setup, tmp_path: Path, code: int) -> None:
    table = effects.Table(code, -0.5, 0.25, jit.table([-0.02, 0.03, -0.01, 0.02, 0.0]))
    setup = ball_screw._replace(stage=ball_screw.stage._replace(residual=table))
    archive.write(setup, tmp_path / "axis.fmu", archive.compiler())
    same(setup, tmp_path / "axis.fmu", commands(setup)["sliding"][:800])


def test_parameters_that_are_set_are_those_of_another_stage(ball_screw: Setup, tmp_path: Path) -> None:
    """Every parameter of the plain stage set to that of the affected one: the FMU is then the affected one's."""
    other = with_effects(ball_screw, GEARED, residual=ball_screw.stage.residual)
    archive.write(ball_screw, tmp_path / "axis.fmu", archive.compiler())
    start = {each.name: each.start for each in variables(other) if each.causality == "parameter"}
    same(other, tmp_path / "axis.fmu", commands(other)["sliding"], **start)


def test_a_closed_loop_of_ours(ball_screw: Setup, tracked: Callable[..., Run], tmp_path: Path) -> None:
    """The commands of a simulated run give its positions."""
    rows = tracked(load_trajectory(CONFIG / "trajectories/sine-1.6hz.yaml", axis_of(ball_screw))).samples
    archive.write(ball_screw, tmp_path / "axis.fmu", archive.compiler())
    found = theirs(ball_screw, tmp_path / "axis.fmu", rows["current"])
    np.testing.assert_array_equal(found["position"], rows["true_position"])
    np.testing.assert_array_equal(found["measured"], rows["measured"])


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMU of stage A."""
    path = tmp_path_factory.mktemp("fmu") / "axis.fmu"
    archive.write(load_stage(CONFIG / "ball-screw.yaml"), path, archive.compiler())
    return path


class Opened:
    """An instance of the FMU, called function by function."""

    def __init__(self, path: Path) -> None:
        self.said: list[str] = []
        self.description = fmpy.read_model_description(str(path))
        self.reference = {each.name: each.valueReference for each in self.description.modelVariables}
        self.fmu = fmpy.instantiate_fmu(fmpy.extract(str(path)), self.description, logger=self._log)

    def _log(self, environment: Any, status: int, category: bytes, message: bytes) -> None:
        self.said.append(message.decode())

    def put(self, **values: float) -> None:
        for name, value in values.items():
            self.fmu.setFloat64([self.reference[name]], [value])

    def value(self, name: str) -> float:
        return float(self.fmu.getFloat64([self.reference[name]])[0])

    def begun(self) -> Opened:
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        return self


@pytest.fixture
def opened(plain: Path) -> Opened:
    return Opened(plain)


def test_a_tunable_parameter_changes_in_the_motion_and_a_fixed_one_does_not(opened: Opened) -> None:
    opened.begun().put(**{"mechanics.inertia": 0.02})
    assert opened.value("mechanics.inertia") == 0.02
    with pytest.raises(fmpy.fmi1.FMICallException):
        opened.put(**{"mechanics.bias": 0.1})
    assert opened.said == ["mechanics.bias is fixed: set it before the initialization ends"]


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("mechanics.inertia", 0.0, "mechanics.inertia = 0; must lie in (0, 1e6]"),
        ("mechanics.inertia", float("nan"), "mechanics.inertia = nan; must lie in (0, 1e6]"),
        ("command", float("nan"), "command = nan; must lie in [-inf, inf]"),
        ("position", 1.0, "value reference 3 cannot be set"),
    ],
)
def test_what_cannot_be_set(opened: Opened, name: str, value: float, said: str) -> None:
    with pytest.raises(fmpy.fmi1.FMICallException):
        opened.put(**{name: value})
    assert opened.said == [said]


def test_a_delay_beyond_the_line_is_refused(opened: Opened) -> None:
    with pytest.raises(fmpy.fmi1.FMICallException):
        opened.fmu.setInt64([opened.reference["drive.delay_samples"]], [8])
    assert opened.said == ["drive.delay_samples = 8; must lie in [0, 7]"]


def test_a_step_is_a_whole_number_of_control_periods(opened: Opened) -> None:
    opened.begun().put(command=1.0)
    opened.fmu.doStep(0.0, 0.005)
    whole = "a step of 0.0007 s; must be a whole number of control periods of 0.0005 s"
    for now, step, said in ((0.005, 0.0007, whole), (0.0, 0.0005, "a step from 0 s, where the time is 0.005 s")):
        with pytest.raises(fmpy.fmi1.FMICallException):
            opened.fmu.doStep(now, step)
        assert opened.said.pop() == said


def test_it_starts_where_it_is_told_and_stands_there(opened: Opened) -> None:
    opened.put(**{"mechanics.bias": 0.1, "start_position": 2.0})
    opened.begun().fmu.doStep(0.0, 0.1)
    assert opened.value("position") == pytest.approx(2.0, abs=1e-12)
    assert opened.value("friction") == pytest.approx(0.1)


def test_a_state_that_is_kept_goes_on_the_same(opened: Opened, plain: Path) -> None:
    opened.begun().put(command=3.0)
    opened.fmu.doStep(0.0, 0.1)
    state = opened.fmu.getFMUState()
    kept = opened.fmu.serializeFMUState(state)
    opened.fmu.doStep(0.1, 0.1)
    reached = opened.value("position")
    opened.fmu.setFMUState(state)
    opened.fmu.doStep(0.1, 0.1)
    other = Opened(plain).begun()
    other.fmu.setFMUState(other.fmu.deserializeFMUState(kept))
    opened.fmu.freeInstance()  # the copy owns all of its arrays
    other.fmu.doStep(0.1, 0.1)
    assert other.value("position") == reached


def test_two_instances_do_not_touch_each_other(opened: Opened, plain: Path) -> None:
    other = Opened(plain).begun()
    opened.begun().put(command=3.0)
    opened.fmu.doStep(0.0, 0.1)
    other.fmu.doStep(0.0, 0.1)
    assert opened.value("position") != 0.0
    assert other.value("position") == 0.0


def test_the_description_names_units_and_when_a_parameter_may_be_set(opened: Opened) -> None:
    listed = {each.name: each for each in opened.description.modelVariables}
    inertia, stiffness = listed["mechanics.inertia"], listed["mechanics.cable.stiffness"]
    assert (inertia.unit, inertia.variability, inertia.causality) == ("kg m^2", "tunable", "parameter")
    assert (stiffness.unit, stiffness.variability, stiffness.start) == ("N m/rad", "fixed", "0.0")
    assert (listed["motor.cogging.amplitude"].unit, listed["motor.ripple.amplitude"].unit) == ("N m", None)
    assert listed["friction.operators.weight[1]"].unit == "N m"
    assert listed["command"].variability == "discrete"


def test_fmpy_builds_the_source_to_the_same_bits(ball_screw: Setup, tmp_path: Path) -> None:
    """A source FMU: another importer's own compiler call, with all warnings."""
    path = tmp_path / "axis.fmu"
    archive.write(ball_screw, path, None)
    with zipfile.ZipFile(path) as content:
        assert not [name for name in content.namelist() if name.startswith("binaries")]
    subprocess.run([sys.executable, "-m", "fmpy", "compile", str(path)], check=True, capture_output=True)
    same(ball_screw, path, commands(ball_screw)["sliding"])


def test_the_source_compiles_without_a_warning(ball_screw: Setup, tmp_path: Path) -> None:
    with zipfile.ZipFile(_written(ball_screw, tmp_path)) as content:
        content.extractall(tmp_path)
    strict = [*description.OPTIONS.split(), "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only"]
    compiler = archive.compiler()
    assert compiler is not None
    done = subprocess.run([compiler, *strict, tmp_path / "sources/fmi3.c"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def _written(setup: Setup, folder: Path) -> Path:
    archive.write(setup, folder / "axis.fmu", None)
    return folder / "axis.fmu"


def test_without_a_compiler_it_says_so(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "compiler", lambda: None)
    out = tmp_path / "a.fmu"
    code, _, words = command("export", CONFIG / "ball-screw.yaml", "--to", "fmu", "-o", out)
    assert code == 0 and "no C compiler on this machine" in words and f"fmpy compile {out}" in words.replace("\n", "")
    assert "Written, and not run" in words and "no C compiler" in out.with_suffix(".fmu.html").read_text()


def test_a_compiler_that_fails_is_an_error(ball_screw: Setup, tmp_path: Path) -> None:
    with pytest.raises(archive.CompileError, match="ended with 1"):
        archive.write(ball_screw, tmp_path / "a.fmu", shutil.which("false"))


def test_a_finding_is_an_error(ball_screw: Setup, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(description, "_units", lambda units: [])
    with pytest.raises(ExportError, match="finds in"):
        to_fmu(ball_screw, tmp_path / "a.fmu")


def test_the_command(command: Command, tmp_path: Path) -> None:
    out = tmp_path / "a.fmu"
    code, _, words = command("export", CONFIG / "xy.yaml#x", "--to", "fmu", "-o", out, "--json", tmp_path / "a.json")
    assert code == 0 and "a.fmu: the same to the last bit" in words.replace("\n", " ")
    assert json.loads((tmp_path / "a.json").read_text())["differences"]["a.fmu"] == {"of_motion": 0, "of_friction": 0}
