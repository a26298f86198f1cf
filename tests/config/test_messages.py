"""Typical mistakes: what a program reads of them, and the sentences that a person reads."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from stagectl.config.source import ConfigError
from stagectl.config.stage_file import Setup, load_stage
from stagectl.design import DesignError
from stagectl.problem import Problem, ProblemKind
from stagectl.units import StageError
from stagectl.workflows.motion import prepare
from tests.conftest import CONFIG
from tests.problems import refused

STAGE = (CONFIG / "ball-screw.yaml").read_text()
Kind = ProblemKind


@pytest.fixture
def error_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str], StageError]:
    """The error of stage A with one text in place of another, lines as in the file."""
    (tmp_path / "drives").symlink_to(CONFIG / "drives")
    monkeypatch.chdir(tmp_path)

    def error(old: str, new: str) -> StageError:
        assert STAGE.count(old) == 1
        Path("stage.yaml").write_text(STAGE.replace(old, new))
        with pytest.raises(StageError) as caught:
            load_stage(Path("stage.yaml"))
        return caught.value

    return error


def line(text: str, source: str = STAGE) -> int:
    """Number of the line that holds `text`."""
    return next(number for number, content in enumerate(source.splitlines(), 1) if text in content)


class Mistake:
    """A text in place of another, and the problem that it is: its fields, and the line that holds `at`."""

    def __init__(self, old: str, new: str, at: str, **fields: Any) -> None:
        self.old, self.new, self.at, self.fields = old, new, at, fields


HERTZ = {"key": "control.bandwidth", "unit": "Hz", "interval": "(0, 2000]"}
MISTAKES = {
    "wrong unit": Mistake(
        "bandwidth: 40 Hz", "bandwidth: 40 rad/s", "bandwidth", kind=Kind.UNIT, value="40 rad/s", **HERTZ
    ),
    "unit missing": Mistake("bandwidth: 40 Hz", "bandwidth: 40", "bandwidth", kind=Kind.UNIT, value="40", **HERTZ),
    "out of range": Mistake(
        "inertia: 0.010 kg m^2",
        "inertia: -0.010 kg m^2",
        "inertia",
        kind=Kind.RANGE,
        key="mechanics.inertia",
        value="-0.010 kg m^2",
        unit="kg m^2",
        interval="(0, 1e6]",
    ),
    "key misspelt": Mistake(
        "coulomb: 1.0 N m",
        "coulomb: 1.0 N m\n  stribek: 1",
        "elements",
        kind=Kind.UNKNOWN,
        key="friction.stribek",
        remedy="did you mean stribeck?",
    ),
    "key missing": Mistake(
        "  inertia: 0.010 kg m^2\n",
        "",
        "inertia",
        kind=Kind.MISSING,
        key="mechanics.inertia",
        remedy="moving inertia J or mass M, in kg m^2",
    ),
    "block missing": Mistake(
        "motor:\n  force_constant: 0.72 N m/A\n",
        "",
        "name:",
        kind=Kind.MISSING,
        key="motor",
        remedy="a block of force_constant",
    ),
    "key twice": Mistake(
        "  coulomb: 1.0 N m\n",
        "  coulomb: 1.0 N m\n  coulomb: 2.0 N m\n",
        "elements",
        kind=Kind.REPEATED,
        key="friction.coulomb",
    ),
    "choice misspelt": Mistake(
        "law: rolling",
        "law: roling",
        "law:",
        kind=Kind.VALUE,
        key="friction.law",
        value="roling",
        choices=("rolling", "stop-operators", "dahl", "lugre"),
    ),
    "value for a list": Mistake(
        "travel: [-50 mm, 50 mm]",
        "travel: 50 mm",
        "travel: [",
        kind=Kind.SHAPE,
        key="limits.travel",
        remedy="such as [-50 mm, 50 mm]",
    ),
    "list for a value": Mistake(
        "lead: 12 mm",
        "lead: [12 mm]",
        "lead:",
        kind=Kind.SHAPE,
        key="axis.lead",
        remedy="table travel per revolution; 0: none, in m",
    ),
    "no whole number": Mistake(
        "elements: 12",
        "elements: 12.5",
        "elements",
        kind=Kind.VALUE,
        key="friction.elements",
        value="12.5",
        interval="[1, 64]",
    ),
    "power": Mistake(
        "elements: 12",
        "elements: 2^4",
        "elements",
        kind=Kind.VALUE,
        key="friction.elements",
        value="2^4",
        interval="[1, 64]",
        remedy="write 16",
    ),
    "decimal object": Mistake(
        "command_object: 0x6071_00",
        "command_object: 6071_00",
        "command_object",
        kind=Kind.VALUE,
        key="drive.wire.command_object",
        value="6071_00",
        remedy="an object is hexadecimal, write 0x6071_00",
    ),
    "indentation": Mistake(
        "  lead: 12 mm",
        " lead: 12 mm",
        "lead:",
        kind=Kind.SYNTAX,
        reason="indented by 1, the line above it by 2; align what belongs together",
    ),
    "all in a line": Mistake(
        "  lead: 12 mm",
        "  lead: 12 mm, kind: rotary",
        "lead:",
        kind=Kind.SYNTAX,
        reason="a second `:` on the line: one entry a line, or all of them in { }, and a text with a colon in quotes",
    ),
    "decimal comma": Mistake(
        "lead: 12 mm",
        "lead: 12,5 mm",
        "lead:",
        kind=Kind.VALUE,
        key="axis.lead",
        value="12,5 mm",
        unit="m",
        interval="[0, 10]",
    ),
    "bus overloaded": Mistake(
        "bitrate: 1 Mbit/s",
        "bitrate: 500 kbit/s",
        "bitrate",
        kind=Kind.CONFLICT,
        key="drive.wire.bitrate",
        value="500 kbit/s",
        remedy="raise the bit rate, or take control.period of at least 0.813 ms",
    ),
    "travel reversed": Mistake(
        "travel: [-50 mm, 50 mm]",
        "travel: [50 mm, -50 mm]",
        "travel: [",
        kind=Kind.CONFLICT,
        key="limits.travel",
        value="[0.05, -0.05] m",
    ),
    "micrometres of lead": Mistake(
        "lead: 12 mm", "lead: 12 um", "  lead:", kind=Kind.RANGE, key="axis.lead", value="12 um"
    ),
    "slips reversed": Mistake(
        "longest: 9 um",
        "longest: 0.1 um",
        "longest",
        kind=Kind.CONFLICT,
        key="friction.longest",
        value="100 nm",
    ),
    "no EDS file": Mistake(
        "eds: drives/stagectl-virtual.eds",
        "eds: other.eds",
        "eds:",
        kind=Kind.FILE,
        key="drive.wire.eds",
        value="other.eds",
    ),
    "command not in the PDO": Mistake(
        "command_object: 0x6071_00",
        "command_object: 0x6072_00",
        "kind: canopen",
        kind=Kind.CONFLICT,
        key="drive.wire.rpdo",
    ),
    "time-out shorter than the heartbeat": Mistake(
        "reset: node",
        "heartbeat_timeout: 10 ms",
        "reset: node",
        kind=Kind.CONFLICT,
        key="drive.wire.heartbeat_timeout",
        value="0.01 s",
    ),
    "leading zero": Mistake(
        "node: 5\n",
        "node: 010\n",
        "node: 5",
        kind=Kind.VALUE,
        key="drive.wire.node",
        value="010",
        remedy="without a leading zero, write 10",
    ),
    "unit behind a list": Mistake(
        "travel: [-50 mm, 50 mm]",
        "travel: [-50, 50] mm",
        "travel: [",
        kind=Kind.SYNTAX,
        reason="words behind a list; each value has its own unit: write [-50 mm, 50 mm]",
    ),
    "number beyond all numbers": Mistake(
        "speed: 300 mm/s",
        "speed: 3e400 mm/s",
        "  speed: 300",
        kind=Kind.VALUE,
        key="limits.speed",
        value="3e400 mm/s",
        reason="too large for a number",
    ),
    "block within another": Mistake(
        "motor:\n  force_constant: 0.72 N m/A",
        "  motor:\n    force_constant: 0.72 N m/A",
        "motor:",
        kind=Kind.UNKNOWN,
        key="axis.motor",
        remedy="write motor: at the left margin",
    ),
    "open quote": Mistake(
        "inertia: 0.010 kg m^2",
        'inertia: "0.010 kg m^2',
        "inertia:",
        kind=Kind.SYNTAX,
        reason="a quote opens here and is not closed: close it",
    ),
    "second document": Mistake(
        "\nmotor:",
        "\n---\nmotor:",
        "motor:",
        kind=Kind.SYNTAX,
        reason="a second document begins here; a file holds one: remove the `---`",
    ),
    "tab": Mistake("  lead: 12 mm", "\tlead: 12 mm", "lead:", kind=Kind.SYNTAX),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_typical_mistakes_of_a_stage(error_of: Callable[[str, str], StageError], name: str) -> None:
    mistake = MISTAKES[name]
    error = error_of(mistake.old, mistake.new)
    (problem,) = error.problems
    assert isinstance(error, ConfigError)
    assert {field: getattr(problem, field) for field in mistake.fields} == mistake.fields
    assert (problem.file, problem.line) == (Path("stage.yaml"), line(mistake.at))


def test_the_sentences_for_review(error_of: Callable[[str, str], StageError]) -> None:
    """Printed with ``pytest -s``: one line each, with the place at its end."""
    for name, mistake in MISTAKES.items():
        sentence = str(error_of(mistake.old, mistake.new))
        print(f"{name}: {sentence}")
        assert "\n" not in sentence and sentence.endswith(f" (stage.yaml:{line(mistake.at)})")


def test_a_problem_is_one_sentence() -> None:
    place: dict[str, Any] = {"file": Path("a.yaml"), "line": 3}
    for problem, sentence in (
        (Problem("is missing", key="a.b", remedy="a length", **place), "a.b is missing: a length (a.yaml:3)"),
        (
            Problem("the unit is missing", key="a", value="5", unit="m", interval="[0, 9]", **place),
            "a = 5; the unit is missing; must lie in [0, 9] m (a.yaml:3)",
        ),
        (Problem(key="a", value="5 m", unit="m", interval="[0, 1]"), "a = 5 m; must lie in [0, 1] m"),
        (Problem(key="a", value="c", choices=("x", "y")), "a = c; must be one of x, y"),
        (Problem("no answer", value="5 m", remedy="wait"), "no answer: wait"),
    ):
        assert str(problem) == sentence


def test_a_margin_below_the_limit_is_refused_with_advice(error_of: Callable[[str, str], StageError]) -> None:
    error = error_of("bandwidth: 40 Hz", "bandwidth: 80 Hz")
    assert isinstance(error, DesignError)
    assert str(error) == (
        "control.bandwidth = 80 Hz; the phase margin is 6.5 deg; it must be at least 20 deg "
        "(period 0.5 ms, nd 1, nm 0, current lag 0.159 ms): "
        f"take 48 Hz (21.9 deg) or a shorter period (stage.yaml:{line('bandwidth: 40')})"
    )


def test_all_errors_come_at_once_and_a_flood_is_cut(error_of: Callable[[str, str], StageError]) -> None:
    assert len(error_of("elements: 12\n", "elements: 99\n  x: 1\n  y: 2\n").problems) == 3
    flood = error_of("elements: 12\n", "elements: 12\n" + "".join(f"  k{n}: 1\n" for n in range(500)))
    assert len(flood.problems) == 500
    assert str(flood).count("\n") == 30
    assert str(flood).endswith("and 470 more errors (stage.yaml)")


def test_terminal_escapes_of_a_file_are_shown_and_not_sent(error_of: Callable[[str, str], StageError]) -> None:
    error = error_of("lead: 12 mm", 'lead: "\\e[2J\\n12 mm"')
    assert error.problems[0].value == r"'\x1b[2J\n12 mm'"


SINE = "type: sine\namplitude: {}\nfrequency: {}\nperiods: {}\n"
TYPES = ("sine", "trapezoid", "s_curve", "dwell", "multisine", "csv", "sequence", "sum", "current_sine",
         "current_multisine", "current_sweep", "excited", "release")  # fmt: skip
DWELL = "  - {type: dwell, duration: 1 s}\n"
MOTIONS: list[tuple[str, dict[str, Any]]] = [
    (SINE.format("60 mm", "0.2 Hz", 1), {"kind": Kind.LIMIT, "key": "limits.travel", "value": "[-50, 50] mm"}),
    (SINE.format("40 mm", "3 Hz", 1), {"kind": Kind.LIMIT, "key": "limits.speed", "value": "300 mm/s"}),
    (SINE.format("1 mm", "15 Hz", 1), {"kind": Kind.LIMIT, "key": "limits.acceleration", "value": "5 m/s^2"}),
    (SINE.format("1 mm", "1 Hz", 9000), {"kind": Kind.LIMIT, "key": "duration", "value": "9002 s"}),
    (
        "Type: sine\nAmplitude: 1 mm\n",
        {"kind": Kind.UNKNOWN, "key": "Type", "remedy": "did you mean type?", "line": 1},
    ),
    ("type: sin\n", {"kind": Kind.VALUE, "key": "type", "value": "sin", "choices": TYPES, "line": 1}),
    (
        SINE.format("2 N", "1 Hz", 1),
        {"kind": Kind.UNIT, "key": "amplitude", "value": "2 N", "unit": "m", "interval": "(0, 1e6]", "line": 2},
    ),
    (
        f"type: sequence\nparts:\n{DWELL}  - type: trapezoid\n    velocity: 1 mm/s\n    acceleration: 1 m/s^2\n"
        "    distance: 0 mm\n",
        {"kind": Kind.RANGE, "key": "parts[1].distance", "value": "0 m", "file": Path("motion.yaml"), "line": 7},
    ),
]


@pytest.mark.parametrize(("text", "fields"), MOTIONS)
def test_typical_mistakes_of_a_trajectory(
    ball_screw: Setup, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, fields: dict[str, Any]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("motion.yaml").write_text(text)
    with refused(StageError, **fields):
        prepare(ball_screw, Path("motion.yaml"), frozenset(), None)


def test_a_type_that_is_merged_is_said_to_be_merged(ball_screw: Setup, tmp_path: Path) -> None:
    path = tmp_path / "motion.yaml"
    path.write_text(f"base: &b {{{SINE.format('1 mm', '1 Hz', 1).strip()}}}\n<<: *b\n".replace("\n", ", ", 3))
    with refused(StageError, kind=Kind.UNKNOWN, key="<<", file=path, line=2):
        prepare(ball_screw, path, frozenset(), None)


def test_friction_that_the_current_does_not_overcome_is_named_beside_the_current(
    error_of: Callable[[str, str], StageError],
) -> None:
    friction, current = error_of("coulomb: 1.0 N m", "coulomb: 1.0 kN m").problems
    assert friction[:6] == (friction.reason, Kind.CONFLICT, "friction.coulomb", "1000 N m", "N m", "[0, 10.8)")
    assert (current.key, current.value, current.interval) == ("drive.current_limit", "15 A", "(1389, inf)")
    assert (friction.line, current.line) == (line("coulomb:"), line("current_limit:"))


@pytest.mark.parametrize(
    ("old", "new", "admissible"),
    [
        ("following_error: 0.2 mm", "following_error: -1 mm", "(0, 1.91e+06] mm"),
        ("[-50 mm, 50 mm]", "[-50 mm, 50]", "[-1.91e+06, 1.91e+06] mm"),
        ("[-50 mm, 50 mm]", "[-50 mm, 50 A]", ""),
    ],
)
def test_an_interval_is_in_the_unit_that_was_typed(tmp_path: Path, old: str, new: str, admissible: str) -> None:
    text = (CONFIG / "ball-screw.yaml").read_text()
    assert text.count(old) == 1
    (tmp_path / "stage.yaml").write_text(text.replace(old, new))
    with refused(ConfigError, admissible=admissible, unit="rad"):
        load_stage(tmp_path / "stage.yaml")
