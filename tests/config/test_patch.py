"""Patching a stage file: the values come back, everything else stays, and nothing that would be refused is written."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stagectl.config.friction_laws import Operators, Rolling
from stagectl.config.lengths import Lengths
from stagectl.config.patch import patched, write
from stagectl.config.source import ConfigError
from stagectl.config.stage_blocks import StageFile
from stagectl.config.stage_file import load_stage
from stagectl.problem import ProblemKind
from stagectl.units import ROTARY
from tests.conftest import CONFIG
from tests.problems import refused

STAGES = ("ball-screw.yaml", "linear-slider.yaml", "emps.yaml")
COMMENT = re.compile(r"#\s*(.*\S)")
TOUCHED = re.compile(
    r"\s*(#|inertia:|viscous:|bias:|law:|weight:|slip:|coulomb:|elements:|\S+est:|stribeck:|rise:|velocity:)"
)
NOMINAL = {name: load_stage(CONFIG / name).file for name in STAGES}
LEAD = Lengths(ROTARY, 0.012)


def stage(folder: Path, name: str = "ball-screw.yaml", edit: Callable[[str], str] = str) -> Path:
    path = folder / name
    path.write_text(edit((CONFIG / name).read_text()), newline="")
    return path


def operators(count: int, coulomb: float, shortest: float) -> dict[str, Any]:
    slips = [shortest * 1.4**j for j in range(count)]
    return {"law": "stop-operators", "weight": [coulomb / (j + 1.7) for j in range(count)], "slip": slips}


@pytest.mark.parametrize("name", STAGES)
@given(
    scale=st.floats(0.5, 2.0),
    viscous=st.floats(0.8, 1.25),
    bias=st.floats(-10.0, 10.0),
    count=st.integers(1, 24),
    shortest=st.floats(1e-7, 1e-2),
)
@settings(max_examples=6, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_values_come_back_and_the_rest_stays(
    name: str, scale: float, viscous: float, bias: float, count: int, shortest: float, tmp_path: Path
) -> None:
    path = stage(tmp_path, name)
    before, nominal = path.read_text(), NOMINAL[name]
    wanted = {
        "mechanics.inertia": scale * nominal.mechanics.inertia,
        "mechanics.viscous": scale * viscous * nominal.mechanics.viscous,
        "mechanics.bias": bias,
        "friction": operators(count, scale, shortest),
    }
    write(path, path, wanted)
    check_values(load_stage(path).file, wanted)
    after = path.read_text()
    for comment in COMMENT.findall(before):
        assert comment in after
    untouched = [line for line in before.splitlines() if not TOUCHED.match(line)]
    assert [line for line in after.splitlines() if line in untouched] == untouched
    assert max(map(len, after.splitlines())) <= max(120, *map(len, before.splitlines()))
    write(path, path, wanted)
    assert path.read_text() == after  # nothing is new the second time
    assert [place.name for place in tmp_path.iterdir()] == [name]


def check_values(file: StageFile, wanted: dict[str, Any]) -> None:
    assert file.mechanics.inertia == pytest.approx(wanted["mechanics.inertia"], rel=1e-6)
    assert file.mechanics.viscous == pytest.approx(wanted["mechanics.viscous"], rel=1e-6)
    assert file.mechanics.bias == pytest.approx(wanted["mechanics.bias"], rel=1e-6)
    assert isinstance(file.friction, Rolling | Operators)
    operators = file.friction.operators()
    np.testing.assert_allclose(operators.weight, wanted["friction"]["weight"], rtol=1e-6)
    np.testing.assert_allclose(operators.slip, wanted["friction"]["slip"], rtol=1e-6)


def test_the_shipped_file_reads_as_its_user_would_have_written_it(tmp_path: Path) -> None:
    path = stage(tmp_path)
    slips = [2.0 * math.pi * travel / 0.012 for travel in (0.25e-6, 1.5e-6, 14e-6)]
    friction = {"law": "stop-operators", "weight": [0.3, 0.25, 0.46], "slip": slips}
    made = write(path, path, {"mechanics.inertia": 0.01003, "friction": friction})
    assert [str(change) for change in made[:4]] == [
        "mechanics.inertia: 0.010 kg m^2 -> 0.01003 kg m^2",
        "friction.law: rolling -> stop-operators",
        "friction.weight: (not there) -> [0.3 N m, 0.25 N m, 0.46 N m]",
        "friction.slip: (not there) -> [0.25 um, 1.5 um, 14 um]",
    ]
    assert "friction.longest: 9 um -> (removed)" in map(str, made)
    text = path.read_text()
    assert "\n  inertia: 0.01003 kg m^2\n  viscous: 0.14 N m s/rad\n\nfriction:\n  law: stop-operators" in text
    assert "\n  weight: [0.3 N m, 0.25 N m, 0.46 N m]\n  slip: [0.25 um, 1.5 um, 14 um]\n\nencoder:" in text
    assert text.index("# before, rolling: 12 equal") - text.index("  law: ") == 35  # in its column


def test_a_comment_stays_in_its_column() -> None:
    text = "motor:\n  force_constant: 0.72 N m/A       # as on the plate\n"
    longer = patched(text, {"motor.force_constant": 0.7251234}, LEAD).text
    assert longer == "motor:\n  force_constant: 0.7251234 N m/A  # as on the plate\n"
    longest = patched(text.replace("       #", "  #"), {"motor.force_constant": 0.7251234}, LEAD).text
    assert longest == "motor:\n  force_constant: 0.7251234 N m/A  # as on the plate\n"


@pytest.mark.parametrize(
    ("text", "values", "expected"),
    [
        ("limits: {speed: 300 mm/s}\n", {"limits.speed": 20.0}, "limits: {speed: 38.197186342054884 mm/s}\n"),
        ("mechanics: {inertia: 1 kg m^2}  # x\n", {"mechanics.bias": 2.0},
         "mechanics: {inertia: 1 kg m^2, bias: 2 N m}  # x\n"),
        ("name: a\r\nmotor:\r\n  force_constant: 1 N m/A\r\n", {"mechanics.inertia": 2.0},
         "name: a\r\nmotor:\r\n  force_constant: 1 N m/A\r\nmechanics:\r\n  inertia: 2 kg m^2\r\n"),
        ("drive:\n  current_lag:   0.159 ms", {"drive.current_lag": 2.5e-4}, "drive:\n  current_lag:   0.25 ms"),
        ("drive:\n  current_lag: 0.159 ms", {"drive.current_lag": 2.5e-7}, "drive:\n  current_lag: 0.25 us"),
        ("drive:\n  delay_samples: 1  # nd\n# end\n", {"drive.delay_samples": 2},
         "drive:\n  delay_samples: 2  # nd\n# end\n"),
        ("friction: {law: rolling, coulomb: 1 N m, elements: 3} # c\n",
         {"friction": {"law": "stop-operators", "weight": [1.0], "slip": [5.235987755982989e-4]}},
         "friction: {law: stop-operators, weight: [1 N m], slip: [1 um]} # c\n"),
        ("friction:\n  law: stop-operators\n  weight:\n    - 1 N m   # one\n    - 2 N m   # two\n"
         "  slip: [1 um, # a\n    2 um]\n",
         {"friction.weight": [3.0, 4.0], "friction.slip": [1e-3, 2e-3]},
         "friction:\n  law: stop-operators\n  # one\n  weight: [3 N m, 4 N m]  # two\n  # a\n"
         "  slip: [1.9098593171027443 um, 3.819718634205489 um]\n"),
    ],
)  # fmt: skip
def test_every_style_of_writing(text: str, values: dict[str, Any], expected: str) -> None:
    assert patched(text, values, LEAD).text == expected


@pytest.mark.parametrize(
    ("values", "fields"),
    [
        ({"mechanics.inertia": -1.0}, {"key": "mechanics.inertia", "value": "-1 kg m^2", "kind": ProblemKind.RANGE}),
        ({"mechanics.viscous": math.nan}, {"key": "mechanics.viscous"}),
        ({"drive.delay_samples": 4}, {"key": "control.bandwidth", "kind": ProblemKind.LOOP}),
        (
            {"friction": {"law": "stop-operators", "weight": [1.0], "slip": [1.0, 2.0]}},
            {"key": "friction.weight", "kind": ProblemKind.CONFLICT},
        ),
        ({"mechanics.mass": 1.0}, {"key": "mechanics.mass", "kind": ProblemKind.UNKNOWN}),
        ({"friction.weight": [1.0]}, {"key": "friction.weight", "kind": ProblemKind.UNKNOWN}),
    ],
)
def test_what_would_be_refused_is_not_written(
    tmp_path: Path, values: dict[str, Any], fields: dict[str, object]
) -> None:
    path = stage(tmp_path)
    before = path.read_bytes()
    with refused(ConfigError, **fields) as caught:
        write(path, path, values)
    assert all(problem.file in (None, path) for problem in caught.value.problems)
    assert path.read_bytes() == before
    assert [place.name for place in tmp_path.iterdir()] == ["ball-screw.yaml"]
    assert "tmp" not in str(caught.value).replace(str(tmp_path), "")


def test_an_alias_is_left_alone(tmp_path: Path) -> None:
    path = stage(tmp_path, edit=lambda text: text.replace("inertia: 0.010 kg m^2", "inertia: &j 0.010 kg m^2"))
    with refused(ConfigError, kind=ProblemKind.SHAPE, key="mechanics.inertia"):
        write(path, path, {"mechanics.inertia": 0.02})


def test_another_file(tmp_path: Path) -> None:
    """It is a copy; a file that is there is only patched as its own source: mode and byte order mark stay."""
    source, other = stage(tmp_path), tmp_path / "other.yaml"
    write(source, other, {"mechanics.inertia": 0.02})
    assert other.read_text() == source.read_text().replace("0.010 kg m^2", "0.02 kg m^2")
    other.write_bytes(b"\xef\xbb\xbf" + other.read_bytes())
    other.chmod(0o640)
    before = other.read_bytes()
    with refused(ConfigError, kind=ProblemKind.CONFLICT):
        write(source, other, {"mechanics.viscous": 0.2})
    assert other.read_bytes() == before
    write(other, other, {"mechanics.viscous": 0.2})
    assert other.read_bytes().startswith(b"\xef\xbb\xbf#") and other.stat().st_mode & 0o777 == 0o640
    file = load_stage(other).file
    assert (file.mechanics.inertia, file.mechanics.viscous) == (0.02, 0.2)


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    source = stage(tmp_path)
    with refused(ConfigError, kind=ProblemKind.FILE, file=tmp_path / "none" / "a.yaml"):
        write(source, tmp_path / "none" / "a.yaml", {"mechanics.inertia": 0.02})
