"""A fine ripple of a screw, a few per cent of what a wrong friction leaves: found by its line over the position."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import stagectl as sc
from stagectl.config.stage_file import load_stage
from stagectl.gap.logs.load_session import load
from stagectl.gap.residuals.pitch_orders import Lines
from stagectl.gap.result.diagnosis import DiagnosisResult, FoundEffect
from stagectl.gap.selection import refine, waves
from tests.conftest import CONFIG
from tests.gap.drawn import diagnosed

PERIOD = 2.5e-3  # m, of the ripple
FRICTION = """\
  law: rolling
  coulomb: 20.3935 N
  elements: 12
  shortest: 1 um                   # chosen: rolling, presliding at 39 Hz
  longest: 30 um
"""
OTHER = "  law: dahl\n  coulomb: 27 N\n  range: 50 um\n  exponent: 1\n"
SPEEDS = (45, 85, 125)  # mm/s


def _wave(name: str, amplitude: float, period: float) -> str:
    return f"\n  {name}: {{amplitude: {amplitude} N, order: {2.0 * math.pi / period}, phase: 20 deg}}"


def _answer(folder: Path, ripple: str) -> DiagnosisResult:
    """What is said of a machine with another friction and a `ripple`, by the model of `config/emps.yaml`."""
    text = (CONFIG / "emps.yaml").read_text()
    motor = f"force_constant: 35.1507 N/A{ripple}"
    assert FRICTION in text
    return _of_machine(
        folder, "emps", text.replace("force_constant: 35.1507 N/A", motor).replace(FRICTION, OTHER), "m", 200
    )


def _of_machine(folder: Path, stage: str, machine: str, unit: str, way: int) -> DiagnosisResult:
    """What is said of a simulated `machine` (text of a stage file) by the model of the configuration `stage`.

    It goes a `way` (mm) to and fro at three speeds.
    """
    nominal, plant, strokes = CONFIG / f"{stage}.yaml", folder / "plant.yaml", folder / "strokes.yaml"
    plant.write_text(machine.replace("eds: drives/", f"eds: {CONFIG / 'drives'}/"))
    stroke = f"  - {{type: trapezoid, distance: {way} mm, acceleration: 0.8 m/s^2, velocity: "
    strokes.write_text("type: sequence\nparts:\n" + "".join(f"{stroke}{speed} mm/s}}\n" for speed in SPEEDS))
    ran = sc.simulate(nominal, strokes, plant=plant)
    names = {"time": "time_s", "reference": f"reference_{unit}", "command": "command_A", "measured": f"position_{unit}"}
    rows = np.column_stack([ran[name] for name in names])
    np.savetxt(folder / "log.csv", rows, delimiter=",", header=",".join(names.values()), comments="", fmt="%.10g")
    return diagnosed(load([folder / "log.csv"], load_stage(nominal)))


def _named(result: DiagnosisResult) -> dict[str, FoundEffect]:
    return {effect.name: effect for effect in result.named}


def test_a_fine_ripple_is_named_by_its_line(tmp_path: Path) -> None:
    cogging = _named(_answer(tmp_path, _wave("cogging", 1.0, PERIOD)))["cogging"]
    assert 2.0 * math.pi / cogging.parameters["order"].value == pytest.approx(PERIOD, rel=0.003)
    assert dict(cogging.fields)["motor.cogging.amplitude"] == pytest.approx(1.0, abs=0.15)


def test_a_period_of_nearly_a_quarter_of_the_travel_is_found_and_fitted(tmp_path: Path) -> None:
    """Without a pitch; the travel tells periods of 48 and 60 mm apart."""
    cogging = _named(_answer(tmp_path, _wave("cogging", 3.0, 48e-3)))["cogging"].parameters
    assert cogging["amplitude"].value == pytest.approx(3.0, rel=0.1)
    assert 47e-3 < cogging["period"].low < 48e-3 < cogging["period"].high < 49e-3


@pytest.mark.parametrize("multiple", [2, 6])
def test_a_motor_whose_teeth_show_beside_its_poles(multiple: int, tmp_path: Path) -> None:
    """Poles of 24 mm, and two or six teeth on them: one effect, whatever the multiple."""
    ripple = _wave("cogging", 3.0, 24e-3) + _wave("cogging_second", 1.5, 24e-3 / multiple)
    result = _answer(tmp_path, ripple)
    values = {name: value.value for name, value in _named(result)["cogging_map"].parameters.items()}
    assert result.unknown is None
    assert values["period"] == pytest.approx(24e-3, rel=0.003) and values["multiple_2"] == multiple
    assert [values["amplitude_1"], values["amplitude_2"]] == pytest.approx([3.0, 1.5], rel=0.1)


def test_another_friction_alone_has_no_ripple(tmp_path: Path) -> None:
    assert not {"cogging", "cogging_map"} & set(_named(_answer(tmp_path, "")))


SCREW = """\
  law: rolling                     # 12 equal stop operators; a full reversal is 95 % done in 15 um
  coulomb: 1.0 N m
  elements: 12
  shortest: 0.3 um
  longest: 9 um
"""
RUBBING = """\
  law: lugre
  coulomb: 1.1 N m
  range: 12 um
  damping: 0.1 N m s/rad
  stribeck: {rise: 0.3, velocity: 0.4 rad/s}
"""


def test_a_ripple_of_what_the_current_gives_is_named_by_its_lines(tmp_path: Path) -> None:
    """Next to an unknown Stribeck friction it is too little for the evidence of all that is missing.

    Its second harmonic is a part of it, and no pass of balls.
    """
    ripples = "".join(
        f"\n  {place}: {{amplitude: {size}, order: {order}, phase: 60 deg}}"
        for place, size, order in (("ripple", 0.012, 24), ("ripple_second", 0.008, 40))
    )
    text = (CONFIG / "ball-screw.yaml").read_text().replace("N m/A", f"N m/A{ripples}").replace(SCREW, RUBBING)
    named = _named(_of_machine(tmp_path, "ball-screw", text, "rad", 40))
    ripple = named["current_ripple"]
    assert ripple.probability > 0.9 and ripple.parameters["order"].value == 24.0
    fields = dict(ripple.fields)
    assert fields["motor.ripple.amplitude"] == pytest.approx(0.012, rel=0.2)
    assert fields["motor.ripple_second.amplitude"] == pytest.approx(0.008, rel=0.2)
    assert fields["motor.ripple_second.order"] == pytest.approx(40.0)
    assert not {"ball_pass_ripple", "cogging", "cogging_map"} & set(named)


@pytest.mark.parametrize(
    ("cogging", "encoder", "expected"), [(300.0, 200.0, waves.ENCODER), (200.0, 300.0, waves.SINGLE)]
)
def test_an_encoder_that_is_off_centre_is_told_from_a_cogging_by_the_fit(
    cogging: float, encoder: float, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both make a line at one period a turn; what a fit of each leaves is given."""
    left = {waves.SINGLE: cogging, waves.ENCODER: encoder}
    effects = {name: SimpleNamespace(name=name) for name in left}
    forms = [
        SimpleNamespace(effect=effect, shape={"order": 1.0}, typical=(1.0,), values=lambda _: {"order": 1.0})
        for effect in effects.values()
    ]

    def refined(_: Any, __: Any, kept: Any) -> Any:
        return SimpleNamespace(effects=tuple(kept), residual_sum_of_squares=left[kept[-1].effect.name])

    def lines(_: Any, now: Any, __: str) -> Lines:
        high = 1.0 if now.effects else 1000.0
        return Lines(np.array([0.5, 1.0, 1.5]), np.array([1.0, high, 1.0]), np.array([1.0, high, 1.0]), 0.2)

    monkeypatch.setattr(waves, "_lines", lines)
    monkeypatch.setattr(refine, "refine", refined)
    now: Any = SimpleNamespace(effects=(), model=None, residual_sum_of_squares=1000.0)
    after = waves.with_wave(cast("Any", None), cast("Any", SimpleNamespace(forms=forms)), now)
    assert after is not None and [valued.effect.name for valued in after.effects] == [expected]


def test_a_line_between_two_orders_of_the_grid() -> None:
    """The vertex of the parabola through the logarithms of three powers; a whole order where one is as near."""
    orders = np.linspace(100.0, 102.0, 9)
    power = np.exp(-6.25 * (orders - 100.9) ** 2)
    assert Lines(orders, power, power, 0.6).highest() == pytest.approx(100.9)
    assert Lines(orders, power, power, 0.3).highest() == 101.0
