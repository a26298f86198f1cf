"""`import stagectl` offers nine functions, and the five lines of the manual run as printed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import stagectl as sc
from tests.conftest import CONFIG, ROOT

NINE = ["load_stage", "load_trajectory", "simulate", "run", "load_log", "identify", "diagnose", "tune", "compare"]
AS_PRINTED = """
import stagectl as sc
stage = sc.load_stage("config/ball-screw.yaml")            # designed, checked; repr shows gains and margins
run = sc.simulate(stage, sc.load_trajectory("sine.yaml"))  # arrays with units; run.plot(), run.to_frame()
fit = sc.identify(stage, run, method="simultaneous")       # values, intervals, what cannot be told; fit.apply(stage)
answer = sc.diagnose("session/")                           # where, which, how far; answer.plot(), answer.apply(stage)
"""


def test_the_nine_functions_are_there() -> None:
    assert {*NINE, "StageError"} == set(sc.__all__) <= set(dir(sc))
    assert all(getattr(sc, name).__name__ == name for name in NINE)
    with pytest.raises(AttributeError) as error:
        _ = sc.simulated  # type: ignore[attr-defined]
    assert error.value.args[0].endswith("'simulated'")


def test_the_five_lines_run_as_printed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "config").symlink_to(CONFIG)
    (folder / "sine.yaml").write_bytes((CONFIG / "trajectories" / "sine-1.6hz.yaml").read_bytes())
    stage = sc.load_stage("config/ball-screw.yaml")
    machine = stage.changed({"mechanics.viscous_asymmetry": 0.1, "simulation.current_noise": 5e-3})
    for number, motion in enumerate(["sine-3.2hz", "sine-1.6hz"] * 2):
        path = CONFIG / "trajectories" / f"{motion}.yaml"
        sc.simulate(stage, path, plant=machine, seed=number).save(f"session/{motion}-{number}.h5")
    names: dict[str, object] = {}
    exec(AS_PRINTED, names)
    fit, answer = names["fit"], names["answer"]
    assert 0.0099 < fit["inertia"].value < 0.0101 and fit["inertia"].unit == "kg m^2"  # type: ignore[index]
    assert [effect.name for effect in answer.named] == ["viscous_asymmetry"]  # type: ignore[attr-defined]
    patched = answer.apply(stage)  # type: ignore[attr-defined]
    assert 0.09 < patched.setup.stage.mechanics.viscous_asymmetry < 0.11
    assert capsys.readouterr() == ("", "")  # quiet


def test_results_print_without_the_packages_of_the_reports() -> None:
    program = (
        "import sys; sys.modules['matplotlib'] = sys.modules['jinja2'] = None\n"
        "import stagectl as sc\n"
        "stage = sc.load_stage('config/ball-screw.yaml')\n"
        "print(sc.simulate(stage, 'config/trajectories/sine-3.2hz.yaml'), stage)"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "The stage tracks within" in done.stdout and "proportional Kp" in done.stdout
