"""A staged trial: the folder's format, the command's recomputation, determinism, and what stays sealed."""

import ast
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stagectl_studies.machine
import yaml
from scipy.interpolate import make_interp_spline
from scipy.linalg import expm
from scipy.signal import lfilter
from stagectl_studies.machine import trials
from stagectl_studies.machine.battery import held_out, recommended, short, three_sines
from stagectl_studies.machine.machine import Floats
from stagectl_studies.machine.reference import PERIOD
from stagectl_studies.machine.stage_trial import stage_trial

HEADER = "time_s,reference_rad,position_rad,current_command_A,current_A"
PAIR = trials.Options(("cogging", "dwell"), 1.0, offsets=True, law="maxwell", short=True)


@pytest.fixture(scope="module")
def staged(tmp_path_factory: pytest.TempPathFactory) -> tuple[trials.Trial, Path]:
    trial, directory = trials.draw(21, "pair", PAIR), tmp_path_factory.mktemp("pair")
    stage_trial(trial, directory)
    return trial, directory


def table(path: Path) -> Floats:
    return np.loadtxt(path, delimiter=",", skiprows=1, unpack=True)


def spline_states(reference: Floats, at: Floats) -> Floats:
    """(position, speed) of the quintic at times, constant outside; (2, m)."""
    t = np.arange(reference.size) * PERIOD
    spline = make_interp_spline(t, reference, k=5)
    inside = np.clip(at, 0.0, t[-1])
    return np.array([spline(inside), np.where(inside == at, spline(inside, 1), 0.0)])


def recomputed(c: dict[str, Any], reference: Floats, position: Floats, injection: Floats) -> Floats:
    """The command, written a second time from the format page alone."""
    j, d, kt, ts = c["model_inertia"], c["model_viscous"], c["model_force_constant"], c["Ts"]
    n, frames = reference.size, (reference.size + 1) // 2
    whole = expm(np.array([[0.0, 1.0, 0.0], [0.0, -d / j, kt / j], [0.0, 0.0, 0.0]]) * ts)
    ad, bd = whole[:2, :2], whole[:2, 2]
    inverse = np.linalg.inv(np.column_stack([ad @ bd, bd]))
    instants = 2.0 * ts * np.arange(frames + 1)
    ahead, here = (spline_states(reference, instants + by) for by in (c["feedforward_advance_s"], 0.0))
    u = (inverse @ (ahead[:, 1:] - ad @ ad @ ahead[:, :-1])).T.ravel()[:n]
    v1 = (inverse @ (here[:, 1:] - ad @ ad @ here[:, :-1]))[0]
    target = reference.copy()
    target[1::2] = (ad[0] @ here[:, :-1] + bd[0] * v1)[: n // 2]
    x = spline_states(reference, np.arange(n) * ts + c["friction_advance_s"])[0]
    weight, slip = np.array(c["friction_weight"]), np.array(c["friction_slip"])
    state, torque, before = np.zeros(weight.size), np.empty(n), reference[0]
    for k in range(n):
        state = np.clip(state + (x[k] - before) / slip, -1.0, 1.0)
        torque[k], before = weight @ state, x[k]
    e, a = target - position, c["derivative_pole"]
    integral = lfilter(np.array([1.0, 1.0]) * c["Ki"] * ts / 2.0, [1.0, -1.0], e)
    derivative = lfilter(
        np.array([1.0, -1.0]) * 2.0 * c["Kd"] * a / (2.0 + a * ts), [1.0, -(2.0 - a * ts) / (2.0 + a * ts)], e
    )
    return np.asarray(c["Kp"] * e + integral + derivative + u + torque / kt + injection)


def test_the_command_can_be_recomputed(staged: tuple[trials.Trial, Path]) -> None:
    """From the CSVs and nominal.yaml alone, to 1e-5 A, as the page promises; with the injection where there is one."""
    folder = staged[1] / "captures"
    nominal = yaml.safe_load((folder / "nominal.yaml").read_text())
    for line in yaml.safe_load((folder / "captures.yaml").read_text())["captures"]:
        if line["repeat"] > 1:
            continue
        _, reference, position, command, _ = table(folder / line["file"])
        injection = table(folder / line["injection"])[1] if "injection" in line else np.zeros(reference.size)
        again = recomputed(nominal["controller"], reference, position, injection)
        assert np.abs(again - command).max() < 1e-5, line["file"]


def test_another_controller_can_not(tmp_path: Path) -> None:
    options = PAIR._replace(effects=("controller",))
    stage_trial(trials.draw(4, "single", options), tmp_path)
    folder = tmp_path / "captures"
    nominal = yaml.safe_load((folder / "nominal.yaml").read_text())
    _, reference, position, command, _ = table(folder / "sine-1.6-2.csv")
    again = recomputed(nominal["controller"], reference, position, np.zeros(reference.size))
    assert 1e-3 < np.abs(again - command).max() < 10.0


def test_format(staged: tuple[trials.Trial, Path]) -> None:
    folder = staged[1] / "captures"
    lines = yaml.safe_load((folder / "captures.yaml").read_text())["captures"]
    uses = {use: {line["repeat"] for line in lines if line["use"] == use} for use in ("diagnose", "held-out")}
    assert uses == {"diagnose": {1, 2, 3}, "held-out": {1, 2}}
    clock = 0.0
    for line in lines:
        path = folder / line["file"]
        assert path.read_text().split("\n", 1)[0] == HEADER
        time = table(path)[0]
        assert time[0] == 0.0 and np.abs(np.diff(time) - PERIOD).max() < 1e-9
        assert line["start_s"] > clock
        clock = line["start_s"] + time[-1]
    nominal = yaml.safe_load((folder / "nominal.yaml").read_text())
    assert set(nominal) == {"stage", "friction", "drive", "controller"}
    assert sum(nominal["friction"]["weight"]) == pytest.approx(nominal["friction"]["coulomb"])
    assert not {"truth", "sealed"} & {path.stem for path in folder.iterdir()}


def test_repeats_differ_by_noise_only(staged: tuple[trials.Trial, Path]) -> None:
    folder = staged[1] / "captures"
    first, second = (table(folder / f"scan-{repeat}.csv") for repeat in (1, 2))
    assert np.array_equal(first[1], second[1])
    position, current = (float(np.std(first[k] - second[k])) for k in (2, 4))
    assert 1e-6 < position < 5e-5 and 0.045 < current < 0.1


def test_truth(staged: tuple[trials.Trial, Path]) -> None:
    trial, directory = staged
    answer = json.loads((directory / "sealed" / "truth.json").read_text())
    assert [effect["name"] for effect in answer["effects"]] == ["cogging", "dwell"]
    assert "machine.forces.cogging" in answer["effects"][0]["parameters"]
    assert set(answer["noise_free"]) == {capture.file for capture in trial.captures}
    with np.load(directory / "sealed" / "truth.npz") as arrays:
        for file in set(answer["noise_free"].values()):
            rows = arrays[f"position/{file}"].size
            assert arrays[f"where/dwell/{file}"].shape == (rows,) and arrays[f"where/dwell/{file}"].dtype == bool
            recorded = table(directory / "captures" / file)
            assert np.std(recorded[2] - arrays[f"position/{file}"]) < 5e-5
        cogging = np.concatenate([arrays[key] for key in arrays.files if key.startswith("where/cogging/")])
        assert 0.5 < cogging.mean() < 0.95


def test_the_same_seed_is_the_same_trial() -> None:
    first, again = (trials.draw(21, "pair", PAIR) for _ in range(2))
    assert repr(first) == repr(again)
    a, b = (trials.noisy(trial, 3) for trial in (first, again))
    assert np.array_equal(a.position, b.position) and np.array_equal(a.current, b.current)
    assert not np.array_equal(a.current, trials.noisy(trials.draw(22, "pair", PAIR), 3).current[: a.current.size])


def test_null_exact_is_the_nominal_model() -> None:
    trial = trials.draw(9, "null-exact", trials.Options(short=True))
    body, law = trial.rig.machine.body, trial.rig.machine.law
    assert not trial.hidden and (trial.model.inertia, trial.model.viscous) == (body.inertia, body.viscous)
    assert trial.model.weight == pytest.approx(law.weights * body.coulomb)
    off = trials.draw(9, "null-parameters", trials.Options(short=True))
    share = off.model.inertia / off.rig.machine.body.inertia - 1.0
    assert not off.hidden and 0.0 < abs(share) <= 0.15


def test_batteries_are_as_long_as_said() -> None:
    def seconds(battery: list[Any]) -> float:
        return float(sum(experiment.reference.size for experiment in battery)) * PERIOD

    assert 75.0 < seconds(recommended(1)) < 90.0
    assert 15.0 < seconds(short(1)) < 25.0
    assert 8.0 < seconds(three_sines()) < 20.0
    assert 20.0 < seconds(held_out(1)) < 45.0
    assert all(
        np.abs(experiment.reference).max() < 31.5 for experiment in [*recommended(1), *held_out(1), *held_out(2)]
    )


def test_the_exam_imports_nothing_of_the_rest() -> None:
    allowed = {"numpy", "numba", "scipy", "yaml", "pyarrow"}
    folder = Path(str(stagectl_studies.machine.__file__)).parent
    for path in sorted(folder.glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.level == 0:
                names = [str(node.module)]
            elif isinstance(node, ast.Import):
                names = [word.name for word in node.names]
            else:
                assert not isinstance(node, ast.ImportFrom), path
                continue
            for name in names:
                root, ours = name.split(".")[0], name.startswith("stagectl_studies.machine")
                assert ours or root in allowed or root in sys.stdlib_module_names, (path, name)
