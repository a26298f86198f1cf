"""No file, however malformed, does anything but load or end in an error that says place and reason."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stagectl.config.bounds import LARGEST_FILE
from stagectl.config.source import ConfigError, UnreadableError, compose
from stagectl.config.stage_file import Setup, load_stage
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.problem import ProblemKind
from stagectl.units import StageError
from tests.config.corpus import Case, files, mutations, without_comments
from tests.conftest import CONFIG
from tests.problems import refused

STAGES = ("ball-screw.yaml", "linear-slider.yaml")
# One file of each set of keys: a line is broken in the same ways, whatever its number.
TRAJECTORIES = sorted(
    {
        frozenset(re.findall(r"(?m)^(\w+):", path.read_text())): path.name
        for path in sorted((CONFIG / "trajectories").glob("*.yaml"))
    }.values()
)
PLACE = re.compile(r"\([^()]*[^()/]:(\d+)\)$")  # (folder/file.yaml:12)
PYTHON = re.compile(r"Traceback|NoneType| object at 0x|list index|invalid literal|unhashable|\bnan deg")


def attempt(load: Callable[[Path], Any], path: Path, case: Case) -> str:
    """Load the case; '' where it is good, else the error, whose form is checked."""
    path.write_bytes(case.content)
    message = ""
    try:
        load(path)
    except StageError as error:
        message = str(error)
    assert case.refused in (None, bool(message)), f"{case.name}: {message or 'accepted'}"
    well_said(message, case)
    return message


def well_said(message: str, case: Case) -> None:
    """Each line ends with file and line, is printable and short, and shows no Python."""
    last = len(re.findall(rb"\r\n|\r|\n", case.content)) + 1
    for line in message.splitlines():
        place = PLACE.search(line)
        assert place or line.startswith("and "), f"{case.name}: no place in {line!r}"
        assert not place or 1 <= int(place[1]) <= last, f"{case.name}: {line!r}"
        assert line.isprintable() and len(line) < 700, f"{case.name}: {line!r}"
        assert not PYTHON.search(line), f"{case.name}: {line!r}"
    if message and case.line is not None:
        assert any((match := PLACE.search(line)) and int(match[1]) == case.line for line in message.splitlines()), (
            message
        )


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that looks like config/: what a stage file names is there."""
    folder = tmp_path_factory.mktemp("config")
    (folder / "drives").symlink_to(CONFIG / "drives")
    return folder


def the_corpus(load: Callable[[Path], Any], path: Path, cases: Iterator[Case]) -> tuple[int, int]:
    """Number of cases, and of those that were refused."""
    outcomes = [attempt(load, path, case) for case in cases]
    return len(outcomes), sum(outcome != "" for outcome in outcomes)


def test_every_line_of_a_stage_broken_in_every_way(machine: Path) -> None:
    cases = mutations((CONFIG / "ball-screw.yaml").read_text())
    # Eight thousand take a minute; every eleventh meets each line and, on some line, each way.
    count, refused = the_corpus(load_stage, machine / "stage.yaml", islice(cases, 0, None, 11))
    assert count >= 650
    assert 0.8 < refused / count < 0.99  # a loader that refused everything would not be one


@pytest.mark.parametrize("name", TRAJECTORIES)
def test_every_line_of_a_trajectory_broken_in_every_way(machine: Path, ball_screw: Setup, name: str) -> None:
    cases = mutations((CONFIG / "trajectories" / name).read_text())
    axis = axis_of(ball_screw)
    count, refused = the_corpus(lambda path: load_trajectory(path, axis), machine / "trajectory.yaml", cases)
    assert count >= 400
    assert 0.6 < refused / count < 0.99


@pytest.mark.parametrize("case", list(files((CONFIG / "ball-screw.yaml").read_text())), ids=lambda case: case.name)
def test_whole_files_as_a_stage(machine: Path, case: Case) -> None:
    if case.line is not None and case.content.startswith(b"type:"):
        case = case._replace(line=1)  # a trajectory: its first line says so, whatever else is wrong
    began = time.process_time()  # what other programs take is not the loader's
    attempt(load_stage, machine / "stage.yaml", case)
    assert time.process_time() - began < 3.0


@pytest.mark.parametrize(
    "case", list(files((CONFIG / "trajectories" / "sine-2um.yaml").read_text())), ids=lambda case: case.name
)
def test_whole_files_as_a_trajectory(machine: Path, ball_screw: Setup, case: Case) -> None:
    began = time.process_time()  # what other programs take is not the loader's
    attempt(lambda path: load_trajectory(path, axis_of(ball_screw)), machine / "trajectory.yaml", case)
    assert time.process_time() - began < 3.0


ODD = st.sampled_from(
    [*"[]{}:,-?&*!|>'\"%@`#\t \n\\0\x00\x7f\u2028\ufeff９µ", "\r\n", "<<: ", "*a", "&a ", "!!map ", "---\n", "...\n"]
)
EDITS = st.lists(
    st.tuples(st.integers(0, 10_000), st.integers(0, 40), ODD | st.text(max_size=5)), min_size=1, max_size=4
)


@pytest.mark.parametrize("name", [*STAGES, *TRAJECTORIES[:1]])
@settings(max_examples=120, suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True)
@given(edits=EDITS)
def test_any_edit_of_any_file(machine: Path, ball_screw: Setup, name: str, edits: list[tuple[int, int, str]]) -> None:
    folder = CONFIG if name in STAGES else CONFIG / "trajectories"
    text = without_comments((folder / name).read_text())
    for place, cut, instead in edits:
        start = place % len(text) if text else 0
        text = text[:start] + instead + text[start + cut :]
    axis = axis_of(ball_screw)
    load = load_stage if name in STAGES else lambda path: load_trajectory(path, axis)
    attempt(load, machine / "edited.yaml", Case(repr(text), text.encode("utf-8", "surrogatepass")))


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True)
@given(content=st.binary(max_size=200))
def test_any_bytes(machine: Path, content: bytes) -> None:
    attempt(load_stage, machine / "bytes.yaml", Case(repr(content), content, True))


def test_what_is_no_file_is_refused_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (
        tmp_path,
        tmp_path / "pipe",
        tmp_path / "absent",
        Path("/dev/zero"),
        tmp_path / ("n" * 5000),
        Path("a\0b"),
    ):
        with pytest.raises(UnreadableError) as caught:
            compose(path)
        assert str(caught.value).isprintable()

    def forbidden(*_: Any, **__: Any) -> Any:
        raise PermissionError(13, "Permission denied")

    (tmp_path / "secret").write_text("type: dwell")
    monkeypatch.setattr(Path, "open", forbidden)  # mode 000 does not stop root
    with refused(UnreadableError, kind=ProblemKind.FILE, file=tmp_path / "secret"):
        compose(tmp_path / "secret")


def test_the_largest_file_is_read_and_one_byte_more_is_not(tmp_path: Path) -> None:
    file = tmp_path / "large.yaml"
    body = "type: dwell\nduration: 1 s\n"
    file.write_text(body + "#" * (LARGEST_FILE - len(body)))
    assert compose(file).tag.endswith(":map")
    file.write_text(file.read_text() + "#")
    with refused(ConfigError, kind=ProblemKind.SYNTAX, file=file):
        compose(file)


@pytest.mark.parametrize(
    ("depth", "wide", "most"),
    [(19, 2, None), (21, 2, 20), (1, 1001, 1000), (22, 40, 20)],  # a bomb of aliases is deep first
)
def test_a_file_of_too_many_trajectories_is_refused_by_what_is_too_many(
    depth: int, wide: int, most: int | None, machine: Path, ball_screw: Setup
) -> None:
    """Each list holds the one before, `wide` times; aliases count as what they stand for."""
    inner = "{type: dwell, duration: 1 s}"
    for _ in range(depth):
        inner = f"{{type: sequence, parts: [{inner}]}}"
    path = machine / "many.yaml"
    path.write_text(f"type: sequence\nparts: [{', '.join(['&one ' + inner, *['*one'] * (wide - 1)])}]\n")
    if most is None:
        load_trajectory(path, axis_of(ball_screw))
        return
    with refused(ConfigError, kind=ProblemKind.SHAPE, key="parts", interval=f"[1, {most}]"):
        load_trajectory(path, axis_of(ball_screw))


def test_a_tag_makes_python_do_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "tag.yaml"
    file.write_text("name: !!python/object/apply:os.system ['touch moved']\n")
    with pytest.raises(ConfigError):
        load_stage(file)
    assert os.listdir(tmp_path) == ["tag.yaml"]
