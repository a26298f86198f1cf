"""What a person reads at three in the morning: the exact words for typical mistakes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from stagectl.config.stage_file import Setup, load_stage
from stagectl.units import StageError
from stagectl.workflows.motion import prepare
from tests.conftest import CONFIG

STAGE = (CONFIG / "ball-screw.yaml").read_text()


@pytest.fixture
def said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """The error of stage A with one text in place of another, lines as in the file."""
    (tmp_path / "drives").symlink_to(CONFIG / "drives")
    monkeypatch.chdir(tmp_path)

    def message(old: str, new: str) -> str:
        assert STAGE.count(old) == 1
        Path("stage.yaml").write_text(STAGE.replace(old, new))
        with pytest.raises(StageError) as caught:
            load_stage(Path("stage.yaml"))
        return str(caught.value)

    return message


def line(text: str, source: str = STAGE) -> int:
    """Number of the line that holds `text`."""
    return next(number for number, one in enumerate(source.splitlines(), 1) if text in one)


MISTAKES = [
    (
        "wrong unit",
        ("bandwidth: 40 Hz", "bandwidth: 40 rad/s"),
        "control.bandwidth = 40 rad/s; 'rad/s' does not measure Hz; must lie in (0, 2000] Hz (stage.yaml:{bandwidth})",
    ),
    (
        "unit missing",
        ("bandwidth: 40 Hz", "bandwidth: 40"),
        "control.bandwidth = 40; the unit is missing; must lie in (0, 2000] Hz (stage.yaml:{bandwidth})",
    ),
    (
        "out of range",
        ("inertia: 0.010 kg m^2", "inertia: -0.010 kg m^2"),
        "mechanics.inertia = -0.010 kg m^2; must lie in (0, 1e6] kg m^2 (stage.yaml:{inertia})",
    ),
    (
        "key misspelt",
        ("coulomb: 1.0 N m", "coulomb: 1.0 N m\n  stribek: 1"),
        "friction.stribek is not known; did you mean stribeck? (stage.yaml:{elements})",
    ),
    (
        "key missing",
        ("  inertia: 0.010 kg m^2\n", ""),
        "mechanics.inertia is missing: moving inertia J or mass M, in kg m^2 (stage.yaml:{inertia})",
    ),
    (
        "block missing",
        ("motor:\n  force_constant: 0.72 N m/A\n", ""),
        "motor is missing: a block of force_constant (stage.yaml:{name:})",
    ),
    (
        "key twice",
        ("  coulomb: 1.0 N m\n", "  coulomb: 1.0 N m\n  coulomb: 2.0 N m\n"),
        "friction.coulomb stands twice (stage.yaml:{elements})",
    ),
    (
        "choice misspelt",
        ("law: rolling", "law: roling"),
        "friction.law = roling; must be one of rolling, stop-operators, dahl, lugre (stage.yaml:{law:})",
    ),
    (
        "value for a list",
        ("travel: [-50 mm, 50 mm]", "travel: 50 mm"),
        "limits.travel must be a list: [a, b, ...] (stage.yaml:{travel: [})",
    ),
    (
        "list for a value",
        ("lead: 12 mm", "lead: [12 mm]"),
        "axis.lead must be a single value: table travel per revolution; 0: none, in m (stage.yaml:{lead:})",
    ),
    (
        "no whole number",
        ("elements: 12", "elements: 12.5"),
        "friction.elements = 12.5; must be a whole number; must lie in [1, 64] (stage.yaml:{elements})",
    ),
    (
        "decimal comma",
        ("lead: 12 mm", "lead: 12,5 mm"),
        "axis.lead = 12,5 mm; not a number with a unit; must lie in [0, 10] m (stage.yaml:{lead:})",
    ),
    (
        "bus overloaded",
        ("bitrate: 1 Mbit/s", "bitrate: 500 kbit/s"),
        "drive.wire.bitrate = 500 kbit/s; SYNC and two PDOs every 0.5 ms take 130 % of the bus, the limit is 80 %: "
        "raise the bit rate, or take control.period of at least 0.813 ms (stage.yaml:{bitrate})",
    ),
    (
        "travel reversed",
        ("travel: [-50 mm, 50 mm]", "travel: [50 mm, -50 mm]"),
        "limits.travel = [0.05, -0.05] m; the first must be below the second (stage.yaml:{travel: [})",
    ),
    (
        "slips reversed",
        ("longest: 9 um", "longest: 0.1 um"),
        "friction.longest must be 1 to 1e+06 times friction.shortest (stage.yaml:{longest})",
    ),
    (
        "no EDS file",
        ("eds: drives/stagectl-virtual.eds", "eds: other.eds"),
        "drive.wire.eds = other.eds; no such file; the path is relative to . (stage.yaml:{eds:})",
    ),
    (
        "command not in the PDO",
        ("command_object: 0x6071_00", "command_object: 0x6072_00"),
        "drive.wire.rpdo must hold the object 0x6072_00 that the cycle uses (stage.yaml:{kind: canopen})",
    ),
    (
        "time-out shorter than the heartbeat",
        ("heartbeat_timeout: 500 ms", "heartbeat_timeout: 50 ms"),
        "drive.wire.heartbeat_timeout = 0.05 s; must exceed heartbeat (stage.yaml:{heartbeat_timeout})",
    ),
    (
        "indentation",
        ("  lead: 12 mm", " lead: 12 mm"),
        "expected <block end>, but found '<block mapping start>'; check indentation, quotes and colons around this "
        "line (stage.yaml:{lead:})",
    ),
    (
        "tab",
        ("  lead: 12 mm", "\tlead: 12 mm"),
        "found character '\\t' that cannot start any token; check indentation, quotes and colons around this "
        "line (stage.yaml:{lead:})",
    ),
]


@pytest.mark.parametrize(("change", "words"), [mistake[1:] for mistake in MISTAKES], ids=[m[0] for m in MISTAKES])
def test_typical_mistakes_of_a_stage(said: Callable[..., str], change: tuple[str, str], words: str) -> None:
    before, mark, after = words.partition("{")
    key, _, rest = after.partition("}")
    assert said(*change) == f"{before}{line(key)}{rest}" if mark else words


def test_a_margin_below_the_limit_is_refused_with_advice(said: Callable[..., str]) -> None:
    assert said("bandwidth: 40 Hz", "bandwidth: 80 Hz") == (
        "control.bandwidth = 80 Hz leaves a phase margin of 6.5 deg; at least 20 deg "
        "are asked for.  Period 0.5 ms, nd 1, nm 0, current lag 0.159 ms.  Take 48 Hz (21.9 deg) or a shorter period "
        f"(stage.yaml:{line('bandwidth: 40')})"
    )


def test_all_errors_come_at_once_and_a_flood_is_cut(said: Callable[..., str]) -> None:
    assert said("elements: 12\n", "elements: 99\n  x: 1\n  y: 2\n").count("\n") == 2
    flood = said("elements: 12\n", "elements: 12\n" + "".join(f"  k{n}: 1\n" for n in range(500)))
    assert flood.count("\n") == 30
    assert flood.endswith("and 470 more errors (stage.yaml)")


def test_terminal_escapes_of_a_file_are_shown_and_not_sent(said: Callable[..., str]) -> None:
    assert said("lead: 12 mm", 'lead: "\\e[2J\\n12 mm"').startswith("axis.lead = '\\x1b[2J\\n12 mm'; not a number")


SINE = "type: sine\namplitude: {}\nfrequency: {}\nperiods: {}\n"
MOTIONS = [
    (
        SINE.format("60 mm", "0.2 Hz", 1),
        "the trajectory needs a travel of 0.06 m upwards; limits.travel of ball-screw stage A allows 0.05 m upwards",
    ),
    (
        SINE.format("40 mm", "3 Hz", 1),
        "the trajectory needs a speed of 0.753982 m/s; limits.speed of ball-screw stage A allows 0.3 m/s",
    ),
    (
        SINE.format("1 mm", "15 Hz", 1),
        "the trajectory needs an acceleration of 9.87889 m/s^2; limits.acceleration of ball-screw stage A "
        "allows 5 m/s^2",
    ),
    (
        SINE.format("1 mm", "1 Hz", 9000),
        "the trajectory takes 9002 s; must be at most 5000 s, 10000000 control periods",
    ),
    (
        "type: sin\n",
        "type = sin; must be one of sine, trapezoid, s_curve, dwell, multisine, csv, sequence, sum, current_sine, "
        "current_multisine, current_sweep, excited, release (motion.yaml:1)",
    ),
    (SINE.format("2 N", "1 Hz", 1), "amplitude = 2 N; 'N' does not measure m; must lie in (0, 1e6] m (motion.yaml:2)"),
    (
        "type: sequence\nparts:\n  - {type: dwell, duration: 1 s}\n  - type: trapezoid\n    velocity: 1 mm/s\n"
        "    acceleration: 1 m/s^2\n    distance: 0 mm\n",
        "sequence.parts[1].distance = 0 m; must be at least 1e-12 m either way: use a dwell to stand still "
        "(motion.yaml:7)",
    ),
]


@pytest.mark.parametrize(("text", "words"), MOTIONS)
def test_typical_mistakes_of_a_trajectory(
    ball_screw: Setup, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("motion.yaml").write_text(text)
    with pytest.raises(StageError) as caught:
        prepare(ball_screw, Path("motion.yaml"), frozenset(), None)
    assert str(caught.value).split(": nothing has moved")[0] == words
