"""Logs that say nothing about their columns: guessed from made motions, and from measured records beside this tree."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from stagectl.config.stage_file import load_stage
from stagectl.problem import ProblemKind
from stagectl.recording.guess.guess import Guess, guess
from stagectl.recording.guess.importing import import_log
from stagectl.recording.hdf5 import RecordingError
from stagectl.recording.scales import Known
from tests.conftest import CONFIG
from tests.problems import refused
from tests.recording import damage

DATA = Path(os.environ.get("STAGECTL_RECORDS", Path(__file__).resolve().parents[3] / "shared" / "data"))
UNKNOWN = Known()
TURN = 2.0 * math.pi


def taken(guessed: Guess) -> dict[str, str]:
    return {part.quantity: f"{part.column}:{part.unit}" for part in guessed.columns}


def written(folder: Path, columns: dict[str, damage.Array], header: str = "") -> Path:
    path = damage.write(folder / "log.csv", columns, header)
    path.write_text(path.read_text().lstrip("\n"))
    return path


@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), ("ms", 1e3), ("us", 1e6)])
@pytest.mark.parametrize(("sign", "column"), [(1.0, "4"), (-1.0, "-4")])
def test_columns_by_physics_alone(tmp_path: Path, unit: str, factor: float, sign: float, column: str) -> None:
    """Time in any unit, then velocity, position and a current of either sign, with no header."""
    made = damage.motion()
    speed = np.gradient(made["position"], made["time"])
    columns = {"t": factor * made["time"], "v": speed, "x": made["position"], "i": sign * made["current"]}
    guessed = guess(written(tmp_path, columns), UNKNOWN)
    assert taken(guessed) == {"time": f"1:{unit}", "position": "3:rad", "current": f"{column}:A"}
    assert next(part for part in guessed.columns if part.quantity == "position").sure < 0.5  # mm with mm/s fit as well


@pytest.mark.parametrize(("unit", "factor"), [("rad", 30.0 / math.pi), ("deg", 1.0 / 6.0), ("rev", 60.0)])
def test_a_speed_in_revolutions_gives_the_position_its_unit(tmp_path: Path, unit: str, factor: float) -> None:
    made = damage.motion()
    columns = {"t": made["time"], "x": made["position"], "n": factor * np.gradient(made["position"], made["time"])}
    path = written(tmp_path, {**columns, "i": made["current"]}, "t,x,motor speed [rpm],i")
    assert taken(guess(path, UNKNOWN))["position"] == f"2:{unit}"


@pytest.mark.parametrize(("speed", "unit", "factor"), [("mm/s", "mm", 1.0), ("m/s", "mm", 1e-3), ("deg/s", "deg", 1.0)])
def test_a_speed_with_a_unit_gives_the_position_its_own(tmp_path: Path, speed: str, unit: str, factor: float) -> None:
    """One without a unit gives none: mm and mm/s fit as rad and rad/s do."""
    made = damage.motion()
    columns = {"t": made["time"], "x": made["position"], "v": factor * np.gradient(made["position"], made["time"])}
    for header, sure in ((f"t,position,velocity [{speed}],current", True), ("t,position,velocity,current", False)):
        guessed = guess(written(tmp_path, {**columns, "i": made["current"]}, header), UNKNOWN)
        part = next(part for part in guessed.columns if part.quantity == "position")
        assert (part.sure > 0.5) == sure and (part.unit == unit or not sure)


@pytest.mark.parametrize(("step", "sure"), [(1.0, 0.9), (0.3, 0.5)])
def test_a_stage_shows_the_unit_by_its_encoder_or_its_travel(tmp_path: Path, step: float, sure: float) -> None:
    """A log that travels 18, in `step` of the encoder's 10 um, of a slider with 100 mm, and of one that is longer."""
    known = UNKNOWN.of_stage(load_stage(CONFIG / "linear-slider.yaml"))
    assert known.axis is not None and known.travel == pytest.approx(0.1)
    known, made, size = known._replace(axis=known.axis._replace(encoder_step=1e-5)), damage.motion(), 0.01 * step
    columns = {"t": made["time"], "x": size * np.rint(made["position"] / size), "i": made["current"]}
    path = written(tmp_path, columns, "time,position,current")
    part = guess(path, known).columns[1]
    assert (part.quantity, part.unit, part.sure) == ("position", "mm", sure)
    assert (guess(path, known._replace(travel=1000.0)).columns[1].sure < 0.5) == (step != 1.0)


DRIVES = {
    "Time, Position, Velocity, Iq, Uq, Vsupply": {"current": "4:A"},
    "t,angle,speed,Uq,iq_meas,vbus": {"current": "5:A"},
    "t,x,omega,torque current,motor voltage,Vd": {"current": "4:A"},
    "t,x,v,i_q,temperature,Id": {"current": "4:A"},
    "t,position,velocity,acceleration,voltage,u_q": {},
}


@pytest.mark.parametrize(("header", "expected"), DRIVES.items())
def test_names_of_the_field_decide_what_is_a_current(tmp_path: Path, header: str, expected: dict[str, str]) -> None:
    """All three go with the motion, and the smoothest of them is none of the current."""
    made = damage.motion()
    speed = np.gradient(made["position"], made["time"])
    drives = {"a": made["current"], "b": made["current"] + 0.3 * speed, "c": 0.5 * made["current"] + 0.1}
    guessed = taken(
        guess(written(tmp_path, {"t": made["time"], "x": made["position"], "v": speed, **drives}, header), UNKNOWN)
    )
    assert {name: where for name, where in guessed.items() if name in ("current", "command")} == expected


def test_a_current_comes_before_a_torque_and_a_command_after_both(tmp_path: Path) -> None:
    """The command is rougher than the torque, and the torque than the current."""
    made, rng = damage.motion(), np.random.default_rng(10)
    command, torque = (made["current"] + rng.normal(0.0, size, 12000) for size in (0.5, 0.2))
    columns = {"t": made["time"], "x": made["position"], "c": command, "m": torque, "i": made["current"]}
    guessed = taken(guess(written(tmp_path, columns, "t,x,torque_command,sensor_torque,motor_current"), UNKNOWN))
    assert guessed["current"] == "5:A" and guessed["command"].startswith("3:")


def test_a_velocity_that_fits_no_position_is_no_current(tmp_path: Path) -> None:
    """The angle was set to zero after its first row, so that the rough velocity beside it is not its derivative."""
    made = damage.motion()
    speed = np.gradient(made["position"], made["time"]) + np.random.default_rng(9).normal(0.0, 2.0, 12000)
    made["position"][0] += 60.0
    columns = {"t": made["time"], "x": made["position"], "v": speed, "i": made["current"]}
    guessed = taken(guess(written(tmp_path, columns, "pi_time,angle,velocity,current"), UNKNOWN))
    assert guessed["current"] == "4:A" and "command" not in guessed


@pytest.mark.parametrize("constant", [0.05, 1.4])
def test_names_say_which_is_the_current_of_a_current_and_its_torque(tmp_path: Path, constant: float) -> None:
    made = damage.motion()
    columns = {"t": made["time"], "x": made["position"], "i": made["current"], "m": constant * made["current"]}
    guessed = guess(written(tmp_path, columns, "t,x,current,torque"), UNKNOWN)
    assert taken(guessed)["current"] == "3:A" and guessed.scales.force_constant == pytest.approx(constant)


def test_a_position_that_is_called_a_target_is_the_reference(tmp_path: Path) -> None:
    """The axis lags behind it, so that the motion alone does not show it."""
    made = damage.motion()
    target = np.roll(made["position"], -120)
    columns = {"t": made["time"], "r": target, "s": target, "x": made["position"], "i": made["current"]}
    path = written(tmp_path, columns, "time,target-position,position-demand,actual-position,current")
    assert taken(guess(path, UNKNOWN)) == {"time": "1:s", "position": "4:rad", "reference": "2:rad", "current": "5:A"}
    ((recording, guessed),) = import_log(path, None, {"position": "4:mm"}, UNKNOWN, unsure=False)
    np.testing.assert_allclose(recording.column("reference"), 1e-3 * target, atol=1e-12)
    assert guessed is not None and taken(guessed)["reference"] == "2:mm"


SINES = [
    ("position [mm]", "v_drive [mm/s]"),
    ("Pos [mm]", "v_act [mm/s]"),
    ("x_act [mm]", "v [mm/s]"),
    ("Weg [mm]", "Geschwindigkeit [mm/s]"),
    ("position [mm]", "v_drive"),
    ("Lage [µm]", "n [inc/s]"),
    ("x [rad]", "n [r/min]"),
    ("s [counts]", "n [counts/s]"),
]


@pytest.mark.parametrize(("position", "velocity"), SINES)
def test_a_header_wins_over_a_way_that_is_an_integral(tmp_path: Path, position: str, velocity: str) -> None:
    """Of a sine each of position and velocity is the integral of the other, and the velocity has the larger numbers."""
    time = np.arange(0.0, 6.0, 1e-3)
    motion = {"t": time, "x": np.sin(5.0 * time), "v": 5.0 * np.cos(5.0 * time), "i": -np.sin(5.0 * time)}
    path = written(tmp_path, motion, f"t [s],{position},{velocity},I [A]")
    part = guess(path, Known(counts=1e3)).columns[1]
    assert (part.quantity, part.column, f"[{part.unit}]") == ("position", "2", position.split()[1].lower())
    assert part.sure >= 0.5


@pytest.mark.parametrize("unit", ["mm/s^2", "A"])
def test_what_is_in_no_unit_of_a_position_is_none(tmp_path: Path, unit: str) -> None:
    made = damage.motion()
    path = written(tmp_path, {"t": made["time"], "x": made["position"], "i": made["current"]}, f"t,y [{unit}],i [A]")
    with refused(RecordingError, kind=ProblemKind.UNIT, value=unit.lower(), column="2"):
        import_log(path, None, None, UNKNOWN, unsure=True)


def test_a_note_on_another_unit_does_not_say_who_has_named_it(tmp_path: Path) -> None:
    made = damage.motion()
    columns = {"t": made["time"], "r": made["position"] + 1e-3, "x": made["position"], "i": made["current"]}
    path = written(tmp_path, columns, "t [s],target [deg],position [rad],i [A]")
    ((recording, _),) = import_log(path, None, None, UNKNOWN, unsure=True)
    (note,) = [note for note in recording.meta["notes"] if note.startswith("target [deg]")]
    assert "--columns" not in note


def test_a_sign_that_little_shows_is_kept_and_asked_for(tmp_path: Path) -> None:
    """Within a loop at one speed, what the motion seems to say of the current is the loop's answer."""
    made = damage.motion()
    rough = np.random.default_rng(8).normal(0.0, 1.0, 24).repeat(500)
    columns = {"t": made["time"], "x": made["position"], "i": rough - 0.1 * made["current"]}
    guessed = guess(written(tmp_path, columns, "t,position [rad],current [A]"), UNKNOWN)
    assert taken(guessed)["current"] == "3:A" and guessed.sure < 0.5


@pytest.mark.parametrize(
    ("step", "unit", "sure"),
    [(13.0, "ms", 0.5), (0.02, "s", 0.5), (0.5, "ms", 0.9), (400.0, "us", 0.9), (1e-5, "s", 0.3)],
)
def test_a_time_is_in_the_unit_in_which_its_rows_show_a_motion(
    tmp_path: Path, step: float, unit: str, sure: float
) -> None:
    made = damage.motion()
    columns = {"time": step * np.arange(12000.0), "x": made["position"], "i": made["current"]}
    time = guess(written(tmp_path, columns, "time,position [rad],current [A]"), UNKNOWN).columns[0]
    assert (time.unit, time.sure) == (unit, sure)


@pytest.mark.parametrize(("unit", "kind"), [("rpm", "rotary"), ("mm/s", "linear")])
def test_the_unit_of_a_named_velocity_tells_the_axis(tmp_path: Path, unit: str, kind: str) -> None:
    made = damage.motion()
    path = written(
        tmp_path, {"t": made["time"], "v": np.gradient(made["position"], made["time"]), "i": made["current"]}
    )
    ((recording, guessed),) = import_log(
        path, None, {"time": "1:s", "velocity": f"2:{unit}", "current": "3:A"}, UNKNOWN, unsure=False
    )
    assert guessed is None and recording.meta["axis"]["kind"] == kind


def test_a_velocity_beside_a_position_is_not_taken_without_a_word(tmp_path: Path) -> None:
    made = damage.motion()
    columns = {"t": made["time"], "x": made["position"], "v": np.gradient(made["position"], made["time"])}
    words = {"time": "1:s", "position": "2:rad", "velocity": "3:rad/s"}
    with refused(RecordingError, kind=ProblemKind.CONFLICT, column="velocity"):
        import_log(written(tmp_path, columns, "t,x,speed"), None, words, UNKNOWN, unsure=False)


WORDS = {"time": "1:s", "position": "2:deg", "current": "3:Nm"}


@pytest.mark.parametrize(
    ("header", "words"),
    [("time_s,position_deg,torque_Nm", None), ("t,x,m", WORDS), ("t,x [deg],torque [Nm]", None)],
)
def test_a_force_constant_is_used_whatever_says_the_unit(
    tmp_path: Path, header: str, words: dict[str, str] | None
) -> None:
    """A header, the user, or a guess; and a nominal.yaml that says another."""
    made = damage.motion()
    path = written(tmp_path, {"t": made["time"], "x": np.degrees(made["position"]), "m": made["current"]}, header)
    for _ in range(2):
        ((recording, _),) = import_log(path, None, words, Known(force_constant=0.5), unsure=True)
        np.testing.assert_allclose(recording.column("measured_current"), 2.0 * made["current"], rtol=1e-9)
        assert recording.meta["nominal"]["stage"]["force_constant"] == 0.5
        (tmp_path / "nominal.yaml").write_text("stage: {kind: rotary, force_constant: 7.0}\n")


def test_a_force_constant_is_used_for_a_matlab_file(tmp_path: Path) -> None:
    made = damage.motion()
    savemat(
        tmp_path / "log.mat", {"time_s": made["time"], "position_rad": made["position"], "torque_Nm": made["current"]}
    )
    ((recording, _),) = import_log(tmp_path / "log.mat", None, None, Known(force_constant=0.5), unsure=False)
    np.testing.assert_allclose(recording.column("measured_current"), 2.0 * made["current"])


def test_counts_are_used_where_a_nominal_file_lacks_them(tmp_path: Path) -> None:
    made = damage.motion()
    path = written(tmp_path, {**made, "position": np.rint(1e3 * made["position"])}, "time_s,position_counts,current_A")
    (tmp_path / "nominal.yaml").write_text("stage: {kind: rotary}\n")
    ((recording, guessed),) = import_log(path, None, None, Known(counts=1e3 * TURN), unsure=False)
    np.testing.assert_allclose(recording.column("measured"), made["position"], atol=6e-4)
    assert guessed is None and recording.meta["axis"]["encoder_step"] == pytest.approx(1e-3)


def test_a_command_comes_before_what_is_measured(tmp_path: Path) -> None:
    """Two columns of one noise level; the measured one is two rows late, and the reference is smoother."""
    made = damage.motion()
    late = np.concatenate([made["current"][:2], made["current"][:-2]]) + np.random.default_rng(4).normal(
        0.0, 0.02, 12000
    )
    reference = made["position"] + 0.01 * np.sin(made["time"])
    rough = made["position"] + np.random.default_rng(5).normal(0.0, 1e-3, 12000)
    columns = {"t": made["time"], "x": rough, "late": late, "r": reference, "i": made["current"]}
    assert taken(guess(written(tmp_path, columns), UNKNOWN)) == {
        "time": "1:s",
        "position": "2:rad",
        "reference": "4:rad",
        "current": "3:A",
        "command": "5:A",
    }


def test_what_is_not_sure_is_asked_for(tmp_path: Path) -> None:
    made = damage.motion()
    columns = {"t": made["time"], "x": np.rint(1e4 * made["position"]), "i": made["current"]}
    path = written(tmp_path, columns)
    with refused(RecordingError, file=path, kind=ProblemKind.VALUE, column="position"):
        import_log(path, None, {"current": "3:A"}, UNKNOWN, unsure=False)
    with refused(RecordingError, file=path, kind=ProblemKind.VALUE, column="current"):
        import_log(path, None, None, Known(counts=1e4 * TURN), unsure=False)
    ((recording, guessed),) = import_log(path, None, {"current": "3:A"}, Known(counts=1e4 * TURN), unsure=False)
    assert guessed is not None and recording.meta["axis"]["encoder_step"] == pytest.approx(1e-4)
    np.testing.assert_allclose(recording.column("measured"), made["position"], atol=1e-4)
    np.testing.assert_allclose(recording.column("measured_current"), made["current"], rtol=1e-9)


def test_a_unit_by_the_length_of_the_travel_is_asked_for(tmp_path: Path) -> None:
    """A header that says position and no unit: 10 may be radians as well as millimetres."""
    made = damage.motion()
    columns = {"t": made["time"], "pos": made["position"], "i": made["current"]}
    path = written(tmp_path, columns, "t,pos,i")
    with pytest.raises(RecordingError, match="no header names its unit") as caught:
        import_log(path, None, None, UNKNOWN, unsure=False)
    assert caught.value.column == "position" and "--yes" in str(caught.value).splitlines()[0]
    ((_, guessed),) = import_log(path, None, None, UNKNOWN, unsure=True)
    assert guessed is not None and taken(guessed)["position"] == "2:rad"
    ((recording, _),) = import_log(path, None, {"position": "pos:mm"}, UNKNOWN, unsure=False)
    assert np.ptp(recording.column("measured")) == pytest.approx(1e-3 * np.ptp(made["position"]), rel=1e-6)


@pytest.mark.parametrize("header", ["time [s],position [furlong],current [A]", "t,Achse 3 (furlong),i"])
@pytest.mark.parametrize("staged", [False, True])
def test_a_unit_that_is_not_known_is_no_missing_one(tmp_path: Path, header: str, staged: bool) -> None:
    """No unit is proposed in its place, those that are known are named, and one that is chosen is taken."""
    made, setup = damage.motion(), load_stage(CONFIG / "ball-screw.yaml") if staged else None
    path = written(tmp_path, {"t": made["time"], "x": made["position"], "i": made["current"]}, header)
    for unsure in (False, True):
        with refused(RecordingError, file=path, kind=ProblemKind.UNIT, column="2", value="furlong") as caught:
            import_log(path, setup, None, UNKNOWN, unsure=unsure)
        assert {"rad", "mm"} <= set(caught.value.problems[0].choices) and "2:rad" not in str(caught.value)
    words = {"time": "1:s", "position": "2:mm", "current": "3:A"}
    assert len(import_log(path, setup, words, UNKNOWN, unsure=False)) == 1
    del words["time"], words["current"]
    assert len(import_log(path, setup, words, UNKNOWN, unsure=True)) == 1


def test_a_current_is_no_position(tmp_path: Path) -> None:
    """A log of time and current alone is refused, until the user says that the column is a position."""
    made = damage.motion()
    path = written(tmp_path, {"t": made["time"], "i": made["current"]}, "time_s,measured_current_A")
    with refused(RecordingError, kind=ProblemKind.MISSING, column="position"):
        guess(path, UNKNOWN)
    (imported,) = import_log(path, None, {"position": "2:mm"}, UNKNOWN, unsure=False)
    assert np.ptp(imported.recording.column("measured")) == pytest.approx(1e-3 * np.ptp(made["current"]), rel=1e-6)


def test_without_a_time_nothing_is_guessed(tmp_path: Path) -> None:
    noise = np.random.default_rng(6).normal(size=(2, 200))
    path = written(tmp_path, {"a": noise[0], "b": noise[1]})
    with refused(RecordingError, file=path, kind=ProblemKind.MISSING, column="time"):
        guess(path, UNKNOWN)


RECORDS = [
    ("odrive/slow2_nocomp_0.mat", {"time": "data[1]:s", "position": "data[2]:counts", "current": "data[3]:A"}),
    (
        "hsm150/idf_pos_0.06_1.mat",
        {"time": "data[1]:s", "position": "data[3]:rad", "current": "data[7]:A", "command": "data[5]:Nm"},
    ),
    ("cnc_y_axis/20220531_Y_Axis_Pulse_9Nm_20ms.csv", {"time": "1:ms", "position": "10:counts", "current": "28:A"}),
    ("linear_servo_loadcell/a3MR.csv", {"time": "1:ms", "velocity": "2:rpm", "current": "3:Nm"}),
    ("linear_servo_loadcell/a3NI.csv", {"time": "1:s", "velocity": "4:rad/s", "current": "2:A"}),
    *(
        (
            f"ur10e_joints/ur-20_01_22-joint_{joint}.csv",
            {"time": "1:s", "position": f"{joint + 1}:rad", "current": f"{joint + 13}:A"},
        )
        for joint in (1, 2, 3, 4, 6)
    ),
]


@pytest.mark.parametrize(("file", "expected"), RECORDS)
def test_measured_records_are_described_as_they_are(file: str, expected: dict[str, str]) -> None:
    if not (DATA / file).is_file():
        pytest.skip(f"the measured record {file} is not beside this repository (../shared/data)")
    ((recording, guessed),) = import_log(DATA / file, None, None, UNKNOWN, unsure=True)
    assert guessed is not None and expected.items() <= taken(guessed).items()
    assert np.all(np.isfinite(recording.column("measured"))) and len(recording.samples) > 300


def test_a_folder_of_measured_records_comes_in_at_once() -> None:
    for folder, count in (("emps", 1), ("odrive", 8), ("hsm150", 6), ("cnc_y_axis", 5)):
        if not (DATA / folder).is_dir():
            pytest.skip(f"the measured records {folder} are not beside this repository (../shared/data)")
        assert len(import_log(DATA / folder, None, None, UNKNOWN, unsure=True)) == count
