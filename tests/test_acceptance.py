"""`drive accept`: a drive that protects its axis passes; one that does not fails before anything moves."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from stagectl.config.stage_file import Setup, load_stage, on_channel
from stagectl.drives.drive import DriveError
from stagectl.kernels.effects import Harmonic
from stagectl.motion_limits import LimitError
from stagectl.units import StageError
from stagectl.workflows.acceptance import protocol, result
from stagectl.workflows.acceptance.protocol import STEPS, Signatory, Step
from stagectl.workflows.acceptance.result import Acceptance, Outcome, StepResult
from stagectl.workflows.acceptance.traces import Trace
from tests.conftest import CONFIG, Command, movable
from tests.zoo.bench import drive
from tests.zoo.diary import Diary
from tests.zoo.stage import write
from tests.zoo.variants import named

STAGE = CONFIG / "ball-screw.yaml"
NAMES = [step.name for step in STEPS]
KEY = b"0123456789abcdef0123456789abcdef"


def willing(step: Step, words: str) -> bool:
    assert step.title in words
    return True


def until(name: str) -> Signatory:
    """A person who lets all steps happen but this one."""
    return Signatory("A. Turing", lambda step, words: step.name != name)


def outcomes(done: Acceptance) -> dict[str, str]:
    return {step.name: step.outcome.value for step in done.steps}


def accepted(setup: Setup, person: Signatory | None = None) -> Acceptance:
    return protocol.accept(setup, person or Signatory("A. Turing", willing), lambda words: None)


@contextlib.contextmanager
def foreign(folder: Path, variant: str) -> Iterator[tuple[Setup, Diary]]:
    """A drive of the zoo, and the stage that names it."""
    files = write(folder, named(variant))
    with drive(variant, files) as diary:
        yield on_channel(load_stage(files.stage, designed=False), str(files.bus)), diary


def failed_before_motion(done: Acceptance, name: str) -> StepResult:
    """The step that failed, where those after it were skipped."""
    place = NAMES.index(name)
    expected = ["passed"] * place + ["failed"] + ["skipped"] * (len(NAMES) - place - 1)
    assert list(outcomes(done).values()) == expected, done.steps
    assert not done.accepted
    return done.steps[place]


def test_the_virtual_drive_is_accepted_and_its_page_is_signed(tmp_path: Path, command: Command) -> None:
    key, page = tmp_path / "key", tmp_path / "page"
    key.write_bytes(KEY)
    words = ("--yes", "--person", "A. Turing", "--channel", tmp_path / "bus", "-o", page, "--key", key)
    code, _, err = command("drive", "accept", STAGE, *words)
    assert code == 0, err
    signed = json.loads(page.with_suffix(".json").read_text())
    content = signed["content"]
    assert [step["name"] for step in content["steps"]] == NAMES
    assert all(step["outcome"] == "passed" for step in content["steps"])
    proof = {step["name"]: "proves nothing" not in step["words"] for step in content["steps"]}
    assert [name for name, proves in proof.items() if not proves] == ["kill", "silence"]
    distances = {step["name"]: (step["measured"], step["bound"]) for step in content["steps"] if step["bound"]}
    assert set(distances) == {"kill", "silence", "quick-stop", "travel"}
    assert all(0.0 <= measured <= bound <= 0.0051 for measured, bound in distances.values())
    assert content["stage_sha256"] == hashlib.sha256(STAGE.read_bytes()).hexdigest()
    assert (content["person"], content["virtual"], content["accepted"], content["unit"]) == (
        "A. Turing",
        True,
        True,
        "m",
    )
    traces = {step["name"]: step["traces"] for step in content["steps"]}
    assert {name: len(kept) for name, kept in traces.items() if kept} == {
        "polarity": 2, "current-limit": 1, "kill": 1, "silence": 1, "quick-stop": 1, "travel": 2,
    }  # fmt: skip
    for trace in traces["travel"]:  # each ends beyond the limit that stopped it, on its own side
        assert trace["position"][-1] / trace["origin"] > 0.99
    assert max(traces["current-limit"][0]["flowing"]) >= 0.7 * traces["current-limit"][0]["limit"]
    assert all(time <= 0.0 for time in traces["kill"][0]["time"][:-1])  # the process is dead from there on
    assert traces["kill"][0]["after"]
    html = page.with_suffix(".html").read_text()
    assert html.count("<figure>") == len([name for name in traces if traces[name]])
    assert signed["sha256"] in html
    assert signed["hmac_sha256"] in html
    assert command("drive", "verify", page.with_suffix(".json"), "--key", key)[0] == 0
    page.with_suffix(".json").write_text(page.with_suffix(".json").read_text().replace("Turing", "Church"))
    assert command("drive", "verify", page.with_suffix(".json"))[0] == 2


def test_a_foreign_drive_that_stops_by_itself_is_accepted(tmp_path: Path) -> None:
    with foreign(tmp_path, "plain") as (setup, diary):
        done = accepted(setup)
        assert done.accepted, done.steps
        assert diary.unsupervised() < 0.0
        assert diary.stands()
        assert diary.moved() < 0.06
    killed = next(step for step in done.steps if step.name == "kill")
    assert killed.measured is not None
    assert killed.bound is not None
    assert 1e-5 < killed.measured <= killed.bound
    assert 0.05 < killed.facts["time"] < 1.5  # by a time-out of 300 ms


@pytest.mark.parametrize("variant", ["unsupervised", "abort-connection-absent", "abort-connection-0-fixed"])
def test_a_drive_without_protection_is_not_accepted_and_never_moves(tmp_path: Path, variant: str) -> None:
    with foreign(tmp_path, variant) as (setup, diary):
        failed_before_motion(accepted(setup), "protection")
        assert diary.moved() < 5e-6
        assert not any(line["enabled"] for line in diary.lines("sample"))


def test_another_makers_drive_is_not_accepted(tmp_path: Path) -> None:
    with foreign(tmp_path, "other-vendor") as (setup, _):
        failed_before_motion(accepted(setup), "identity")


def test_reversed_polarity_fails_before_any_larger_motion(tmp_path: Path) -> None:
    with foreign(tmp_path, "motor-reversed") as (setup, diary):
        step = failed_before_motion(accepted(setup), "polarity")
        assert diary.stands()
        assert diary.moved() < 1e-3
    assert step.measured is not None
    assert 4e-5 < step.measured < 1e-3


@pytest.mark.parametrize("fault", ["encoder-reversed", "current-reversed"])
def test_a_reversed_virtual_drive_fails(tmp_path: Path, fault: str) -> None:
    """Its encoder, or its measurement of the current."""
    stage = tmp_path / "stage.yaml"
    stage.write_text(movable(STAGE.read_text()) + f"\nvirtual_drive:\n  faults:\n    - fault: {fault}\n")
    done = accepted(on_channel(load_stage(stage, designed=False), str(tmp_path / "bus")))
    step = failed_before_motion(done, "polarity")
    assert step.measured is None or step.measured < 1e-4


def test_what_a_person_does_not_let_happen_is_skipped_and_not_accepted(tmp_path: Path) -> None:
    setup = on_channel(load_stage(STAGE), str(tmp_path / "bus"))
    done = accepted(setup, until("polarity"))
    assert list(outcomes(done).values()) == ["passed"] * 2 + ["skipped"] * 6
    assert not done.accepted


def test_a_channel_that_another_master_has_is_left_alone(tmp_path: Path) -> None:
    import canopen

    with foreign(tmp_path, "plain") as (setup, diary):
        network = canopen.Network()
        network.connect(interface="stagectl", channel=str(tmp_path / "bus"))
        network.sync.start(0.005)
        try:
            step = failed_before_motion(accepted(setup), "identity")
        finally:
            network.sync.stop()
            network.disconnect()
        assert not diary.lines("sdo")
    assert "SYNC" in step.words
    assert "wiring" not in step.words


def test_nobody_answers_for_a_person_on_a_real_drive(tmp_path: Path, command: Command) -> None:
    files = write(tmp_path, named("plain"))
    assert command("drive", "accept", files.stage, "--yes", "--person", "A. Turing", "--channel", files.bus)[0] == 2
    assert not files.bus.exists()


@pytest.mark.parametrize("person", ["", "  ", "a\x1bb", "a" * 101])
def test_a_page_wants_a_name(ball_screw: Setup, person: str) -> None:
    with pytest.raises(StageError):
        protocol.accept(ball_screw, Signatory(person, willing), lambda words: None)


def test_a_test_current_above_the_limit_is_refused(ball_screw: Setup) -> None:
    with pytest.raises(LimitError) as caught:
        protocol.accept(ball_screw, Signatory("A. Turing", willing), lambda words: None, current=200.0)
    assert (caught.value.needed, caught.value.allowed) == (200.0, 15.0)


@pytest.mark.parametrize(("place", "load", "value"), [("bias", 1.5, 1.5), ("gravity", Harmonic(1.2, 1.0, 0.5), 1.2)])
def test_an_axis_that_falls_is_not_tried_in_open_loop(
    ball_screw: Setup, tmp_path: Path, place: str, load: Any, value: float
) -> None:
    mechanics = ball_screw.stage.mechanics._replace(**{place: load})
    falling = ball_screw._replace(stage=ball_screw.stage._replace(mechanics=mechanics))
    with pytest.raises(DriveError) as caught:
        accepted(on_channel(falling, str(tmp_path / "bus")))
    assert (caught.value.place, caught.value.value) == (f"mechanics.{place}", value)


def _acceptance(*steps: Outcome) -> Acceptance:
    results = tuple(StepResult(f"s{n}", "t", outcome, "w", {}, 1e-3, 2e-3) for n, outcome in enumerate(steps))
    return Acceptance("x", "x.yaml", "1", "2", "p", "now", False, "m", {"vendor": "3"}, {"python": "4"}, results)


def test_only_all_steps_passed_are_an_acceptance() -> None:
    assert _acceptance(Outcome.PASSED, Outcome.PASSED).accepted
    assert not _acceptance().accepted
    for bad in (Outcome.SKIPPED, Outcome.FAILED):
        assert not _acceptance(Outcome.PASSED, bad).accepted


def _changed(content: dict[str, Any]) -> None:
    content["steps"][0]["measured"] = 0.5e-3


def test_what_is_drawn_is_signed(tmp_path: Path) -> None:
    trace = Trace("", [0.0, 0.5e-3], [0.0, 1e-3], [0.1, 0.2], [0.1, 0.2], [], origin=0.0)
    done = _acceptance(Outcome.PASSED)
    signed = result.signed(done._replace(steps=(done.steps[0]._replace(traces=(trace,)),)), KEY)
    path = tmp_path / "page.json"
    path.write_text(json.dumps(signed))
    result.verify(path, KEY)
    signed["content"]["steps"][0]["traces"][0]["position"][1] = 0.5e-3
    path.write_text(json.dumps(signed))
    with pytest.raises(StageError):
        result.verify(path, KEY)


def test_a_changed_page_is_found_out(tmp_path: Path) -> None:
    path = tmp_path / "page.json"
    signed = result.signed(_acceptance(Outcome.PASSED), KEY)
    path.write_text(json.dumps(signed))
    assert result.verify(path, KEY)["accepted"] is True
    assert result.verify(path)["person"] == "p"
    with pytest.raises(StageError):
        result.verify(path, KEY[::-1])
    _changed(signed["content"])
    path.write_text(json.dumps(signed))
    with pytest.raises(StageError):
        result.verify(path)
    forged = result.signed(_acceptance(Outcome.PASSED))  # by somebody without the key
    path.write_text(json.dumps(forged))
    with pytest.raises(StageError):
        result.verify(path, KEY)


def test_a_short_key_is_no_key(tmp_path: Path) -> None:
    (tmp_path / "key").write_bytes(b"secret\n")
    with pytest.raises(StageError):
        result.read_key(tmp_path / "key")
