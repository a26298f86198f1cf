"""What breaks a seal is found: opened early, changed afterwards, looked up elsewhere."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import stagectl_studies
from stagectl_studies.exam.sandbox import allowed, rules
from stagectl_studies.exam.sealing import JOURNAL, LABELS, Seal, SealError, broken, enciphered

import stagectl
from tests.conftest import SOURCES

TRUTH = b'{"effects": ["dwell"]}' * 40


@pytest.fixture
def trial(tmp_path: Path) -> Path:
    folder = tmp_path / "trials" / "0007"
    (folder / "answer").mkdir(parents=True)
    return folder


def held(trial: Path) -> Path:
    """A trial as it should be; its register."""
    register = trial.parents[1] / "register.jsonl"
    seal = Seal(trial, TRUTH, register)
    (trial / "answer" / "answer.json").write_text("{}")
    seal.answered(trial / "answer")
    assert seal.opened() == TRUTH
    return register


def test_a_trial_as_it_should_be(trial: Path) -> None:
    register = held(trial)
    assert broken(trial, [trial / "answer"], register) == []
    assert b"dwell" not in (trial / LABELS).read_bytes()


def test_the_same_labels_are_sealed_differently(trial: Path) -> None:
    register = held(trial)
    first = (trial / LABELS).read_bytes()
    Seal(trial, TRUTH, register)
    assert (trial / LABELS).read_bytes() != first


def test_truth_opened_early(trial: Path) -> None:
    register = trial.parents[1] / "register.jsonl"
    seal = Seal(trial, TRUTH, register)
    with pytest.raises(SealError, match="opened before the answer"):
        seal.opened()
    seal.answered(trial / "answer")
    assert broken(trial, [trial / "answer"], register) == ["the truth was opened before the answer was sealed"]


def test_an_entry_moved_in_the_journal(trial: Path) -> None:
    """Who opens early and puts the journal in order afterwards breaks its chain."""
    register = trial.parents[1] / "register.jsonl"
    seal = Seal(trial, TRUTH, register)
    with pytest.raises(SealError):
        seal.opened()
    seal.answered(trial / "answer")
    events = json.loads((trial / JOURNAL).read_text())
    (trial / JOURNAL).write_text(json.dumps([events[0], events[2], events[1]]))
    assert "was changed" in broken(trial, [trial / "answer"], register)[0]


def test_a_label_changed_after_sealing(trial: Path) -> None:
    register = trial.parents[1] / "register.jsonl"
    seal = Seal(trial, TRUTH, register)
    content = bytearray((trial / LABELS).read_bytes())
    content[14] ^= 1
    (trial / LABELS).write_bytes(bytes(content))
    seal.answered(trial / "answer")
    with pytest.raises(SealError, match="not those that were sealed"):
        seal.opened()


def test_a_label_changed_after_scoring(trial: Path) -> None:
    """The salt is public by then: only the hashes in journal and register hold the label."""
    register = held(trial)
    salt = bytes.fromhex(json.loads((trial / JOURNAL).read_text())[2]["sha256"])
    (trial / LABELS).write_bytes(enciphered(TRUTH.replace(b"dwell", b"jerks"), salt))
    assert broken(trial, [trial / "answer"], register) == ["the labels are not those that were sealed"]


def test_sealed_again_behind_the_register(trial: Path) -> None:
    """A whole new journal with another label does not agree with the register of the exam."""
    register = held(trial)
    before = register.read_text()
    held(trial)
    register.write_text(before)
    assert broken(trial, [trial / "answer"], register) == ["the hash of the labels is not that in the exam's register"]


def test_an_answer_changed_after_sealing(trial: Path) -> None:
    register = held(trial)
    (trial / "answer" / "answer.json").write_text('{"verdict": "effects"}')
    assert broken(trial, [trial / "answer"], register) == ["the answer is not the one that was sealed"]


def test_each_answer_is_sealed_before_the_labels_are_opened(trial: Path) -> None:
    """A further answer is one more seal; one that is withdrawn, changed, or comes after the opening is found."""
    register, answers = trial.parents[1] / "register.jsonl", [trial / "answer", trial / "answer-1"]
    answers[1].mkdir()
    seal = Seal(trial, TRUTH, register)
    for number, answer in enumerate(answers):
        (answer / "answer.json").write_text(str(number))
        seal.answered(answer)
    seal.opened()
    assert broken(trial, answers, register) == []
    (complaint,) = broken(trial, answers[:1], register)
    assert (
        "labels sealed, answer sealed, answer sealed, labels opened; must be labels sealed, answer sealed, l"
        in complaint
    )
    (answers[1] / "answer.json").write_text("0")
    assert broken(trial, answers, register) == ["the answer-1 is not the one that was sealed"]
    seal.answered(answers[1])
    (complaint,) = broken(trial, answers, register)
    assert "labels opened, answer sealed; must be" in complaint


def test_what_a_diagnosis_may_read(trial: Path, tmp_path: Path) -> None:
    (trial / "captures").mkdir()
    (trial / LABELS).write_bytes(b"")
    known = rules([str(trial / "captures")], [str(trial / "answer")], [str(tmp_path)])
    assert allowed(str(trial / "captures" / "scan-1.csv"), known)
    assert allowed(os.path.realpath(sys.executable), known)
    for place in (trial / LABELS, trial, tmp_path / "trials", Path.home() / ".bashrc", Path("/proc/1/cmdline")):
        if place.exists():
            assert not allowed(os.path.realpath(place), known), place
    studies, units = Path(stagectl_studies.__file__).parent, Path(stagectl.__file__).parent / "units.py"
    for room in ("machine/effects.py", "exam/truth.py"):
        assert not allowed(str(studies / room), known), room
    assert allowed(str(units), known)
    assert allowed(str(trial / "answer" / "answer.json"), known, writing=True)
    for forbidden in (trial / "captures" / "held-1.csv", units, tmp_path.parent / "not-yet-there"):
        assert not allowed(str(forbidden), known, writing=True), forbidden


PEEK = """
import sys
{line}
"""


@pytest.mark.parametrize(
    ("line", "event"),
    [
        ("open(r'{trial}/labels.bin')", "open"),
        ("import os; os.listdir(r'{trial}')", "os.listdir"),
        ("import os; os.scandir(r'{trial}')", "os.scandir"),
        ("import stagectl_studies.machine.effects", "open"),
        ("import os; os.link(r'{trial}/labels.bin', 'mine')", "os.link"),
        ("import os; os.symlink(r'{trial}/labels.bin', 'mine')", "os.symlink"),
        ("import os; os.rename(r'{trial}/labels.bin', 'mine')", "os.rename"),
        ("open(r'{trial}/captures/held-1.csv', 'a')", "open"),
        ("import os; os.truncate(r'{trial}/captures/held-1.csv', 0)", "os.truncate"),
        ("import subprocess; subprocess.run(['cat', r'{trial}/labels.bin'])", "subprocess.Popen"),
        ("import socket; socket.socket().connect(('127.0.0.1', 9))", "socket.connect"),
    ],
)
def test_a_diagnosis_that_looks_elsewhere(trial: Path, tmp_path: Path, line: str, event: str) -> None:
    """It is refused, and what it tried stands in the log that makes the trial void."""
    (trial / LABELS).write_bytes(b"")
    (trial / "captures").mkdir()
    (trial / "captures" / "held-1.csv").write_text("t\n")
    (trial / "answer" / "peek.py").write_text(PEEK.format(line=line.format(trial=trial)))
    done = watched(trial, tmp_path, place())
    assert done.returncode != 0 and "not allowed in an exam" in done.stderr, done.stderr
    assert (trial / "log").read_text().startswith(event)


def test_the_first_diagnosis_of_a_new_machine(trial: Path, tmp_path: Path) -> None:
    """matplotlib asks `fc-list` for the fonts where it has no cache of them: that is not looking elsewhere."""
    (trial / "captures").mkdir()
    (trial / "answer" / "peek.py").write_text("import matplotlib.font_manager")
    asked = tmp_path / "asked"
    (tmp_path / "fc-list").write_text(f"#!/bin/sh\ntouch {asked}\n")
    (tmp_path / "fc-list").chmod(0o755)
    new = {"MPLCONFIGDIR": str(tmp_path / "empty"), "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    done = watched(trial, tmp_path, {**place(), **new})
    assert done.returncode == 0, done.stderr
    assert asked.exists() and (trial / "log").read_text() == ""


def watched(trial: Path, closed: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """The module `peek` of the trial's answer under the hook."""
    command = [sys.executable, "-m", "stagectl_studies.exam.sandbox", str(trial / "log"), "--module", "peek"]
    command += ["--own", str(trial / "captures"), "--out", str(trial / "answer"), "--closed", str(closed), "--"]
    return subprocess.run(command, cwd=trial / "answer", capture_output=True, text=True, check=False, env=environment)


def place() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": SOURCES, "PYTHONDONTWRITEBYTECODE": "1"}
