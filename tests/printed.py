"""What README and manual print, and a reader who types it: line by line, in a shell, in a folder of his own."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.units import StageError
from stagectl.web.client import ask
from tests.conftest import CONFIG, ROOT, SOURCES

DOCS = ROOT / "docs"
_NAMED = re.compile(r'(?m)^ *```yaml title="([\w.-]+\.yaml)"\n(.*?)^ *```', re.DOTALL)
_PATIENCE = 300.0  # s: the machine is shared
_FEWER = {"experiments/current-sine-1.6hz-5a.yaml": 4, "trajectories/sine-1.6hz.yaml": 1}  # periods: enough to identify


def text(page: str) -> str:
    """A page of the manual, or the README."""
    if page == "drives.md":  # it is made as the manual is built
        return str(tool("presets").pages()[page])
    return (ROOT / page if page == "README.md" else DOCS / page).read_text(encoding="utf-8")


def tool(name: str) -> Any:
    """A module of tools/manual, which is no package."""
    spec = importlib.util.spec_from_file_location(f"manual_{name}", ROOT / "tools" / "manual" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def commands(page: str, blocks: str = "sh") -> list[str]:
    """The lines of its shell blocks, in order; what needs root or hardware stands in blocks of kind ``console``."""
    words = re.findall(rf"(?ms)^ *```(?:{blocks})\n(.*?)^ *```", text(page))
    return [line.strip() for block in words for line in block.splitlines() if line.strip()]


def python(page: str) -> str:
    """The Python of a tutorial, all its blocks as one script; the other pages' are listings of `examples/`."""
    return "\n".join(re.findall(r"(?ms)^```python\n(.*?)^```", text(page))) if page.startswith("tutorial-") else ""


class Outcome(NamedTuple):
    """What a line said and made."""

    outcome: subprocess.CompletedProcess[str]
    made: dict[Path, bytes]  # below the reader's folder


_DONE: dict[tuple[str, ...], Outcome] = {}


class Reader:
    """Somebody in a folder with the configuration and an environment; what goes on until it is stopped goes on.

    A line that stands on two pages is run once: where nothing else goes on, and the files that it names are the same to
    the byte, what it made is put there.
    """

    def __init__(self, folder: Path, page: str = "") -> None:
        self.folder = folder
        shutil.copytree(CONFIG, folder / "config")
        if not page.startswith("tutorial-"):  # their figures are those of the whole motions
            for name, periods in _FEWER.items():
                long = folder / "config" / name
                long.write_text(re.sub(r"(?m)^periods: \d+", f"periods: {periods}", long.read_text()))
        (folder / ".venv").symlink_to(sys.prefix)
        for name, content in _NAMED.findall(text(page)) if page else ():
            (folder / name).write_text(content)
        cache = os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache"))
        mine = {"XDG_RUNTIME_DIR": str(folder), "HOME": str(folder), "XDG_CACHE_HOME": cache, "COLUMNS": "120"}
        programs = f"{folder / '.venv' / 'bin'}:{os.environ['PATH']}"
        self.environment = {**os.environ, **mine, "PATH": programs, "PYTHONPATH": SOURCES, "LC_ALL": "C.UTF-8"}
        self._terminal = folder / "terminal"  # what the line that goes on prints
        self._going: list[subprocess.Popen[str]] = []

    def types(self, line: str, patience: float = 600.0) -> subprocess.CompletedProcess[str]:
        """One line, to its end."""
        key = (line.partition(" #")[0].strip(), *self._named(line))
        if key in _DONE and not self._going:
            self._put(_DONE[key].made)
            return _DONE[key].outcome
        before = self._files()
        try:
            outcome = self._run(line, patience)
        except subprocess.TimeoutExpired as error:
            raise AssertionError(f"{error}\n{self.elsewhere()}") from error
        if outcome.returncode == 0 and not self._going:
            made = [path for path, state in self._files().items() if before.get(path) != state]
            _DONE[key] = Outcome(outcome, {path: (self.folder / path).read_bytes() for path in made})
        return outcome

    def _run(self, line: str, patience: float) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            line, shell=True, cwd=self.folder, env=self.environment, capture_output=True, text=True, timeout=patience
        )

    def elsewhere(self) -> str:
        """What the other terminal shows, and the faults of the service in it; nothing where nothing goes on."""
        if not self._going:
            return ""
        faults = self._run("stagectl fault list", _PATIENCE)
        return (
            f"the other terminal:\n{self._terminal.read_text()}\nstagectl fault list:\n{faults.stdout}\n{faults.stderr}"
        )

    def _named(self, line: str) -> list[str]:
        """Digests of the files and folders that a line names, as they are now."""
        paths = []
        for word in shlex.split(line, comments=True):
            place = self.folder / word
            if place == self.folder:  # `. FILE` sets up the environment
                continue
            files = sorted(place.rglob("*")) if place.is_dir() else [place]
            paths += [f"{file} {hashlib.sha256(file.read_bytes()).hexdigest()}" for file in files if file.is_file()]
        return [path.replace(f"{self.folder}/", "") for path in paths]

    def _files(self) -> dict[Path, tuple[int, int]]:
        """All files of the folder, with time and size."""
        states = {}
        for place, _, names in os.walk(self.folder):
            for path in (Path(place) / name for name in names):
                if path.is_file() and not path.is_symlink():
                    state = path.stat()
                    states[path.relative_to(self.folder)] = (state.st_mtime_ns, state.st_size)
        return states

    def _put(self, made: dict[Path, bytes]) -> None:
        for path, content in made.items():
            (self.folder / path).parent.mkdir(parents=True, exist_ok=True)
            (self.folder / path).write_bytes(content)

    def begins(self, line: str) -> None:
        """A line that goes on, in another terminal; returns when it can be asked."""
        with self._terminal.open("w") as said:
            going = subprocess.Popen(
                f"exec {line}", shell=True, cwd=self.folder, env=self.environment, stdout=said, stderr=said, text=True
            )
        self._going.append(going)
        end = time.monotonic() + _PATIENCE
        while not self._can_be_asked(line):
            assert going.poll() is None and time.monotonic() < end, self._terminal.read_text()
            time.sleep(0.1)

    def _can_be_asked(self, line: str) -> bool:
        if " serve " not in line:
            return "virtual drive of" in self._terminal.read_text()
        try:
            return bool(ask(self.folder / "stagectl" / "control.sock", "GET", "/v1/status"))
        except StageError:
            return False

    def ends(self) -> None:
        """Ctrl-C in the other terminals."""
        for going in self._going:
            going.send_signal(signal.SIGINT)
            try:
                code = going.wait(timeout=_PATIENCE)
            except subprocess.TimeoutExpired as error:
                raise AssertionError(f"{error}\n{self.elsewhere()}") from error
            assert code == 0, self._terminal.read_text()
        self._going.clear()

    def closes(self) -> None:
        """Close the terminals, however the test ended."""
        for going in self._going:
            going.kill()
            going.wait()
