"""Several axes in one file: what each has of its own, and what is said of a file that is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from stagectl.config.machine_file import axes_of, coupled, text_of
from stagectl.config.source import ConfigError
from stagectl.config.stage_file import load_stage
from stagectl.drives.cycle_time import bus_load
from stagectl.drives.drive import Canopen
from stagectl.problem import ProblemKind
from stagectl.service.axis_controller import ServiceError
from stagectl.service.machine import machine, named, together
from tests.conftest import CONFIG, Command
from tests.problems import refused

XY, ONE = CONFIG / "xy.yaml", CONFIG / "ball-screw.yaml"
AXIS = "  x: {name: X of the X-Y stage, drive.wire.node: 5}\n"


def test_the_shipped_machine_has_two_axes_on_one_bus() -> None:
    axes = machine([str(XY)], None)
    assert list(axes) == ["x", "y"] and together([str(XY)])
    x, y = (axis.setup.file for axis in axes.values())
    assert isinstance(x.drive.wire, Canopen) and isinstance(y.drive.wire, Canopen)
    assert (x.drive.wire.node, y.drive.wire.node) == (5, 6)
    assert (x.mechanics.inertia, y.mechanics.inertia) == (0.010, 0.008)
    assert x.control.period == y.control.period == 1e-3
    assert y.limits.travel[1] == pytest.approx(0.8 * x.limits.travel[1], rel=1e-12)
    assert bus_load(1e3, 1e6, (0, 8, 8, 8, 8)) == pytest.approx(0.595)  # as its comment says: 55 + 4 x 135 bits
    assert y._replace(name=x.name, mechanics=x.mechanics, limits=x.limits, drive=x.drive) == x


def test_a_file_of_one_axis_is_as_ever(tmp_path: Path) -> None:
    assert axes_of(ONE) == [ONE] and coupled(ONE) and text_of(ONE) == ONE.read_text()
    assert named([str(ONE)]) == {"axis": ONE} and list(named([f"a={ONE}", f"b={ONE}"])) == ["a", "b"]
    odd = tmp_path / "a#b.yaml"
    odd.write_text(ONE.read_text().replace("eds: drives/", f"eds: {CONFIG / 'drives'}/"))
    assert load_stage(odd).file.name == "ball-screw stage A"  # a file of that name is that file


def test_the_text_of_an_axis_is_a_stage_file_of_its_own(tmp_path: Path) -> None:
    own = tmp_path / "y.yaml"
    own.write_text(text_of(CONFIG / "xy.yaml#y"))
    assert load_stage(own).file == load_stage(CONFIG / "xy.yaml#y").file


def variant(folder: Path, old: str, new: str) -> Path:
    text = XY.read_text().replace("eds: drives/", f"eds: {CONFIG / 'drives'}/")
    assert text.count(old) == 1
    (folder / "m.yaml").write_text(text.replace(old, new))
    return folder / "m.yaml"


@pytest.mark.parametrize(
    ("old", "new", "kind", "key"),
    [
        ("coupled: true", "coupled: maybe", ProblemKind.VALUE, "coupled"),
        (AXIS, "  x: {drive.wire.nod: 5}\n", ProblemKind.UNKNOWN, "drive.wire.nod"),
        (AXIS, "  x: {name.word: 5}\n", ProblemKind.SHAPE, "name.word"),
        (AXIS, "  x: 5\n", ProblemKind.SHAPE, "axes.x"),
        (AXIS, "  x: {drive.wire.node: 500}\n", ProblemKind.RANGE, "drive.wire.node"),
        ("  x: {", "  2 x: {", ProblemKind.VALUE, "axes"),
        ("  x: {", "  ../../x: {", ProblemKind.VALUE, "axes"),
    ],
)
def test_a_problem_has_its_place(tmp_path: Path, old: str, new: str, kind: ProblemKind, key: str) -> None:
    path = variant(tmp_path, old, new)
    with refused(ConfigError, kind=kind, key=key, file=path, line=7 if key == "coupled" else 10):
        load_stage(axes_of(path)[0])


def test_an_axis_must_be_named_and_be_there(command: Command) -> None:
    choice = f"take one of {XY}#x, {XY}#y"
    with refused(ConfigError, kind=ProblemKind.UNKNOWN, file=XY, remedy=choice):
        load_stage(XY)
    with refused(ConfigError, kind=ProblemKind.UNKNOWN, file=XY, remedy=choice):
        load_stage(CONFIG / "xy.yaml#z")
    with refused(ConfigError, kind=ProblemKind.UNKNOWN, remedy="leave out #x"):
        load_stage(CONFIG / "ball-screw.yaml#x")
    code, _, said = command("config", "check", XY)
    assert code == 0 and said.count("bandwidth 8 Hz at 1 ms") == 2


def test_what_two_axes_on_a_bus_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match="for both: give each another number"):
        machine([str(variant(tmp_path, "drive.wire.node: 6", "drive.wire.node: 5"))], None)
    path = variant(tmp_path, "coupled: true ", "coupled: false ")
    assert not together([str(path)])
    path.write_text(path.read_text().replace("period: 1 ms", "period: 0.5 ms"))
    with pytest.raises(ServiceError, match=r"take 119 % of the bus, the limit is 80 %"):
        machine([str(path)], None)
