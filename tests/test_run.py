"""End to end, through real processes: virtual drive, loop, recorder, over the embedded bus."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stagectl as sc
from stagectl.kernels import law
from stagectl.recording.constants import BLOCK
from stagectl.recording.hdf5 import RecordingError, open_recording, repair
from stagectl.recording.replay import replay
from tests.conftest import CONFIG, ROOT, movable

STAGE = CONFIG / "ball-screw.yaml"
SINE = CONFIG / "trajectories" / "sine-3.2hz.yaml"


def stagectl(*words: object, **options: Any) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "stagectl", *map(str, words)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, **options)


@contextlib.contextmanager
def drive(stage: Path, channel: Path) -> Iterator[subprocess.Popen[str]]:
    """A virtual drive of its own; its lines can be read from `stdout`."""
    command = [sys.executable, "-m", "stagectl", "virtual-drive", str(stage), "--channel", str(channel)]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline().startswith("virtual drive of ball-screw stage A")
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.communicate(timeout=120)  # it ends when its axis has no power
        except subprocess.TimeoutExpired:
            process.kill()
            raise


def test_run_over_the_bus_gives_what_simulate_gives(tmp_path: Path) -> None:
    """To the encoder count, late cycles or not, in a second run on the same drive, too; and replay agrees."""
    simulated = stagectl("simulate", STAGE, SINE, "-o", tmp_path / "s.h5", "--json", "-")
    assert simulated.returncode == 0, simulated.stderr
    expected = open_recording(tmp_path / "s.h5").samples
    with drive(STAGE, tmp_path / "bus") as other:
        second = stagectl("virtual-drive", STAGE, "--channel", tmp_path / "bus")
        assert second.returncode == 2 and "a drive is there already" in second.stderr  # one a bus
        for name in ("first.h5", "second.h5"):
            done = stagectl("run", STAGE, SINE, "--channel", tmp_path / "bus", "-o", tmp_path / name, "--json", "-")
            assert done.returncode == 0, done.stderr
            assert f"process {other.pid}" in done.stderr  # whose machine it is, which may not be the stage file's
            recording = open_recording(tmp_path / name)
            assert recording.complete
            assert recording.ended == "complete"
            assert recording.lost_rows == 0
            for column in ("measured", *law.Setpoint._fields, *law.Output._fields):
                assert np.array_equal(recording.samples[column], expected[column]), column
    result, pretended = json.loads(done.stdout), json.loads(simulated.stdout)
    assert result["tracking_error"] == pretended["tracking_error"]
    assert 5e-9 < result["tracking_error"]["peak"] < 3e-8
    assert (result["nd"], result["cycles"], result["steady"]) == (1, len(expected), [0.3125, 1.5625])
    assert result["recording"] == str(tmp_path / "second.h5")
    assert replay(recording)["identical"]


def test_a_biased_axis_runs_as_it_simulates(tmp_path: Path) -> None:
    """EMPS: linear, 1 kHz, a constant force on the axis; and a name that looks like markup."""
    stage, move = tmp_path / "stage.yaml", tmp_path / "move.yaml"
    text = movable((CONFIG / "emps.yaml").read_text())
    stage.write_text(re.sub(r"(?m)^name: .*", "name: 'a [/b] stage'", text))
    move.write_text("{type: s_curve, distance: 20 mm, velocity: 80 mm/s, acceleration: 0.5 m/s^2, jerk: 20 m/s^3}")
    done = stagectl("run", stage, move, "--channel", tmp_path / "bus", "-o", tmp_path / "r.h5")
    assert done.returncode == 0, done.stderr
    assert "a [/b] stage" in done.stderr
    sc.simulate(stage, move).save(tmp_path / "s.h5")
    ran, simulated = (open_recording(tmp_path / name).samples for name in ("r.h5", "s.h5"))
    assert np.array_equal(ran["measured"], simulated["measured"])


def test_an_experiment_in_a_cascade_runs_as_it_simulates(tmp_path: Path) -> None:
    """A motion with a current injected, on the slider; the loop opens at its end, and the axis springs back."""
    stage, move = tmp_path / "stage.yaml", tmp_path / "move.yaml"
    stage.write_text(movable((CONFIG / "linear-slider.yaml").read_text()))
    motion = "{type: trapezoid, distance: 1 mm, velocity: 10 mm/s, acceleration: 0.1 m/s^2, one_way: true}"
    experiments = {
        "excited": f"current: {{type: current_sine, amplitude: 100 mA, frequency: 40 Hz, periods: 6}}\n"
        f"motion: {motion}",
        "release": f"watch: 0.1 s\nmotion: {motion}",
    }
    for name, text in experiments.items():
        move.write_text(f"type: {name}\n{text}\n")
        done = stagectl("run", stage, move, "--channel", tmp_path / "bus", "-o", tmp_path / f"{name}-r.h5")
        assert done.returncode == 0, done.stderr
        sc.simulate(stage, move).save(tmp_path / f"{name}-s.h5")
        ran, simulated = (open_recording(tmp_path / f"{name}-{kind}.h5") for kind in "rs")
        for column in ("measured", *law.Setpoint._fields, *law.Output._fields):
            assert np.array_equal(ran.samples[column], simulated.samples[column]), column
        assert replay(ran)["identical"]
    assert simulated.samples["closed"][-1] == 0.0
    assert np.ptp(simulated.samples["measured"][simulated.samples["closed"] == 0.0]) > 5e-6


def test_no_delay_can_be_simulated_but_not_run(tmp_path: Path) -> None:
    stage = tmp_path / "stage.yaml"
    stage.write_text(STAGE.read_text().replace("delay_samples: 1 ", "delay_samples: 0 "))
    simulated = stagectl("simulate", stage, SINE, "--without", "friction", "--json", "-", "-o", tmp_path / "s.h5")
    assert json.loads(simulated.stdout)["nd"] == 0
    assert 4.9e-6 < json.loads(simulated.stdout)["tracking_error"]["peak"] < 5.6e-6
    refused = stagectl("run", stage, SINE, "--channel", tmp_path / "bus", "-o", tmp_path / "r.h5")
    assert refused.returncode == 2
    assert "drive.delay_samples = 0; over CAN" in refused.stderr
    assert not (tmp_path / "r.h5").exists()


def test_replay_notices_a_changed_position_and_a_changed_law(tmp_path: Path) -> None:
    sc.simulate(STAGE, CONFIG / "trajectories" / "sine-2um.yaml").save(tmp_path / "s.h5")
    recording = open_recording(tmp_path / "s.h5")
    assert replay(recording)["identical"]
    recording.samples["measured"][1000] += 6e-6
    comparison = replay(recording)
    assert not comparison["identical"]
    assert "the first at 0.5 s in error" in comparison["words"]
    recording.samples["measured"][1000] -= 6e-6
    recording.meta["law"]["feedback"]["proportional"] *= 1.0 + 1e-15
    assert not replay(recording)["identical"]


@pytest.mark.parametrize("file", ["ball-screw.yaml", "linear-slider.yaml"])
def test_replay_begins_with_what_held_the_axis(file: str, tmp_path: Path) -> None:
    """A weight that its friction does not carry; PID and cascade."""
    text = movable((CONFIG / file).read_text())
    stage, bias = tmp_path / "stage.yaml", "-2 N m" if "rotary" in text else "-20 N"
    stage.write_text(re.sub(r"(?m)^mechanics:$", f"mechanics:\n  bias: {bias}", text))
    sc.simulate(stage, CONFIG / "trajectories" / "sine-2um.yaml").save(tmp_path / "s.h5")
    recording = open_recording(tmp_path / "s.h5")
    assert abs(recording.samples["current"][0]) > 0.5
    assert np.abs(recording.samples["error"]).max() < 2e-5
    assert replay(recording)["identical"]


def start_moving(channel: Path, path: Path) -> subprocess.Popen[bytes]:
    """``stagectl run`` in a process group of its own, well into its motion."""
    command = [sys.executable, "-m", "stagectl", "run", str(STAGE), str(CONFIG / "trajectories" / "sine-0.8hz.yaml")]
    command += ["--channel", str(channel), "-o", str(path)]
    process = subprocess.Popen(command, cwd=ROOT, start_new_session=True, stderr=subprocess.DEVNULL)
    end = time.monotonic() + 60.0  # the machine is shared; a run that has ended is not waited for
    while time.monotonic() < end and process.poll() is None:
        with contextlib.suppress(Exception):
            if len(open_recording(path).samples) > BLOCK:
                return process
        time.sleep(0.05)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    raise AssertionError(f"the motion did not start: exit {process.wait(timeout=10)}")


def members(group: int) -> dict[str, int]:
    """Processes of a group by the module they run."""
    processes = {}
    for entry in Path("/proc").iterdir():
        with contextlib.suppress(OSError, ValueError):
            words = (entry / "cmdline").read_bytes().split(b"\0")
            if os.getpgid(int(entry.name)) == group and b"-m" in words:
                processes[words[words.index(b"-m") + 1].decode()] = int(entry.name)
    return processes


def rows(path: Path) -> int:
    """How many there are; none as long as the file is being made."""
    try:
        return len(open_recording(path).samples)
    except RecordingError as error:
        if "unable to lock" in str(error):
            return 0
        raise


def is_lean(loop: int) -> bool:
    """No other thread, and no heavy module."""
    mapped = Path(f"/proc/{loop}/maps").read_text()
    heavy = [name for name in ("numba", "llvmlite", "scipy", "matplotlib", "h5py") if f"/{name}/" in mapped]
    return not heavy and len(list(Path(f"/proc/{loop}/task").iterdir())) == 1


@pytest.mark.parametrize("victim", ["stagectl.realtime.axes", "everything"])
def test_kill_the_controller_in_mid_motion(tmp_path: Path, victim: str) -> None:
    """The drive stops by itself within its time-out; the recording lacks at most its last block."""
    with drive(STAGE, tmp_path / "bus") as virtual:
        run = start_moving(tmp_path / "bus", tmp_path / "killed.h5")
        modules = members(run.pid)
        assert is_lean(modules["stagectl.realtime.axes"])
        rows = len(open_recording(tmp_path / "killed.h5").samples)
        assert not repair(tmp_path / "killed.h5")  # its writer is alive: left alone
        if victim == "everything":
            os.killpg(run.pid, signal.SIGKILL)
        else:
            os.kill(modules[victim], signal.SIGKILL)
        run.wait(timeout=60)
        assert virtual.stdout is not None
        lost, stands = virtual.stdout.readline(), virtual.stdout.readline()
    partner = r"no (heartbeat|cyclic command \(RPDO\)) from the controller"
    silent = re.fullmatch(partner + r" for (\d+) ms \(time-out 5000 ms\): quick stop\n", lost)
    assert silent is not None, lost
    assert 5000 <= int(silent[2]) < 8000  # the machine is shared
    stopped = re.fullmatch(r"stands after (\d+) ms and (-?[\d.]+) ([mµn]m)\n", stands)
    assert stopped is not None, stands
    assert 0 < int(stopped[1]) < 100  # 50 mm/s at 5 m/s^2: 10 ms, and the velocity loop's own time
    recording = open_recording(tmp_path / "killed.h5")
    assert len(recording.samples) >= rows
    assert np.array_equal(np.rint(recording.samples["time"] / 5e-4), np.arange(len(recording.samples)))
    if victim == "everything":
        assert not recording.complete
        assert repair(tmp_path / "killed.h5")
        assert open_recording(tmp_path / "killed.h5").samples.tobytes() == recording.samples.tobytes()
    else:
        assert recording.ended == "the loop process died"


@pytest.fixture(scope="module")
def bus(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The channel of a virtual drive that outlasts its controllers."""
    channel = tmp_path_factory.mktemp("drive") / "bus"
    with drive(STAGE, channel):
        yield channel


@pytest.mark.parametrize(
    ("tell", "number"),
    [(os.kill, signal.SIGINT), (os.kill, signal.SIGTERM), (os.killpg, signal.SIGHUP), (os.killpg, signal.SIGINT)],
)
def test_a_signal_stops_the_axis_and_keeps_the_recording(
    bus: Path, tmp_path: Path, tell: Callable[[int, int], None], number: int
) -> None:
    """Of the command alone, or, as a terminal does, of all its processes.

    A shell's background process ignores SIGINT, and Python then raises no KeyboardInterrupt.
    """
    before = signal.signal(signal.SIGINT, signal.SIG_IGN if tell is os.kill else signal.SIG_DFL)
    hung_up = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # also where the tests run under `nohup`
    try:
        run = start_moving(bus, tmp_path / "told.h5")
        tell(run.pid, number)
        assert run.wait(timeout=60) == 130
    finally:
        signal.signal(signal.SIGINT, before)
        signal.signal(signal.SIGHUP, hung_up)
    recording = open_recording(tmp_path / "told.h5")
    assert recording.complete and recording.samples["fault"][-1] in (0, 14)


def test_when_only_the_command_dies_the_loop_stops_the_axis(tmp_path: Path) -> None:
    """kill -9 of `stagectl run` itself: its loop must not go on unattended."""
    with drive(STAGE, tmp_path / "bus") as virtual:
        run = start_moving(tmp_path / "bus", tmp_path / "orphaned.h5")
        os.kill(run.pid, signal.SIGKILL)
        run.wait(timeout=60)
        assert virtual.stdout is not None
        assert virtual.stdout.readline().startswith("stands after ")
    end = time.monotonic() + 60.0  # the machine is shared
    while time.monotonic() < end and not open_recording(tmp_path / "orphaned.h5").complete:
        time.sleep(0.05)
    recording = open_recording(tmp_path / "orphaned.h5")
    assert recording.ended == "complete"
    assert len(recording.samples) < 10000
    assert replay(recording)["identical"]


def test_a_lost_recorder_does_not_stop_the_axis_but_is_told(tmp_path: Path) -> None:
    with drive(STAGE, tmp_path / "bus"):
        words = ["run", STAGE, SINE, "--channel", tmp_path / "bus", "-o", tmp_path / "lost.h5", "--json", "-"]
        command = [sys.executable, "-m", "stagectl", *map(str, words)]
        pipes: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
        run = subprocess.Popen(command, cwd=ROOT, **pipes)
        while "stagectl.recording.recorder" not in members(run.pid) or not (tmp_path / "lost.h5").exists():
            time.sleep(0.02)
        while not rows(tmp_path / "lost.h5"):  # a late start is made up for: what moves is over soon
            time.sleep(0.005)
        os.kill(members(run.pid)["stagectl.recording.recorder"], signal.SIGKILL)
        out, err = run.communicate(timeout=120)
    assert run.returncode == 1
    assert "the recorder stopped before the motion did" in err
    result = json.loads(out)
    assert result["fault"] == "the recorder stopped before the motion did"
    assert result["cycles"] == 3950  # the axis went its way
    assert result["tracking_error"]["peak"] is None


def test_noise_is_the_same_noise(tmp_path: Path) -> None:
    stage, move = tmp_path / "stage.yaml", tmp_path / "move.yaml"
    noisy = "simulation:\n  current_noise: 45 mA\n  encoder_noise: 20 nm"
    stage.write_text(movable(STAGE.read_text()).replace("simulation:", noisy))
    move.write_text("{type: sine, amplitude: 1 mm, frequency: 3.2 Hz, periods: 1}")
    sc.simulate(stage, move).save(tmp_path / "s.h5")
    assert stagectl("run", stage, move, "--channel", tmp_path / "bus", "-o", tmp_path / "r.h5").returncode == 0
    ran, simulated = (open_recording(tmp_path / name).samples for name in ("r.h5", "s.h5"))
    assert np.array_equal(ran["measured"], simulated["measured"])
    assert np.std(simulated["error"]) > 1e-5  # there is noise


def with_effects(folder: Path) -> Path:
    """The stage with effects of the friction, of the motor over its angle, and of a cable."""
    effects = {
        "  viscous: 0.14 N m s/rad\n": "  viscous_asymmetry: 0.2\n"
        "  cable: {stiffness: 2e-3 N m/rad, hysteresis: 0.05 N m, slip: 4 mm}\n",
        "  force_constant: 0.72 N m/A\n": "  cogging: {amplitude: 0.03 N m, order: 4, phase: 0.4 rad}\n",
    }
    path = folder / "effects.yaml"
    path.write_text(re.sub(r"(?m)^    reset: node .*", "    reset: none", with_more(effects)))
    return path


def with_more(entries: dict[str, str]) -> str:
    """The text of the stage with these entries, each after the line that it belongs to."""
    text = movable(STAGE.read_text())
    for line, more in entries.items():
        assert line in text
        text = text.replace(line, line + more)
    return text


def runs_as_it_simulates(folder: Path, stage: Path, motion: Path) -> Any:
    """The rows of a motion that runs, bit for bit, as it simulates."""
    sc.simulate(stage, motion).save(folder / "s.h5")
    done = stagectl("run", stage, motion, "--channel", folder / "bus", "-o", folder / "r.h5")
    assert done.returncode == 0, done.stderr
    ran, simulated = (open_recording(folder / name).samples for name in ("r.h5", "s.h5"))
    for column in ("measured", *law.Setpoint._fields, *law.Output._fields):
        assert np.array_equal(ran[column], simulated[column]), column
    return ran


def test_what_holds_a_memory_of_the_way_runs_as_it_simulates(tmp_path: Path) -> None:
    """Bit for bit."""
    body = """  viscous_asymmetry: 0.1
  cable: {stiffness: 0.02 N m/rad, hysteresis: 0.1 N m, slip: 0.6 rad}
  base: {ratio: 0.05, frequency: 21 Hz}
  transmission: {load_share: 0.3, load_friction: 0.4, resonance: 800 Hz, damping: 0.1, backlash: 0.3 mrad}
"""
    rubbing = "  asymmetry: 0.03\n  load: 0.03\n  lead: {amplitude: 0.03, order: 1}\n"
    stage = tmp_path / "stage.yaml"
    stage.write_text(with_more({"  viscous: 0.14 N m s/rad\n": body, "  coulomb: 1.0 N m\n": rubbing}))
    runs_as_it_simulates(tmp_path, stage, SINE)


BRAKE = "brake: {control: drive, release: 30 ms, engage: 50 ms}\n"
STATED = BRAKE.replace("{", "{holding_current: 2.36 A, ")  # 1.7 N m
ASYMMETRIC = (
    "  bias: -2 N m\n  viscous_asymmetry: 0.1\n",
    "  asymmetry: 0.03\n  load: 0.03\n",
)
PULLED = (
    "  gravity: {amplitude: 1.5 N m, phase: 90 deg}\n"
    "  cable: {stiffness: 0.1 N m/rad, centre: 8 mm, hysteresis: 0.1 N m, slip: 0.6 rad}\n",
    "",
)
WITH_TIME = (
    "  viscous_warming: {rise: 0.3, time: 10 s}\n  viscous_step: {share: 0.1, at: 0.5 s}\n",
    "  warming: {rise: 0.3, time: 10 s}\n  step: {share: -0.2, at: 0.4 s}\n  lag: 5 ms\n"
    "  dwell: {rise: 0.1, time: 0.1 s, length: 4 um}\n  stribeck: {rise: 0.2, velocity: 3 mm/s}\n",
)


@pytest.mark.parametrize(
    ("added", "brake"),
    [
        (ASYMMETRIC, BRAKE),
        (PULLED, BRAKE),
        (("  bias: -0.5 N m\n", ""), BRAKE),
        (ASYMMETRIC, STATED),
        (("", ""), STATED.replace("2.36", "0.7")),
        (WITH_TIME, ""),
    ],
)
def test_a_load_behind_a_brake_and_what_goes_by_the_clock_run_as_they_simulate(
    tmp_path: Path, added: tuple[str, str], brake: str
) -> None:
    """Bit for bit, and as near as without: more than friction carries, or less of it; from a machine that is cold."""
    stage, move = tmp_path / "stage.yaml", tmp_path / "move.yaml"
    entries = dict(zip(("  viscous: 0.14 N m s/rad\n", "  coulomb: 1.0 N m\n"), added, strict=True))
    stage.write_text(with_more(entries) + brake)
    move.write_text("{type: sine, amplitude: 2 mm, frequency: 3.2 Hz, periods: 2}")
    ran = runs_as_it_simulates(tmp_path, stage, move)
    assert np.abs(ran["error"]).max() <= 3.0 * 2.0 * np.pi / 2**20  # the plain stage: 27.9 nm, 2.4 counts


def test_a_model_with_effects_runs_as_it_simulates_and_from_where_the_axis_stands(tmp_path: Path) -> None:
    """Bit for bit from zero; and from elsewhere the current against the cogging is that of the other place."""
    stage, away = with_effects(tmp_path), tmp_path / "away.yaml"
    away.write_text(
        "{type: s_curve, distance: 2.3 mm, velocity: 20 mm/s, acceleration: 0.5 m/s^2, jerk: 20 m/s^3, one_way: true}"
    )
    sc.simulate(stage, SINE).save(tmp_path / "s.h5")
    with drive(stage, tmp_path / "bus"):
        for motion, name in ((SINE, "first"), (away, "away"), (SINE, "second")):
            done = stagectl("run", stage, motion, "--channel", tmp_path / "bus", "-o", tmp_path / f"{name}.h5")
            assert done.returncode == 0, done.stderr
    first, second, expected = (open_recording(tmp_path / f"{name}.h5").samples for name in ("first", "second", "s"))
    for column in ("measured", *law.Setpoint._fields, *law.Output._fields):
        assert np.array_equal(first[column], expected[column]), column
    assert open_recording(tmp_path / "second.h5").meta["origin"] == pytest.approx(2.3 / 12.0 * 2.0 * np.pi, abs=2e-3)
    assert np.array_equal(second["feedforward"], first["feedforward"])
    assert np.abs(second["friction"] - first["friction"]).max() > 0.02
    reversed_once = slice(1000, 3000)  # what springs back between two runs is forgotten with the first reversal
    assert np.abs(second["error"][reversed_once]).max() < 3.0 * np.abs(first["error"][reversed_once]).max()
