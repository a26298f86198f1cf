"""On a poor battery: what the diagnosis asks for is run by the plant, added to the folder, and answered again."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from stagectl_studies.exam import extra_captures, rounds
from stagectl_studies.exam.extra_captures import RefusedError, Wanted
from stagectl_studies.exam.plan import Planned
from stagectl_studies.exam.question import Manner, answers
from stagectl_studies.exam.run_trial import Job, sit
from stagectl_studies.exam.sealing import broken
from stagectl_studies.machine import folder as folders
from stagectl_studies.machine import trials
from stagectl_studies.machine.battery import held_out_short, three_sines
from stagectl_studies.machine.machine import Floats
from stagectl_studies.machine.reference import PERIOD

from tests.studies.test_trials import recomputed, table

ANSWERING = Path(__file__).parent / "answering"
MANNER = Manner(short=True, keep=True, module="stand_in", code=str(ANSWERING))
PLANNED = Planned(1, "poor", 7, ("bias",), 1.0)


@pytest.fixture(scope="module", autouse=True)
def quick() -> Any:
    """A battery of one sine, to be staged in seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trials, "experiments_of", lambda seed, *_: [three_sines()[2], *held_out_short(seed)])
        yield


@pytest.fixture(scope="module")
def sat(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    root = tmp_path_factory.mktemp("exam")
    return sit(Job(PLANNED, str(root), MANNER)), root / "trials" / "0001"


def test_two_rounds_and_no_third(sat: tuple[dict[str, Any], Path]) -> None:
    record, folder = sat
    assert (record["state"], record["reasons"]) == ("scored", [])
    assert [answer["experiment"] for answer in record["rounds"]] == ["", "asked-1", "asked-2"]
    assert [answer["naming"]["top1"] for answer in record["rounds"]] == [False, False, True]
    assert [answer["naming"]["covered"] for answer in record["rounds"]] == [True, True, True]
    assert record["rounds"][2]["answer"]["next_experiment"] == "asked-3"
    assert record["answer"]["next_experiment"] == "asked-1"  # the record's own answer is the first
    assert record["naming"]["top1"]  # and on three sines alone both names are one answer
    assert json.loads((folder / "record.json").read_text()) == record


def test_each_answer_is_sealed_before_the_labels_are_opened(sat: tuple[dict[str, Any], Path]) -> None:
    folder = sat[1]
    events = [load["event"] for load in json.loads((folder / "journal.json").read_text())]
    assert events == ["labels sealed", *["answer sealed"] * 3, "labels opened"]
    assert [answer.name for answer in answers(folder)] == ["answer", "answer-1", "answer-2"]
    assert broken(folder, answers(folder), folder.parents[1] / "register.jsonl") == []


def test_what_was_asked_for_is_in_the_folder(sat: tuple[dict[str, Any], Path]) -> None:
    captures = sat[1] / "captures"
    lines = yaml.safe_load((captures / "captures.yaml").read_text())["captures"]
    new = [line for line in lines if line["experiment"].startswith("asked-")]
    assert [captured["file"] for captured in new] == [
        f"asked-{number}-{repeat}.csv" for number in (1, 2) for repeat in (1, 2, 3)
    ]
    assert {captured["use"] for captured in new} == {"diagnose"} and lines[-6:] == new
    clock = 0.0
    for capture in lines:  # the session goes on: nothing is recorded before what came before has ended
        assert capture["start_s"] > clock
        clock = capture["start_s"] + table(captures / capture["file"])[0][-1]
    assert "injection" not in new[0] and new[3]["injection"] == "asked-2-injection.csv"
    first, second = (table(captures / f"asked-2-{repeat}.csv") for repeat in (1, 2))
    assert np.array_equal(first[1], second[1]) and 1e-6 < float(np.std(first[2] - second[2])) < 5e-5


def test_the_command_can_be_recomputed(sat: tuple[dict[str, Any], Path]) -> None:
    """The documented controller ran what was asked for, the injected current on top."""
    captures = sat[1] / "captures"
    controller = yaml.safe_load((captures / "nominal.yaml").read_text())["controller"]
    for number in (1, 2):
        _, reference, position, command, _ = table(captures / f"asked-{number}-1.csv")
        injection = table(captures / "asked-2-injection.csv")[1] if number == 2 else np.zeros(reference.size)
        assert np.abs(reference - table(captures / "sine-3.2-1.csv")[1][0]).max() == pytest.approx(2.0, abs=0.5)
        assert np.abs(recomputed(controller, reference, position, injection) - command).max() < 1e-5


def rows(reference: Floats) -> Wanted:
    return Wanted("more", PERIOD * np.arange(reference.size, dtype=np.float64), reference, np.zeros(reference.size))


CALM = rows(np.zeros(100))


@pytest.mark.parametrize(
    ("wanted", "reason"),
    [
        (CALM._replace(name="../more"), "no name for another capture"),
        (CALM._replace(name="held-more"), "no name for another capture"),
        (CALM._replace(name="sine-3.2"), "no name for another capture; taken are .*sine-3.2"),
        (rows(np.zeros(4)), r"0.002 s; must lie in \[0.004, 120\] s"),
        (rows(np.zeros(240_001)), r"must lie in \[0.004, 120\] s"),
        (CALM._replace(time=2.0 * CALM.time), "rows that are not 0.0005 s apart"),
        (CALM._replace(injection=np.full(100, np.nan)), "not every row holds a number"),
        (rows(np.linspace(0.0, 32.0, 60_000)), r"32 rad from where the axis stands; must lie in \[0, 31.4159\] rad"),
        (rows(np.where(np.arange(100) < 50, 0.0, 20.0)), "the axis was lost in more-1.csv, more-2.csv, more-3.csv"),
    ],
)
def test_what_the_machine_does_not_run(tmp_path: Path, wanted: Wanted, reason: str) -> None:
    trial = trials.draw(PLANNED.seed, "poor", trials.Options(("bias",), 1.0))
    folders.write_yaml(tmp_path / "captures.yaml", {"captures": []})
    with pytest.raises(RefusedError, match=reason):
        extra_captures.ran(trial, wanted, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["captures.yaml"]


def test_rows_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "samples.csv").write_text("time_s,reference_rad\n0,0\n")
    with pytest.raises(RefusedError, match=r"more: no rows that a machine can run: KeyError.*injection_A"):
        extra_captures.read("more", tmp_path / "samples.csv")


def test_what_is_done_by_hand_is_not_run() -> None:
    assert rounds.proposed({"next_experiment": {"name": "scan", "trajectory": "scan.yaml"}}) == "scan"
    assert rounds.proposed({"next_experiment": {"name": "added mass", "trajectory": ""}}) == ""
    assert rounds.proposed({"next_experiment": None}) == rounds.proposed({}) == ""
