"""The page on folders of captures: its example is read, and its tables hold every key, range and default."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from stagectl.compensation.forms import FORMS
from stagectl.gap.logs import deployed_controller, nominal_model, sources
from stagectl.gap.logs.load_session import load
from stagectl.gap.logs.nominal_values import Block, of_file
from stagectl.gap.logs.session import NominalValueError
from stagectl.kernels import feedback, law, rollout, stage, unloading
from stagectl.recording import columns, imports, scales
from stagectl.recording.hdf5 import RecordingError, open_recording
from stagectl.recording.nominal_yaml import nominal_of
from stagectl.units import Quantity
from tests.conftest import ROOT
from tests.gap.captured import SINE, exported, recorded

PAGE = (ROOT / "docs" / "capture-folder.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r'(?ms)^```\w+ title="([\w.-]+)"\n(.*?)^```', PAGE))
ROWS = 200  # of each capture: the page prints the first ones
# Ranges that follow from two places of the code, or from one that is no range.
NARROWER = {"controller.frame_samples": "2", "stage.encoder_step": "(0, 1]"}
COMPUTED = {  # defaults that depend on other keys, or are no decimal number
    "controller.friction_advance_s": "`feedforward_advance_s` + Ts/2",
    "drive.delay_samples": "1 with `controller.Ts`, else 0",
    "stage.encoder_step": "continuous",
    "stage.pitch": "2 pi",
}
BRISTLE = {"coulomb": 1.0, "stiffness": 1e4, "stribeck": {"rise": 0.3, "velocity": 0.1}}
WHOLE: dict[str, Any] = {
    "stage": {"force_constant": 0.7, "inertia": 0.01, "pitch": 6.0, "encoder_periods_per_pitch": 2048.0},
    "friction": {"weight": [1.0], "slip": [1e-3], "coulomb": 1.0, "bristle": BRISTLE, "stribeck": BRISTLE["stribeck"]},
    "drive": {"current_quantum_A": 0.01, "voltage_limit_V": 48.0, "resistance_ohm": 1.0},
}
FEEDBACKS: list[dict[str, Any]] = [
    {"Kp": 1.0, "Kd": 1.0, "derivative_pole": 900.0, "anti_windup": "conditional", "command_limit_A": 5.0},
    {"position_gain": 1.0, "velocity_gain": 1.0},
    {"kp": 1.0, "kv": 1.0},
]
AHEAD: dict[str, Any] = {
    **dict.fromkeys(("model_inertia", "model_viscous", "model_force_constant"), 1.0),
    **{"friction_weight": [1.0], "friction_slip": [1e-3], "friction_bristle": BRISTLE},
    **{"unloading": [0.0] * 8, "measurement_delay_samples": 1, "frame_samples": 2, "observer_gains": [0.0] * 3},
    "observer_model": {"a12": 1.0, "a22": 1.0, "b1": 1.0, "b2": 1.0, "delay": 1, "share": 1.0},
}

Asked = dict[str, tuple[Quantity, float | None]]


class Noted(dict[str, Any]):
    """A block of values that notes which keys are asked for."""

    def __init__(self, values: dict[str, Any]) -> None:
        super().__init__(values)
        self.asked: set[str] = set()

    def get(self, key: str, default: Any = None) -> Any:
        self.asked.add(key)
        return super().get(key, default)

    def __getitem__(self, key: str) -> Any:
        self.asked.add(key)
        return super().__getitem__(key)


def part(title: str) -> str:
    """The page below a heading, up to the next one."""
    return re.split(r"(?m)^#", PAGE.partition(f"# {title}\n")[2])[0]


def rows(title: str) -> dict[str, list[str]]:
    """The cells behind each key in the table below a heading."""
    lines = re.findall(r"(?m)^\| (`.*?) \|(.*) \|$", part(title))
    assert lines
    found: dict[str, list[str]] = {}
    for keys, cells in lines:
        found |= {key: [cell.strip() for cell in cells.split("|")] for key in re.findall(r"`(\w[\w.]*)`", keys)}
    return found


def tables() -> dict[str, list[str]]:
    """The cells (unit, range, default, meaning) behind each key of nominal.yaml, by its dotted name."""
    blocks = ("stage", "friction", "drive", "controller")
    return {f"{block}.{key}": cells for block in blocks for key, cells in rows(f"`{block}`").items()}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The files of the page; its captures go on as they begin."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    head, *printed = FILES["sine-1.csv"].splitlines()
    k = np.arange(len(printed), ROWS)
    more = np.column_stack([5e-4 * k, 1e-5 * k * k, 1e-5 * k * k, 0.0 * k, 0.0 * k])
    text = "\n".join([head, *printed, *(",".join(map(repr, row)) for row in more.tolist())])
    for entry in yaml.safe_load(FILES["captures.yaml"])["captures"]:
        (tmp_path / entry["file"]).write_text(text + "\n")
    return tmp_path


def test_the_example_is_read(folder: Path) -> None:
    session = load([folder])
    p, running = session.stage, session.law or law.Law(feedback.ABSENT, 0.0)
    assert (session.kind, session.dt, session.travel_per_unit) == ("rotary", 5e-4, pytest.approx(1.9098593171e-3))
    assert (p.motor.force_constant, *p.mechanics[:2], p.encoder.step) == (0.72, 0.01, 0.14, 5.99211e-06)
    assert (list(p.friction.operators.weight), list(p.friction.operators.slip)) == ([0.3, 0.6], [0.002, 0.02])
    assert p.drive[:4] == (0.0, 1, 10.0, 0.00016)
    assert running.feedback == feedback.discretised(feedback.Gains(800.0, 50000.0, 4.0, 1000.0), 5e-4)
    assert running[1:] == law.Law(feedback.ABSENT, math.inf)[1:]  # no limit, no band, no unloading
    assert [(log.name, log.experiment, log.repeat, log.held_out, log.start) for log in session.logs] == [
        ("sine-1.csv", "sine", 1, False, 0.0),
        ("noise-1.csv", "noise", 1, False, 12.0),
        ("sine-2.csv", "sine", 2, False, 24.0),
        ("noise-2.csv", "noise", 2, False, 36.0),
        ("check-1.csv", "check", 1, True, 48.0),
        ("check-2.csv", "check", 2, True, 60.0),
    ]
    assert session.cannot_tell == ()
    assert [log.name for log in session.logs if log.injection is not None] == ["noise-1.csv", "noise-2.csv"]
    assert session.logs[1].injection is not None
    np.testing.assert_array_equal(session.logs[1].injection[:5], [0.1, -0.1, -0.1, 0.0, 0.0])


def test_the_commands_of_the_example_are_those_of_its_controller(folder: Path) -> None:
    session = load([folder])
    log, printed = session.logs[0], np.loadtxt(FILES["sine-1.csv"].splitlines()[1:], delimiter=",")
    assert session.law is not None and log.setpoints is not None
    np.testing.assert_allclose(printed[:, 2], log.position[:5], rtol=0.0, atol=0.0)
    out = np.empty((5, len(law.Output._fields)))
    rollout.answers(session.law, law.AT_REST, (log.setpoints[:5], log.position[:5], out))
    np.testing.assert_allclose(out[:, law.OUTPUT_COLUMNS["command"]], printed[:, 3], rtol=0.0, atol=1e-9)


def _command(gains: feedback.Gains, errors: list[float], dt: float) -> list[float]:
    p, x, commands = feedback.discretised(gains, dt), feedback.AT_REST, []
    for error in errors:
        terms, x = feedback.step(p, x, error)
        commands.append(sum(terms))
    return commands


@pytest.mark.parametrize("newest", [True, False])
def test_other_forms_of_the_pid_convert_as_the_page_says(newest: bool) -> None:
    """A backward difference, and integrals by rectangles of the newest or of the last error."""
    kp, ki, kd, dt = 5.0, 300.0, 0.2, 1e-3
    errors = np.random.default_rng(1).standard_normal(50).tolist()
    last = [0.0, *errors[:-1]]
    integral = np.cumsum(ki * dt * np.array(errors if newest else last))
    wanted = kp * np.array(errors) + integral + kd / dt * (np.array(errors) - np.array(last))
    gains = feedback.Gains(kp + (0.5 if newest else -0.5) * ki * dt, ki, kd, 2.0 / dt)
    np.testing.assert_allclose(_command(gains, errors, dt), wanted, rtol=1e-12, atol=1e-10)


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_a_row_has_the_current_before_its_command_acts(ball_screw: Any, delay: int) -> None:
    """With `delay_samples: 1` the current of row k depends on the commands up to row k - 2."""
    assert "the current of row k depends on the commands up to row k-2" in " ".join(PAGE.split())
    p = ball_screw.stage._replace(drive=ball_screw.stage.drive._replace(delay_samples=delay))
    setpoints, filled = np.zeros((20, rollout.SETPOINTS)), np.zeros((20, rollout.WIDTH))
    setpoints[5, law.SETPOINT_COLUMNS["injection"]] = 1.0  # in open loop: this is the command of row 5
    loop = rollout.Loop(law.Law(feedback.ABSENT, math.inf), p)
    rollout.closed_loop(loop, stage.at_rest(p), (setpoints, np.zeros((20, 2)), filled), ball_screw.dt, 4)
    current = filled[:, rollout.COLUMNS.index("measured_current")]
    assert int(np.flatnonzero(current)[0]) == 5 + 1 + delay


def _asked_of_the_reader(monkeypatch: pytest.MonkeyPatch) -> Asked:
    """What the readers ask of nominal.yaml, by dotted name: the quantity, and the default."""
    asked: Asked = {}
    number, numbers = Block.number, Block.numbers

    def one(self: Block, key: str, quantity: Quantity, default: float | None = None) -> float:
        asked.setdefault(f"{self.name}.{key}", (quantity, default))
        return number(self, key, quantity, default)

    def several(self: Block, key: str, quantity: Quantity) -> list[float]:
        asked[f"{self.name}.{key}"] = (quantity, None)
        return numbers(self, key, quantity)

    monkeypatch.setattr(Block, "number", one)
    monkeypatch.setattr(Block, "numbers", several)
    rubbing = ({"law": "lugre", **BRISTLE}, WHOLE["friction"])
    for values in ({**WHOLE, "friction": friction} for friction in rubbing):
        nominal_model.read(of_file(values, Path("nominal.yaml"), "rotary"))
    for own in FEEDBACKS:
        file = of_file({"controller": {"Ts": 1e-3, **AHEAD, **own}}, Path("nominal.yaml"), "rotary")
        assert deployed_controller.read(file) is not None
    return asked


def _row(table: dict[str, list[str]], name: str) -> list[str]:
    """The row of a key; of one within a block of its own, that of the same key elsewhere, or of this block."""
    block, _, key = name.rpartition(".")
    if name in table:
        return table[name]
    for other in (f"friction.stribeck.{key}", f"friction.{key}"):
        if ("bristle" in block or "stribeck" in block) and other in table:
            return table[other]
    assert f"`{key}`" in table[block][1], name
    return table[block]


def test_ranges_units_and_defaults_are_those_of_the_readers(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, table = _asked_of_the_reader(monkeypatch), tables()
    assert len(asked) > 60
    with pytest.raises(RecordingError, match="encoder_step = 0"):
        scales.scales_of_nominal({"stage": {"kind": "rotary", "encoder_step": 0}}, Path("nominal.yaml"))
    for name, (quantity, default) in asked.items():
        unit, interval, shown, _ = _row(table, name)
        assert NARROWER.get(name, quantity.interval) in interval, name
        assert not quantity.unit or quantity.unit.replace(" | ", " or ") == unit, name
        expected = "" if default is None else "no limit" if math.isinf(default) else f"{default:g}"
        assert default is None or shown == COMPUTED.get(name, expected), name


def test_what_the_page_calls_required_is_refused_where_it_is_absent() -> None:
    for name in ("stage.force_constant", "stage.inertia", "controller.Ts"):
        block, key = name.split(".")
        values = {**WHOLE, "controller": {"Ts": 1e-3, **FEEDBACKS[0]}}
        values[block] = {own: value for own, value in values[block].items() if own != key}
        file = of_file(values, Path("nominal.yaml"), "rotary")
        with pytest.raises(NominalValueError, match=f"{name} is missing"):
            (deployed_controller if block == "controller" else nominal_model).read(file)
        assert tables()[name][2] == "required"


def test_every_key_of_nominal_yaml_is_on_the_page(tmp_path: Path) -> None:
    """What the readers know, and what the export writes."""
    known = {f"{block}.{key}" for block, keys in nominal_model._KEYS.items() for key in keys.split()}
    known |= {f"controller.{key}" for key in deployed_controller._KEYS.split()}
    known -= {"friction.stribeck"}  # shown by its keys
    shown = set(tables())
    assert known == {name for name in shown if not name.startswith("friction.stribeck.")}
    blocks = {"stage": Noted({"kind": "rotary"}), "drive": Noted({"amplifier_A_per_V": 1.0})}
    scales.scales_of_nominal(blocks, Path("nominal.yaml"))
    asked = {f"{block}.{key}" for block, values in blocks.items() for key in values.asked}
    assert len(asked) == 7 and asked <= shown
    (recording,) = recorded(tmp_path, SINE, 1)
    for block, values in nominal_of(open_recording(recording)).items():
        assert {f"{block}.{key}" for key in values} - {"friction.stribeck"} <= shown


def test_every_key_of_captures_yaml_is_on_the_page(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The readers ask for these and no others."""
    entry = Noted({"file": "sine-1.csv"})
    read, instead = scales.read_values, {"captures.yaml": {"captures": [entry]}}
    monkeypatch.setattr(imports, "read_values", lambda path: instead.get(path.name) or read(path))
    sources._log(*imports.read(folder))
    assert entry.asked == set(rows("captures.yaml"))


def test_every_column_is_on_the_page() -> None:
    shown = set(re.findall(r"`(\w+)`", part("The CSV of a capture")))
    suffix = {"time": "_s", "position": "_rad", "reference": "_rad"}
    headers = {"time", "position", "reference", "current_command", "current", "injection"}
    wanted = {f"{name}{suffix.get(name, '_A')}" if name in headers else name for name in columns.QUANTITIES}
    assert wanted <= shown
    assert {"injection_A", "closed", *(f"{name}_A" for name in ("feedforward", "friction", "learned"))} <= set(
        re.findall(r"`(\w+)`", part("captures.yaml"))
    )


def test_the_setpoints_that_the_export_writes_have_the_columns_of_the_page(tmp_path: Path) -> None:
    written = exported(recorded(tmp_path / "own", SINE, 1), tmp_path / "folder")
    (entry,) = yaml.safe_load((written / "captures.yaml").read_text())["captures"]
    assert set(entry) <= set(rows("captures.yaml"))
    header = (written / entry["setpoints"]).read_text().partition("\n")[0].split(",")
    assert len(header) == 8 and set(header) <= set(re.findall(r"`(\w+)`", part("captures.yaml")))
    header = (written / entry["file"]).read_text().partition("\n")[0].split(",")
    assert header == FILES["sine-1.csv"].partition("\n")[0].split(",")


def test_the_forms_of_friction_compensation_and_the_eight_numbers_are_on_the_page() -> None:
    paragraph = " ".join(PAGE.split()).partition("**Friction compensation.**")[2]
    for name, form in FORMS.items():
        if name == "model":
            continue
        listed = re.findall(rf"`{name}`(?: and `\w+`)? \(([^)]*)\)", paragraph)
        assert re.findall(r"`(\w+)`", listed[0]) == list(form._fields), name
    numbers = paragraph.partition("**`unloading`.**")[2].partition("The numbers are")[2]
    places = [numbers.index(f"`{name}`") for name in unloading.Unloading._fields]
    assert places == sorted(places)
