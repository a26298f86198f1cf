"""Compiled and interpreted kernels give the same bits; each kernel has one compiled signature."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from stagectl.kernels import jit
from tests.conftest import ROOT, SOURCES

SCRIPT = """
import hashlib, sys
from tests.conftest import CONFIG, Run, varied
from stagectl.config.stage_file import load_stage
from stagectl.kernels import jit
from stagectl.trajectories import Sine
assert jit.INTERPRETED and "numba" not in sys.modules
setup = varied(load_stage(CONFIG / sys.argv[1]), nm=1, current_noise=0.02, encoder_noise=1e-6)
stribeck = setup.stage.friction.stribeck._replace(rise=0.3, velocity=0.5, shape=1.3)
setup = setup._replace(stage=setup.stage._replace(friction=setup.stage.friction._replace(stribeck=stribeck)))
run = Run(setup, Sine(0.001, 3.2, 0.5, 0.5))
print(hashlib.sha256(run.samples.tobytes()).hexdigest())
"""


@pytest.mark.parametrize("file", ["ball-screw.yaml"])
def test_compiled_and_interpreted_give_the_same_bits(file: str) -> None:
    """A whole closed loop with noise, Stribeck and a delayed measurement, in both ways."""
    environment = {**os.environ, "STAGECTL_KERNELS": "interpreted", "PYTHONPATH": SOURCES}
    command = [sys.executable, "-c", SCRIPT, file]
    interpreted = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=True)
    compiled: dict[str, object] = {}
    script = SCRIPT.replace('assert jit.INTERPRETED and "numba" not in sys.modules', "").replace("print(", "found = (")
    sys.argv, before = ["", file], sys.argv
    try:
        exec(compile(script, "compiled", "exec"), compiled)
    finally:
        sys.argv = before
    assert compiled["found"] == interpreted.stdout.strip()


SIGNATURES = """
from tests.conftest import CONFIG, Run
from stagectl.config.stage_file import load_stage
from stagectl.kernels import cascade, feedback, feedforward, friction, law, observer, rollout, stage
from stagectl.trajectories import CurrentSine, Excited, Sine
for name in ("ball-screw", "linear-slider"):
    setup = load_stage(CONFIG / f"{name}.yaml")
    Run(setup, Sine(0.001, 3.2, 0.5, 0.5))
    Run(setup, Excited(Sine(0.001, 3.2, 0.5, 0.5), CurrentSine(0.1, 20.0, 4.0)))
for module in (cascade, feedback, feedforward, friction, law, observer, rollout, stage):
    for name, item in vars(module).items():
        if hasattr(item, "signatures") and item.__module__ == module.__name__:
            print(f"{module.__name__}.{name}", len(item.signatures))
"""


def test_one_signature_each(tmp_path: Path) -> None:
    """A second signature would mean a stray int or tuple, and a compilation in the middle of a cycle.

    In a process and with a cache of its own: other tests call kernels in ways of theirs.  Types do not depend on how
    far the code is optimised.
    """
    environment = {**os.environ, "PYTHONPATH": SOURCES, "XDG_CACHE_HOME": str(tmp_path), "NUMBA_OPT": "0"}
    command = [sys.executable, "-c", SIGNATURES]
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=True)
    counts = {name: int(count) for name, count in (line.split() for line in done.stdout.splitlines())}
    assert sum(count == 1 for count in counts.values()) >= 12
    assert {name: count for name, count in counts.items() if count > 1} == {}


def test_the_cache_is_named_after_the_sources() -> None:
    """Also in a program that has loaded numba before: it would keep compiled kernels beside their sources."""
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sorted(Path(jit.__file__).parent.glob("*.py"))))
    assert jit.source_hash() == digest.hexdigest()[:16]
    script = """
import numba
from stagectl.kernels import jit, rollout
print(jit.dispatcher(rollout.closed_loop).stats.cache_path)
"""
    environment = {**os.environ, "PYTHONPATH": SOURCES}
    del environment["NUMBA_CACHE_DIR"]
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert Path(done.stdout.strip()).parent.name == jit.source_hash()
