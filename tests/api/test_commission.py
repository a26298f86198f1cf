"""`commission`: every step in its order, kept, resumed and repeated; a machine of the day; versions that go back."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from stagectl.api import commission as steps
from stagectl.api.commission import NAMES, Commissioning, commission
from stagectl.api.tuning import tune
from stagectl.config.stage_file import load_stage
from stagectl.kernels.law import SETPOINT_COLUMNS
from stagectl.units import StageError
from stagectl.workflows import loop_trial, stage_versions
from stagectl.workflows.acceptance import protocol
from stagectl.workflows.machine_of_the_day import MOST_EFFECTS, drawn
from stagectl.workflows.trials import TrialError
from tests.conftest import CONFIG, movable
from tests.short_battery import shorten

STAGE = CONFIG / "ball-screw.yaml"


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    (tmp_path / "drives").symlink_to(CONFIG / "drives")
    path = tmp_path / "stage.yaml"
    path.write_text(movable(STAGE.read_text(encoding="utf-8")), encoding="utf-8")
    return path


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """A few motions, and one round of closing the gap: `test_gap_closing` goes through several."""
    monkeypatch.setattr(steps, "ROUNDS", 1)
    shorten(monkeypatch, "sine-slow", "stairs", "check-sine-slow")


def going(
    path: Path,
    said: list[str],
    may: Callable[[str], bool] = lambda name: True,
    simulated: bool = True,
    channel: str | None = None,
) -> Commissioning:
    return Commissioning(
        path=path,
        simulated=simulated,
        person="A. Turing",
        seed=1,
        machine=5,
        channel=channel,
        progress=False,
        say=said.append,
        go_ahead=lambda name, words: may(name),
    )


@pytest.mark.usefixtures("short")
def test_a_machine_nobody_knows_is_commissioned_resumed_and_taken_back(stage: Path) -> None:
    text, said = stage.read_text(), list[str]()
    with pytest.raises(StageError, match="tune"):
        commission(going(stage, said, lambda name: name != "tune"))
    state = json.loads(stage.with_suffix(".commission.json").read_text())
    assert list(state["steps"]) == ["identify"]  # on a model there is no drive to probe
    found, (machine, _) = load_stage(stage).stage, drawn(load_stage(STAGE), 5)
    scale = found.motor.force_constant / machine.stage.motor.force_constant  # only their ratios can be known
    assert found.mechanics.inertia == pytest.approx(scale * machine.stage.mechanics.inertia, rel=0.02)
    assert found.mechanics.viscous == pytest.approx(scale * machine.stage.mechanics.viscous, rel=0.05)

    result = commission(going(stage, said))
    assert "identify: done before" in "\n".join(said)
    assert list(result["steps"]) == [name for name in NAMES if name not in ("probe", "accept")]
    peaks = result["steps"]["compare"]["facts"]["peaks"]
    alone, whole = peaks["off"], next(peak for name, peak in peaks.items() if name != "off")
    assert whole < 0.2 * alone
    assert all(Path(step["page"]).is_file() for step in result["steps"].values())
    assert 60.0 < result["machine_time"] < 600.0

    said.clear()
    commission(going(stage, said), again="compare")
    assert [line.split(":")[0] for line in said if "done before" in line] == ["identify", "tune", "compensate", "close"]
    while stage.read_text() != text:
        stage_versions.back(stage)
    with pytest.raises(StageError):
        stage_versions.back(stage)


def test_a_virtual_drive_is_probed_and_accepted_first(
    stage: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the first three steps of the acceptance: `test_acceptance` takes all eight."""
    monkeypatch.setattr(protocol, "STEPS", protocol.STEPS[:3])
    asked: list[str] = []

    def may(name: str) -> bool:
        asked.append(name)
        return name != "identify"

    with pytest.raises(StageError, match="identify"):
        commission(going(stage, [], may, simulated=False, channel=str(tmp_path / "bus")))
    state = json.loads(stage.with_suffix(".commission.json").read_text())
    assert list(state["steps"]) == ["probe", "accept"]
    assert asked[:2] == ["probe", "accept"] and "accept, polarity" in asked
    assert Path(state["steps"]["accept"]["page"]).is_file()


def test_a_step_of_the_acceptance_that_is_refused_ends_it(stage: Path, tmp_path: Path) -> None:
    with pytest.raises(StageError, match="not accepted"):
        commission(going(stage, [], lambda name: name != "accept, polarity", False, str(tmp_path / "bus")))
    assert list(json.loads(stage.with_suffix(".commission.json").read_text())["steps"]) == ["probe"]


def test_machines_of_the_day_differ_from_the_model_and_from_each_other() -> None:
    model = load_stage(STAGE)
    machines = [drawn(model, seed) for seed in range(1, 41)]
    for setup, hidden in machines:
        assert 1 <= len(hidden.effects) <= MOST_EFFECTS
        ratio = setup.stage.mechanics.inertia / model.stage.mechanics.inertia
        assert 0.85 <= ratio <= 1.15
        assert setup.file.simulation.current_noise > 0.0
        assert setup.stage != model.stage
        assert len(hidden.lines) == len(hidden.parameters) + 1 + len(hidden.effects)
        assert f"friction: {hidden.law}" in hidden.lines
    assert {hidden.law for _, hidden in machines} == {"rolling", "dahl", "lugre"}
    assert len({name for _, hidden in machines for name in hidden.effects}) > 12
    again, _ = drawn(model, 7)
    assert np.array_equal(again.stage.friction.operators.weight, machines[6][0].stage.friction.operators.weight)


def test_what_is_only_foretold_takes_no_machine_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = SimpleNamespace(column=lambda _: np.array([0.0, 2.0]))
    monkeypatch.setattr(steps, "open_recording", lambda *_, **__: recording)
    for place in ("identify", "close/judged-1/sine", "close/foretold/sine"):
        (tmp_path / place).mkdir(parents=True)
        (tmp_path / place / "run.h5").touch()
    assert steps.moved(tmp_path) == 4.0


def test_a_refused_stage_is_never_put_in_place(stage: Path) -> None:
    text = stage.read_text()
    with pytest.raises(StageError):
        stage_versions.replaced(stage, text.replace("bandwidth: 40 Hz", "bandwidth: 400 Hz"))
    assert stage.read_text() == text
    page = stage.with_name("closed.html")
    page.write_text("why")
    kept = stage_versions.replaced(stage, text.replace("bandwidth: 40 Hz", "bandwidth: 20 Hz"), [page])
    assert (kept / "closed.html").read_text() == "why"
    assert stage_versions.back(stage) == kept and stage.read_text() == text
    shutil.rmtree(stage.with_suffix(".versions"))


def test_a_loop_that_only_the_friction_of_the_model_holds_back_is_tried(
    stage: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The better one on the machine is taken; the calm one where the other was stopped."""
    text = stage.read_text()
    assert "shortest: 0.3 um" in text
    stage.write_text(text.replace("shortest: 0.3 um", "shortest: 0.01 um").replace("longest: 9 um", "longest: 0.3 um"))
    p = going(stage, [])
    calm, fast = tune(p.stage), tune(p.stage, at_rest=False)
    assert calm.bandwidth < 0.7 * fast.bandwidth
    for rms, better in (({"calm": 2e-7, "fast": 1e-7}, fast), ({"calm": 1e-7, "fast": 2e-7}, calm)):
        monkeypatch.setattr(loop_trial, "errors", lambda *_, rms=rms: rms)
        found, words = steps._faster(p, calm)
        assert found.bandwidth == better.bandwidth
        assert "100 nm rms" in words and "200 nm" in words

    def stopped(*_: object) -> dict[str, float]:
        raise TrialError("the run was stopped: following error")

    monkeypatch.setattr(loop_trial, "errors", stopped)
    found, words = steps._faster(p, calm)
    assert found is calm and "following error" in words
    stage.write_text(text)
    monkeypatch.setattr(loop_trial, "errors", lambda *_: pytest.fail("nothing holds it back"))
    calm = tune(p.stage)
    assert steps._faster(p, calm) == (calm, "")


@pytest.mark.parametrize("name", ["ball-screw", "linear-slider"])
def test_the_moves_of_a_trial_stand_still_for_a_third_of_the_time(name: str) -> None:
    setup = load_stage(CONFIG / f"{name}.yaml")
    motion = loop_trial.trial(setup)
    rows = motion.setpoints(setup)
    still = float(np.mean(rows[:, SETPOINT_COLUMNS["velocity"]] == 0.0))
    assert still > 1.0 / 3.0 and motion.duration < 8.0
