"""Ctrl-C at any moment of a start, files that a command must not replace, and what children import."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stagectl.drives.drive import Fault
from stagectl.problem import ProblemKind
from stagectl.recording.file_lock import RecordingError
from stagectl.recording.hdf5 import Writer, save
from stagectl.service.single_motion import Ended, Motion
from stagectl.workflows import motion, trials
from stagectl.workflows.simulated_motion import simulated
from tests.conftest import CONFIG, SOURCES, Command

STAGE, SINE = CONFIG / "ball-screw.yaml", CONFIG / "trajectories" / "sine-0.8hz.yaml"  # it lasts longer than a start
_INTERRUPTED_IMPORT = """\
import sys
from stagectl.cli import main
class Interrupts:
    def find_spec(self, name, path=None, target=None):
        if name == sys.argv[-1]:
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupts())
main()
"""


_SWALLOWED_INTERRUPT = """\
import ctypes, os, signal
from stagectl.cli import app
def verb(standalone_mode):
    ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT))()
    raise RuntimeError("no compiled object yet")
app.application = lambda *_: verb
app.main()
"""


_INTERRUPTED_STRING = """\
from stagectl.cli import app, main
def run():
    try:
        exec("raise KeyboardInterrupt")
    except KeyboardInterrupt:
        raise SystemExit(130) from None
app.main = run
main()
"""


def test_an_interrupt_of_a_string_that_is_executed_keeps_the_exit_code(tmp_path: Path) -> None:
    (tmp_path / "interrupted.py").write_text(_INTERRUPTED_STRING, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "interrupted"], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stderr) == (130, "")


def test_an_interrupt_that_the_compiler_swallows_is_quiet() -> None:
    done = subprocess.run([sys.executable, "-c", _SWALLOWED_INTERRUPT], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "error: interrupted: unwritten results are lost, nothing else has changed\n"


@pytest.mark.parametrize("module", ["stagectl.cli.app", "typer", "stagectl.cli.motion", "numpy", "stagectl.workflows"])
def test_an_interrupt_during_imports_is_quiet(module: str) -> None:
    words = [sys.executable, "-c", _INTERRUPTED_IMPORT, "run", str(STAGE), str(SINE), "--output", module]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert done.returncode == 130, done.stderr
    assert "Traceback" not in done.stderr


def test_an_interrupt_of_the_whole_group_at_any_moment_of_a_start_is_quiet(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "stagectl", "run", str(STAGE), str(SINE), "--channel", str(tmp_path / "bus")]
    for delay in (0.4, 1.0, 2.0):
        process = subprocess.Popen(
            [*words, "-o", str(tmp_path / f"{delay}.h5")], stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        time.sleep(delay)
        os.killpg(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=60)
        assert "Traceback" not in err
        assert "process died" not in err
        assert process.returncode == 130, err


def test_the_loop_without_an_order_is_quiet() -> None:
    """An interrupt may come before there is one."""
    words = [sys.executable, "-m", "stagectl.realtime.axes"]
    done = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def ended(cycles: int) -> Ended:
    return Ended(cycles, 0, Fault.OPERATOR, "stopped", "", [], True, None)


def cut_short(going: Motion, *_: object) -> Ended:
    """A motion that is stopped after 600 cycles, recorded as far."""
    going.recording.parent.mkdir(parents=True, exist_ok=True)
    save(going.recording, going.meta, simulated(going).samples[:600], "stopped")
    return ended(600)


@pytest.fixture
def no_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion, "drive_present", lambda *_: contextlib.nullcontext())


@pytest.mark.usefixtures("no_drive")
def test_an_interrupt_before_anything_moved_says_so(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, command: Command
) -> None:
    monkeypatch.setattr(motion, "move", lambda *_: ended(0))
    code, _, err = command("run", STAGE, SINE, "-o", tmp_path / "none.h5")
    assert (code, err.splitlines()[-1]) == (130, "error: interrupted before anything moved")


@pytest.mark.usefixtures("no_drive")
@pytest.mark.parametrize("series", [("compare", "off", "ptc"), ("learn",)])
def test_who_stops_a_run_stops_the_series(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, command: Command, series: tuple[str, ...]
) -> None:
    tried: list[Path] = []

    def stopped(going: Motion, *_: object) -> Ended:
        tried.append(going.recording)
        return cut_short(going)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(trials, "drive_present", lambda *_: contextlib.nullcontext())
    monkeypatch.setattr(motion, "move", stopped)
    code, _, err = command(series[0], STAGE, SINE, *series[1:])
    assert (code, len(tried)) == (130, 1)
    assert err.endswith(f"error: stopped after 0.3 s; recorded: {tried[0]}\n")


@pytest.mark.usefixtures("no_drive")
def test_a_run_that_is_stopped_says_how_far_it_went(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, command: Command
) -> None:
    monkeypatch.setattr(motion, "move", cut_short)
    path = tmp_path / "part.h5"
    code, out, err = command("run", STAGE, SINE, "-o", path, "--json", "-")
    words = f"stopped after 0.3 s; recorded: {path}"
    assert (code, err.splitlines()[-1], json.loads(out)["interrupted"]) == (130, f"error: {words}", words)


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir])
def test_a_recording_replaces_nothing_but_a_recording(make: object, tmp_path: Path) -> None:
    path = tmp_path / "there"
    make(path)  # type: ignore[operator]
    before = path.stat().st_ino
    with pytest.raises(RecordingError) as caught:
        Writer(path, {"created": "now", "axis": {}}, ("time",))
    assert caught.value.problems[0].kind is ProblemKind.FILE
    assert caught.value.problems[0].file == path
    assert path.stat().st_ino == before


def test_a_device_is_not_replaced(tmp_path: Path, command: Command) -> None:
    """Nothing moves; where a test may, a device node of its own is tried, not the system's."""
    null = tmp_path / "full"
    try:
        os.mknod(null, 0o666 | stat.S_IFCHR, os.makedev(1, 7))
    except PermissionError:
        pytest.skip("this user may not make a device node")
    code, _, err = command("run", STAGE, SINE, "--channel", tmp_path / "bus", "-o", null)
    assert code == 2
    assert str(null) in err
    assert stat.S_ISCHR(null.stat().st_mode)


def test_children_do_not_import_from_the_working_folder(tmp_path: Path) -> None:
    """Neither recorder nor loop nor virtual drive: each of these modules is imported by one of them."""
    for name in ("csv", "h5py", "configparser", "pickle"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'executed')!r}, 'a').write('{name} ')\n")
    entry = f"import sys; sys.path[:] = [p for p in sys.path if p]; sys.argv = ['stagectl', 'run', {str(STAGE)!r}, "
    entry += (
        f"{str(SINE)!r}, '--channel', {str(tmp_path / 'bus')!r}, '-o', 'r.h5']; from stagectl.cli import main; main()"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", entry], cwd=tmp_path, capture_output=True, text=True, timeout=120,
        env={**os.environ, "PYTHONPATH": SOURCES},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "executed").exists()
