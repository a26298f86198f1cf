"""Effects in a stage file: read with their units, simulated, played by the virtual drive, exported, refused."""

from __future__ import annotations

import math
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml

from stagectl.config import patch
from stagectl.config.lengths import Lengths
from stagectl.config.schema import SCHEMAS
from stagectl.config.source import ConfigError
from stagectl.config.stage_file import Setup, load_stage
from stagectl.drives.drive import Power
from stagectl.drives.simulated import Plant, Simulated
from stagectl.kernels import effects, stage
from stagectl.kernels.effects import Harmonic, Step, Warming
from stagectl.kernels.plant import Along, Base, Cable, Dwell, Reported, SpeedPower, Transmission
from stagectl.problem import ProblemKind
from stagectl.recording import nominal_yaml
from stagectl.simulation import noise
from tests.conftest import CONFIG
from tests.problems import refused

RADIAN = 2.0 * math.pi / 12e-3  # rad per m of table travel

ADDED = {
    "force_constant: 0.72 N m/A": """
  cogging: {amplitude: 20 mN m, order: 6, phase: 30 deg}
  cogging_second: {amplitude: 5 mN m, order: 12}
  cogging_third: {amplitude: 3 mN m, order: 18}
  cogging_fourth: {amplitude: 2 mN m, order: 24}
  ripple: {amplitude: 1 %, order: 24}
  ripple_second: {amplitude: 0.5 %, order: 48}
  ripple_third: {amplitude: 0.3 %, order: 4}""",
    "viscous: 0.14 N m s/rad": """
  pitch: 12 mm
  viscous_power: {effort: 10 mN m, speed: 40 rad/s, exponent: 0.67}
  viscous_asymmetry: 5 %
  viscous_warming: {rise: 30 %, time: 10 min}
  viscous_step: {share: 10 %, at: 2 s}
  cable: {stiffness: 10 mN m/rad, centre: 10 mm, hysteresis: 0.05 N m, slip: 3 mm, exponent: 1.2}
  gravity: {amplitude: 50 mN m, phase: 90 deg}
  transmission: {load_share: 40 %, resistance: 1}
  base: {ratio: 0.05, frequency: 20 Hz, damping: 0.02}""".replace(
        "resistance: 1", "resonance: 300 Hz, damping: 3 %, backlash: 2 um, load_friction: 70 %"
    ),
    "elements: 12": """
  stribeck: {rise: 20 %, velocity: 3 mm/s}
  lag: 5 ms
  asymmetry: 5 %
  dwell: {rise: 3 %, time: 0.1 s, length: 4 um}
  load: 2 %
  along: {slope: 0.02 1/rad, bow: 0.001 1/rad^2, centre: 5 mm}
  lead: {amplitude: 5 %}
  lead_second: {amplitude: 2 %, order: 2}
  ball_pass: {amplitude: 3 %, order: 7.3}
  warming: {rise: 10 %, time: 600 s}
  step: {share: -10 %, at: 3 s}""",
    "counts_per_revolution: 1048576": """
  eccentricity: {amplitude: 30 arcsec, phase: 90 deg}
  interpolation: {amplitude: 2 arcsec, order: 2048}
  interpolation_second: {amplitude: 1 arcsec, order: 4096}""",
    "current_limit: 15 A": """
  dead_time: 0.7 ms
  jitter: 20 us
  offset: 20 mA
  gain: -10 %
  gain_asymmetry: 4 %
  directed_offset: 30 mA
  current_damping: 0.7
  continuous_current: 5 A
  foldback_time: 2 s
  voltage_limit: 48 V
  resistance: 1.1 ohm
  back_emf: 0.48 V s/rad
  telemetry: {gain: 1 %, offset: 10 mA, late: 0.2 ms}""",
}
RESIDUAL = """
residual:
  coordinate: displacement_since_reversal
  start: -0.01
  step: 0.01
  values: [-20 mN m, 0 N m, 20 mN m]
"""


def written(folder: Path, added: dict[str, str], tail: str = "") -> Path:
    """Stage A with more lines after some of its own."""
    text = (CONFIG / "ball-screw.yaml").read_text()
    for line, more in added.items():
        assert text.count(line) == 1
        end = text.index("\n", text.index(line))
        text = text[:end] + more + text[end:]
    path = folder / "stage.yaml"
    path.write_text(text + tail)
    return path


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("effects"), ADDED, RESIDUAL)


@pytest.fixture(scope="module")
def setup(path: Path) -> Setup:
    return load_stage(path, designed=False)


def test_every_effect_is_read_with_its_unit(setup: Setup) -> None:
    p, arcsec, turn = setup.stage, math.pi / 648000.0, 2.0 * math.pi
    values = {**p.motor._asdict(), **p.mechanics._asdict(), **p.friction._asdict(), **p.drive._asdict()}
    expected = {
        "cogging": Harmonic(0.02, 6.0, math.pi / 6.0),
        "cogging_second": Harmonic(0.005, 12.0, 0.0),
        "cogging_third": Harmonic(0.003, 18.0, 0.0),
        "cogging_fourth": Harmonic(0.002, 24.0, 0.0),
        "gravity": Harmonic(0.05, 1.0, math.pi / 2.0),
        "ripple": Harmonic(0.01, 24.0, 0.0),
        "ripple_second": Harmonic(0.005, 48.0, 0.0),
        "ripple_third": Harmonic(0.003, 4.0, 0.0),
        "viscous_warming": Warming(0.3, 600.0),
        "viscous_step": Step(0.1, 2.0),
        "cable": Cable(0.01, 10e-3 * RADIAN, 0.05, 3e-3 * RADIAN, 1.2),
        "transmission": Transmission(0.4, 300.0, 0.03, 2e-6 * RADIAN, 0.7),
        "viscous_power": SpeedPower(0.01, 40.0, 0.67),
        "base": Base(0.05, 20.0, 0.02),
        "dwell": Dwell(0.03, 0.1, 4e-6 * RADIAN),
        "along": Along(0.02, 0.001, 5e-3 * RADIAN),
        "lead": Harmonic(0.05, 1.0, 0.0),
        "lead_second": Harmonic(0.02, 2.0, 0.0),
        "ball_pass": Harmonic(0.03, 7.3, 0.0),
        "warming": Warming(0.1, 600.0),
        "step": Step(-0.1, 3.0),
        "telemetry": Reported(0.01, 0.01, 2e-4),
    }
    for name, value in expected.items():
        assert tuple(values[name]) == pytest.approx(tuple(value), rel=1e-12), name
    numbers = {"pitch": turn, "viscous_asymmetry": 0.05, "lag": 5e-3, "load": 0.02}
    numbers |= {"asymmetry": 0.05, "dead_time": 7e-4, "jitter": 2e-5, "offset": 0.02, "continuous_current": 5.0}
    numbers |= {"foldback_time": 2.0, "voltage_limit": 48.0, "resistance": 1.1, "back_emf": 0.48}
    numbers |= {"gain": -0.1, "gain_asymmetry": 0.04, "directed_offset": 0.03, "current_damping": 0.7}
    assert {name: values[name] for name in numbers} == pytest.approx(numbers, rel=1e-12)
    assert tuple(p.encoder.eccentricity) == pytest.approx((30 * arcsec, 1.0, math.pi / 2.0))
    assert tuple(p.encoder.interpolation) == pytest.approx((2 * arcsec, 2048.0, 0.0))
    assert tuple(p.encoder.interpolation_second) == pytest.approx((arcsec, 4096.0, 0.0))
    assert p.residual[:3] == (effects.SINCE_REVERSAL, -0.01, 0.01)
    assert list(p.residual.values) == [-0.02, 0.0, 0.02]


def test_no_effect_of_the_plant_is_out_of_reach(setup: Setup) -> None:
    """Each field of the kernels' blocks differs from its default here: a new one has to be given a way in."""
    for block in (
        setup.stage.drive,
        setup.stage.motor,
        setup.stage.mechanics,
        setup.stage.friction,
        setup.stage.encoder,
    ):
        same = [name for name, value in block._field_defaults.items() if getattr(block, name) is value]
        assert set(same) <= {"bias", "pitch", "bristle"}


def test_an_editor_takes_it(path: Path) -> None:
    validator = jsonschema.Draft202012Validator(SCHEMAS["stage"]())
    assert [error.message for error in validator.iter_errors(yaml.safe_load(path.read_text()))] == []


def test_a_patch_writes_effects_in_their_units() -> None:
    values = {"motor.cogging.amplitude": 0.0123, "mechanics.cable.slip": 0.5, "encoder.eccentricity.amplitude": 1e-4}
    text = patch.patched((CONFIG / "ball-screw.yaml").read_text(), values, Lengths("rotary", 0.012)).text
    assert "amplitude: 0.0123 N m" in text
    root = yaml.safe_load(text)
    assert root["mechanics"]["cable"]["slip"] == "954.9296585513721 um"  # 0.5 rad to the last bit
    assert root["encoder"]["eccentricity"]["amplitude"].split()[1] in ("um", "nm", "rad")


def test_the_virtual_drive_plays_what_simulate_plays(setup: Setup) -> None:
    """Position and reported current, bit for bit, jitter and noise included."""
    simulation = setup.file.simulation._replace(current_noise=0.02, encoder_noise=1e-6)
    virtual, p = Simulated(Plant(setup.stage, simulation, setup.dt)), setup.stage
    rows, x = noise(simulation, 60, p.drive.jitter), stage.at_reading(p, 0.0)
    assert rows[:, 2].std() == pytest.approx(2e-5, rel=0.4)
    virtual.ask(Power.ON)
    virtual.sample()
    for k, row in enumerate(rows.tolist()):
        heard, now = stage.Noise(*row), virtual.sample()
        assert (now.position, now.current) == (
            stage.measured(p.encoder, x, heard if k else stage.SILENT) if k else now.position,
            stage.reported(p.drive, x, setup.dt),
        )
        virtual.apply(3.0)
        x = stage.period(p, x, 3.0, heard, setup.dt, simulation.substeps)
    assert x.velocity > 1.0


def test_without_jitter_the_noise_is_that_of_always(setup: Setup) -> None:
    simulation = setup.file.simulation._replace(current_noise=0.02, encoder_noise=1e-6)
    assert np.all(noise(simulation, 50)[:, 2] == 0.0)
    drawn, other = noise(simulation, 1, 1e-5), noise(simulation, 1)
    assert np.array_equal(drawn[0, :2], other[0, :2])


def test_nominal_loses_none_of_them(setup: Setup) -> None:
    effects, drive = nominal_yaml.effects_of(setup.file), nominal_yaml._drive(setup.file)
    given = yaml.safe_load("\n".join(f"{line.split(':')[0]}:{more}" for line, more in ADDED.items()))
    assert set(effects["motor"]) == set(setup.stage.motor._fields[1:])
    assert set(effects["mechanics"]) == set(setup.stage.mechanics._fields[4:])
    assert set(effects["friction"]) == set(setup.stage.friction._fields[3:])
    assert set(effects["encoder"]) == set(given["counts_per_revolution"])
    assert set(effects["drive"]) | {"voltage_limit", "resistance", "back_emf"} == set(given["current_limit"])
    assert (drive["voltage_limit_V"], drive["resistance_ohm"], drive["back_emf_V_per_unit_s"]) == (48.0, 1.1, 0.48)
    assert effects["residual"]["values"] == [-0.02, 0.0, 0.02]
    assert yaml.safe_load(yaml.safe_dump(effects)) == effects
    assert nominal_yaml.effects_of(load_stage(CONFIG / "ball-screw.yaml").file) == {}


def test_periods_of_the_encoder_that_are_stated_without_an_error_are_in_nominal(tmp_path: Path) -> None:
    """A diagnosis looks for the error where they are known."""
    stated = load_stage(written(tmp_path, {"counts_per_revolution: 1048576": "\n  interpolation: {order: 2048}"}))
    axis = {"kind": "rotary", "travel_unit": "m", "travel_per_unit": 1.9e-3, "encoder_step": 6e-6}
    assert nominal_yaml._stage(stated.file, axis)["encoder_periods_per_pitch"] == 2048.0
    plain = load_stage(CONFIG / "ball-screw.yaml")
    assert nominal_yaml._stage(plain.file, axis).get("encoder_periods_per_pitch") is None


RANGE, CONFLICT = ProblemKind.RANGE, ProblemKind.CONFLICT
REFUSED: list[tuple[str, str, dict[str, object]]] = [
    (
        "current_limit: 15 A",
        "dead_time: 3.2 ms",
        {"kind": CONFLICT, "key": "drive.dead_time", "interval": "[0, 0.003]"},
    ),
    (
        "current_limit: 15 A",
        "gain: -0.5\n  gain_asymmetry: -0.5",
        {"kind": CONFLICT, "key": "drive.gain_asymmetry", "interval": "(-0.5, 0.5)"},
    ),
    ("current_limit: 15 A", "continuous_current: 15 A", {"kind": CONFLICT, "key": "drive.continuous_current"}),
    ("limits:", "continuous_current: 15 A", {"kind": CONFLICT, "key": "limits.continuous_current"}),
    ("current_limit: 15 A", "telemetry: {late: 0.6 ms}", {"key": "drive.telemetry.late", "interval": "[0, 0.0005]"}),
    ("elements: 12", "asymmetry: 110 %", {"kind": RANGE, "key": "friction.asymmetry", "interval": "[-1, 1]"}),
    ("viscous: 0.14 N m s/rad", "transmission: {backlash: 1 um}", {"kind": CONFLICT, "key": "mechanics.transmission"}),
    ("force_constant: 0.72 N m/A", "cogging: {amplitude: 3 mm}", {"key": "motor.cogging.amplitude", "unit": "N m"}),
]


@pytest.mark.parametrize(("line", "more", "fields"), REFUSED, ids=[more for _, more, _ in REFUSED])
def test_what_cannot_be_is_refused(tmp_path: Path, line: str, more: str, fields: dict[str, object]) -> None:
    with refused(ConfigError, **fields):
        load_stage(written(tmp_path, {line: f"\n  {more}"}))


def test_a_residual_over_nothing_known_is_refused(tmp_path: Path) -> None:
    with refused(ConfigError, kind=ProblemKind.VALUE, key="residual.coordinate", value="torque"):
        load_stage(written(tmp_path, {}, RESIDUAL.replace("displacement_since_reversal", "torque")))


def test_a_linear_axis_repeats_only_over_a_pitch_that_is_given(tmp_path: Path) -> None:
    """A rotary one repeats after a turn."""
    table = RESIDUAL.replace("displacement_since_reversal", "position_mod_pitch")
    assert load_stage(written(tmp_path, {}, table)).stage.residual.coordinate == effects.COORDINATES.index(
        "position_mod_pitch"
    )
    text = (CONFIG / "linear-slider.yaml").read_text() + table.replace("N m", "N").replace("mN", "N")
    drives = tmp_path / "drives"
    drives.symlink_to(CONFIG / "drives")
    path = tmp_path / "slider.yaml"
    path.write_text(text)
    with refused(ConfigError, kind=ProblemKind.CONFLICT, key="residual.coordinate", value="position_mod_pitch"):
        load_stage(path)
    path.write_text(text.replace("inertia: 6 kg", "inertia: 6 kg\n  pitch: 24 mm"))
    assert load_stage(path).stage.mechanics.pitch == pytest.approx(0.024)
