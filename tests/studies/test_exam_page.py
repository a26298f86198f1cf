"""The page of an exam: every figure asked for, also of an exam of one trial."""

from pathlib import Path
from typing import Any

from stagectl_studies.exam.page import answer, page
from stagectl_studies.exam.totals import totals

from stagectl.report.page import write
from tests.studies.made import records

EXAM = {"trials": 300, "seed": 3, "strata": [], "short": True, "full": False, "baselines": True}
SECONDS = {"diagnosis": [20.0, 30.0, 25.0], "staging": [3.0]}


def result(trials: int) -> dict[str, Any]:
    made = records(trials, 3)
    return {"exam": EXAM, **totals(made), "records": made}


def test_a_whole_exam(tmp_path: Path) -> None:
    text = write(page(result(300), SECONDS, ["stagectl gap exam"]), tmp_path / "exam.html").read_text()
    for heading in ("taken for what", "effects are noticed", "How sure", "How far", "Beside simpler", "Seconds"):
        assert heading in text
    assert text.count("data:image/png") == 5 and "http" not in text.split("</style>")[1]


def test_an_exam_of_one_trial(tmp_path: Path) -> None:
    reply = result(1)
    reply["baselines"], reply["beside"], reply["oracle_ratios"] = [], [], []
    assert "What was asked" in write(page(reply, {}, []), tmp_path / "exam.html").read_text()


def test_the_answer_names_what_is_missed() -> None:
    asked = {"low": 0.0, "high": 1.0, "trials": 9, "kind": "rate", "most": False, "must": 0.6}
    rows = [
        {**asked, "name": "pairs, all found", "value": 0.2, "reached": "no"},
        {**asked, "name": "closure", "value": 0.9, "reached": "must"},
        {**asked, "name": "WHERE F1", "value": 0.9, "reached": "target"},
        {**asked, "name": "oracle ratio", "value": None, "reached": ""},
        {**asked, "name": "  coordinate", "value": 0.9, "reached": "", "must": None},
    ]
    assert answer({"rows": rows, "trials": 10, "void": [{}]}) == (
        "2 of 3 figures reach what they must, 1 their target, on 9 sealed trials. Not reached: pairs, all found. "
        "Not measured: oracle ratio."
    )
