"""Ctrl-C at any moment of a start, files that a command must not replace, and what children import."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stagectl.problem import ProblemKind
from stagectl.recording.file_lock import RecordingError
from stagectl.recording.hdf5 import Writer
from tests.conftest import CONFIG, SOURCES, Command

STAGE, SINE = CONFIG / "ball-screw.yaml", CONFIG / "trajectories" / "sine-3.2hz.yaml"
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
        assert process.returncode in (0, 1, 2, 130)


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
