"""A whole exam in small: the plan, four trials with a fixed seed, the same bytes whoever runs them, dying workers."""

import json
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from stagectl_studies.exam import exam, run_trial
from stagectl_studies.exam.cores import alone
from stagectl_studies.exam.plan import ExamError, Planned, expanded, plan, quotas, source_seed
from stagectl_studies.exam.question import Manner, answers
from stagectl_studies.exam.rules import EXACT
from stagectl_studies.exam.run_trial import Job
from stagectl_studies.exam.sealing import broken
from stagectl_studies.exam.totals import totals
from stagectl_studies.exam.workers import local
from stagectl_studies.machine.effects import EFFECTS

ANSWERING = Path(__file__).parent / "answering"
MANNER = Manner(short=True, module="stand_in", code=str(ANSWERING))
ASKED = exam.Asked(4, 77, ("null-law", "pair", "left-out", "alien"))


def test_the_plan() -> None:
    made = plan(300, 4)
    assert made == plan(300, 4) and made != plan(300, 5)
    groups = Counter(trial.stratum.split("-")[0] for trial in made)
    assert sum(groups.values()) == 300 and min(groups.values()) >= 30
    single = Counter(trial.effects[0] for trial in made if trial.stratum.startswith("single"))
    assert set(single) == set(EFFECTS) and max(single.values()) - min(single.values()) <= 1
    assert len({trial.seed for trial in made}) == 300
    assert Counter(trial.stratum for trial in made[:60]).most_common(1)[0][1] < 20  # mixed
    for planned_trial in made:
        assert not any(len(pair & set(planned_trial.effects)) > 1 for pair in EXACT)
        assert set(planned_trial.effects) <= set(planned_trial.exclude) or planned_trial.stratum != "left-out"


def test_quotas() -> None:
    assert sum(quotas(7).values()) == 7 and quotas(24, ["pair", "triple"]) == {"pair": 13, "triple": 11}
    assert expanded(["null", "single-2"]) == ["null-exact", "null-parameters", "null-law", "single-2"]
    with pytest.raises(ExamError, match="no such stratum"):
        expanded(["nil"])


def test_seed_of_the_sources(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("one")
    first = source_seed(tmp_path)
    (tmp_path / "a.py").write_text("two")
    assert first != source_seed(tmp_path) and 0 <= first < 2**31


@pytest.fixture(scope="module")
def sat(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four trials, two at once; on the way one worker is killed, and one diagnosis."""
    root, code = tmp_path_factory.mktemp("exam"), tmp_path_factory.mktemp("code")
    (code / "stand_in.py").write_bytes((ANSWERING / "stand_in.py").read_bytes())
    killing = [code / "deadly", code / "dying"]
    for path in killing:
        path.touch()
    manner = MANNER._replace(code=str(code))
    planned = exam.prepared(root, ASKED, manner, resume=False)
    exam.held(root, planned, manner, lambda jobs: local(jobs, 2), lambda *_: None)
    assert not any(place.exists() for place in killing)
    return root


def test_four_trials(sat: Path) -> None:
    records = exam.records(sat, plan(*ASKED[:3]))
    assert [record["state"] for record in records] == ["scored"] * 4
    assert {record["answer"]["named"][0][0] for record in records} == {"cogging"}
    for folder in sorted(sat.glob("trials/*")):
        assert broken(folder, answers(folder), sat / "register.jsonl") == []
        assert not (folder / "captures").exists() and not (folder / "sealed").exists()
    register = (sat / "register.jsonl").read_text().splitlines()
    assert len(register) == 6  # whoever was killed had sealed, and so two trials were sealed twice, or one three times
    summary = totals(records)
    assert summary["strata"] == {"alien": 1, "left-out": 1, "null-law": 1, "pair": 1}
    alarms = next(row for row in summary["rows"] if row["name"] == "null, false alarms")
    assert (alarms["value"], alarms["trials"], alarms["reached"]) == (1.0, 1, "no")


def test_the_same_bytes_from_one_worker(sat: Path, tmp_path: Path) -> None:
    """Records hold no time and no salt: one worker writes what two wrote, one of whom was killed."""
    planned = exam.prepared(tmp_path, ASKED, MANNER, resume=False)
    chosen = [trial for trial in planned if trial.stratum == "pair"]
    for planned_trial in chosen:
        run_trial.sit(Job(planned_trial, str(tmp_path), MANNER))
        name = f"trials/{planned_trial.number:04d}/record.json"
        assert (tmp_path / name).read_bytes() == (sat / name).read_bytes()
    with pytest.raises(ExamError, match=r"1 holds another exam|are not finished"):
        exam.records(tmp_path, planned)


def test_going_on(sat: Path) -> None:
    """Nothing is run twice, and another exam is not mixed into this one."""
    planned = exam.prepared(sat, ASKED, MANNER, resume=True)

    def nobody(jobs: object) -> list[dict[str, object]]:
        assert jobs == []
        return []

    assert len(exam.held(sat, planned, MANNER, lambda jobs: iter(nobody(jobs)), lambda *_: None)) == 4
    with pytest.raises(ExamError, match="--resume"):
        exam.prepared(sat, ASKED, MANNER, resume=False)
    with pytest.raises(
        ExamError, match=r"--seed 78 \(there: --seed 77\); choose another folder, or: stagectl gap exam --res"
    ):
        exam.prepared(sat, ASKED._replace(seed=78), MANNER, resume=True)


def test_a_diagnosis_that_cheats_is_void(tmp_path: Path) -> None:
    """It reads the labels beside its folder, finds nothing, and is found."""
    code = tmp_path / "code"
    code.mkdir()
    (code / "cheat.py").write_text("import sys\nopen(sys.argv[3] + '/../labels.bin', 'rb').read()\n")
    root = tmp_path / "exam"
    manner = MANNER._replace(module="cheat", code=str(code))
    planned = exam.prepared(root, exam.Asked(1, 5, ("null-exact",)), manner, resume=False)
    record = run_trial.sit(Job(planned[0], str(root), manner))
    assert record["state"] == "void" and "labels.bin" in record["reasons"][0]
    assert totals([record])["void"] == [{"number": 1, "reasons": record["reasons"]}]


def test_a_diagnosis_that_fails_has_said_nothing(tmp_path: Path) -> None:
    manner = MANNER._replace(module="absent")
    planned = exam.prepared(tmp_path, exam.Asked(1, 5, ("single-4",)), manner, resume=False)
    record = run_trial.sit(Job(planned[0], str(tmp_path), manner))
    assert record["state"] == "failed" and not record["naming"]["top1"] and record["gap"]["closure"] == 0.0
    assert "No module named absent" in record["reasons"][0]
    assert not record["naming"]["alarm"]  # nor has it noticed anything
    assert json.loads((tmp_path / "trials/0001/record.json").read_text()) == record


def test_one_process_at_a_time_sits_a_trial(tmp_path: Path) -> None:
    """Who comes later waits, and another trial does not wait for it."""
    with ThreadPoolExecutor(1) as pool:
        with alone(tmp_path, 1), alone(tmp_path, 2):
            second = pool.submit(lambda: alone(tmp_path, 1).__enter__())
            with pytest.raises(TimeoutError):
                second.result(0.3)
        second.result(5.0)


def test_our_own_diagnosis_under_watch(tmp_path: Path) -> None:
    """The real command reads nothing that it may not; another controller is named before anything is fitted."""
    planned = Planned(1, "single-4", 5, ("controller",), 4.0)
    record = run_trial.sit(Job(planned, str(tmp_path), Manner(short=True, keep=True)))
    assert (record["state"], record["answer"]["verdict"]) == ("scored", "controller")
    assert record["naming"]["top1"] and record["where"]["block_right"]
    assert (tmp_path / "trials/0001/captures/nominal.yaml").exists()
