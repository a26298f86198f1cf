"""What a command loads: the time it takes to start, in terms that no machine's speed changes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import pytest

from stagectl.cli.app import VERBS, application
from tests.conftest import CONFIG, ROOT

# What costs more than a hundredth of a second to load.
HEAVY = {
    *("can", "canopen", "fastapi", "h5py", "jinja2", "llvmlite", "matplotlib", "numba", "numpy", "pint", "pyarrow"),
    *("pydantic", "rich", "scipy", "serial", "typer", "uvicorn", "yaml"),
}
PROGRAM = """
import json, sys
sys.argv = ["stagectl", *sys.argv[1:]]
try:
    from stagectl.cli import main
    main()
except SystemExit as ended:
    code = ended.code
print("\\n" + json.dumps([code, sorted(sys.modules)]))
"""


def _loaded(*words: object, program: str = PROGRAM, **environment: str) -> tuple[int, set[str]]:
    """Exit code of a command in a process of its own, and the modules that it has then."""
    command = [sys.executable, "-c", program, *map(str, words)]
    done = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": str(ROOT), **environment}, cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    code, modules = json.loads(done.stdout.splitlines()[-1])
    return code, set(modules)


def _heavy(modules: set[str]) -> set[str]:
    return modules & HEAVY


def test_the_package_loads_nothing() -> None:
    program = "import stagectl, json, sys; print(json.dumps([0, sorted(sys.modules)]))"
    code, modules = _loaded(program=program)
    assert (code, _heavy(modules)) == (0, set())
    assert {name for name in modules if name.startswith("stagectl.")} == set()


def test_the_help_loads_what_reads_the_command_line() -> None:
    code, modules = _loaded("--help")
    assert (code, _heavy(modules)) == (0, {"typer"})
    assert {f"stagectl.cli.{name}" for name in VERBS} <= modules
    assert not {"stagectl.workflows.motion", "stagectl.design", "stagectl.config", "stagectl.recording"} & modules


def test_the_status_loads_its_own_verbs(tmp_path: Path) -> None:
    code, modules = _loaded("status", "--socket", tmp_path / "none")
    assert code == 2  # no service
    assert "typer" in modules
    assert _heavy(modules) <= {"typer", "pydantic", "rich"}  # typer's own, and rich for the red of an error
    assert {name for name in VERBS if f"stagectl.cli.{name}" in modules} == {"service"}


def _simulated(folder: Path, name: str, **environment: str) -> tuple[set[str], Any, bytes]:
    """Modules, result and rows of a simulation."""
    trajectory = CONFIG / "trajectories/sine-1.6hz.yaml"
    files = ["-o", folder / f"{name}.h5", "--json", folder / f"{name}.json"]
    code, modules = _loaded("simulate", CONFIG / "ball-screw.yaml", trajectory, *files, **environment)
    assert code == 0
    result = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    with h5py.File(folder / f"{name}.h5") as file:
        return modules, {**result, "recording": ""}, file["samples"][()].tobytes()


def test_a_check_of_stage_files_needs_no_compiler() -> None:
    code, modules = _loaded("config", "check", CONFIG / "ball-screw.yaml")
    assert code == 0
    assert not {"numba", "scipy.linalg"} & modules


LONG = "import stagectl.cli.motion as m; m._UNLOADED = m._UNCOMPILED = 0"


def test_a_short_simulation_needs_no_compiler_and_gives_the_same_bits(tmp_path: Path) -> None:
    """Interpreted at first, and compiled; in the real-time process: `kernels/test_bits.py`."""
    modules, result, rows = _simulated(tmp_path, "short")
    needed = {"h5py", "numpy", "scipy", "typer", "yaml"}
    assert needed <= _heavy(modules) <= needed | {"pydantic", "canopen"}  # typer's own; what `Motion` is declared with
    assert not {"scipy.linalg", "scipy.optimize", "scipy.stats"} & modules  # a third of the start of each program
    (tmp_path / "sitecustomize.py").write_text(LONG, encoding="utf-8")
    path = os.pathsep.join([str(tmp_path), str(ROOT)])
    compiled, *others = _simulated(tmp_path, "compiled", PYTHONPATH=path)
    assert "numba" in compiled
    assert others == [result, rows]


@pytest.mark.parametrize("module", VERBS)
def test_each_verb_is_listed_with_its_module(module: str) -> None:
    app = application(VERBS[module][0])
    commands = [
        registered_command.name or registered_command.callback.__name__
        for registered_command in app.registered_commands
        if registered_command.callback
    ]
    assert sorted([*commands, *(str(registered_group.name) for registered_group in app.registered_groups)]) == sorted(
        VERBS[module]
    )
