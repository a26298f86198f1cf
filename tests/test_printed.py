"""Every command in README and manual: the shell's are typed, line by line; those within a sentence exist."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from stagectl.evaluation import evaluate
from stagectl.gap.result.result_json import save
from stagectl.recording.hdf5 import open_recording
from tests.cli.test_help import ROOT as ROOT_COMMAND
from tests.cli.test_help import verbs
from tests.conftest import ROOT
from tests.gap.examples import found
from tests.printed import DOCS, Reader, commands, python, text

DATA = ROOT.parent / "shared" / "data" / "emps" / "DATA_EMPS.mat"
GO_ON = ("stagectl serve", "stagectl virtual-drive")
# Each takes minutes: here with less of the same; `tests/gap` and `tests/selftest` hold them whole.  In real
# time it is a fault that is seen at once: the time-outs are a busy machine's.
SHORTER = {
    "stagectl gap record": " --only sine-slow,check-sine-slow --repeats 1",
    "stagectl selftest config/ball-screw.yaml --current": " --only node-reboot",
    "stagectl selftest": " --only cable-out",
}
# What a no is right for: this machine is not fit, or a probe has seen something.
MAY_SAY_NO = ("stagectl doctor",)
SLOW = ("stagectl gap diagnose session", "stagectl gap diagnose bench-session")
# Whole papers, a minute and a half: `tests/studies` holds each part with fewer runs, `make nightly` types them.
WHOLE = os.environ.get("STAGECTL_PRINTED") == "all"
PAPERS = ("stagectl reproduce",)
# Other pages type each verb of these lines and pages, with each option, but for a few: `make nightly` types all.
REPEATED = ("stagectl tune my-stage.yaml", "stagectl compare my-stage.yaml")
REPEATING = ("bench.md", "tutorial-bench.md")
NIGHTLY = () if WHOLE else (*PAPERS, *REPEATED)
ELSEWHERE = {
    *(("drive accept", option) for option in ("", "--yes", "--person", "-o")),  # `tests/test_acceptance.py`
    ("virtual-drive", "--machine-of-the-day"),  # `tests/api/test_commission.py`: its drive is started so
}
GROUPS = ["identify", *(name for name, command in ROOT_COMMAND.commands.items() if hasattr(command, "commands"))]
WITHIN = re.compile(r"`((?:sudo )?(?:\.venv/bin/)?stagectl [a-z][^`]*)`")

# Rows of the tutorials' tables, and the recording that each is about.
FIGURES = {
    "tutorial-simulate.md": {
        "before, without friction compensation": "bare",
        "after, with it": "compensated",
    },
    "tutorial-bench.md": {
        "section 4: original, 40 Hz": "before",
        "section 6: identified, 40 Hz": "after",
        "section 7: identified, 10 Hz": "tuned",
    },
    "tutorial-log.md": {
        "before, with the model as it was": "model-as-it-was",
        "after, with `fitted.yaml`": "model-fitted",
    },
}
UNITS = {"nm": 1e-9, "µm": 1e-6}
NEAR = 0.15  # relative: a figure of two digits, on another machine


@pytest.fixture
def reader(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Reader]:
    someone = Reader(tmp_path, request.param)
    yield someone
    someone.closes()


def reads(reader: Reader, lines: list[str], script: str = "") -> None:
    """Type them all, but what sets up this very environment and what needs a record that is not there.

    The page's Python follows, while what goes on goes on.
    """
    for line in lines:
        if line.startswith(("make ", *NIGHTLY)) or ("EMPS" in line.upper() and not DATA.is_file()):
            continue
        if line.startswith(GO_ON):
            reader.ends()
            reader.begins(line)
            continue
        outcome = reader.types(_shorter(line))
        good = (0, 1) if line.startswith(MAY_SAY_NO) else (0,)
        if outcome.returncode not in good or "Traceback" in outcome.stderr:
            pytest.fail(f"{line}\n{outcome.stdout}\n{outcome.stderr}\n{reader.elsewhere()}")
    if script:
        (reader.folder / "page.py").write_text(script, encoding="utf-8")
        outcome = reader.types("python page.py")
        assert outcome.returncode == 0, f"{script}\n{outcome.stderr}\n{reader.elsewhere()}"
    reader.ends()


def _shorter(line: str) -> str:
    command, hash_, comment = line.partition(" #")
    more = next((words for start, words in SHORTER.items() if line.startswith(start)), "")
    return f"{command.rstrip()}{more} {hash_}{comment}"


PAGES = [
    *(("README.md", 4), ("index.md", 2), ("bench.md", 8), ("adding.md", 1), ("faults.md", 5)),
    *(("drives.md", 2), ("simulators.md", 6), ("identification.md", 10), ("service.md", 14)),
    *(("tutorial-simulate.md", 9), ("tutorial-bench.md", 8), ("tutorial-log.md", 14)),
]


TYPED = [(page, least) for page, least in PAGES if WHOLE or page not in REPEATING]


@pytest.mark.parametrize(("reader", "least"), TYPED, indirect=["reader"], ids=[page for page, _ in TYPED])
def test_every_command_runs_as_printed(reader: Reader, least: int, request: pytest.FixtureRequest) -> None:
    """In order, in one folder, as a reader would.  The diagnosis is put there: it takes minutes."""
    page = str(request.node.callspec.id)
    if DATA.is_file():
        (reader.folder / DATA.name).symlink_to(DATA)
    lines = commands(page)
    for line in lines:
        if line.startswith(SLOW):
            folder = reader.folder / line.split()[3]
            folder.mkdir()
            save(found("effects"), folder)
    assert sum("stagectl" in line for line in lines) >= least
    reads(reader, [line for line in lines if not line.startswith(SLOW)], python(page))
    for row, name in FIGURES.get(page, {}).items():
        recording = open_recording(reader.folder / "recordings" / f"{name}.h5")
        seen = evaluate(recording.samples, recording.meta)["tracking_error"]
        printed = printed_errors(page, row)
        assert printed, f"{page}: no error in the row {row}"
        assert printed == pytest.approx({kind: seen[kind] for kind in printed}, rel=NEAR)


def printed_errors(page: str, row: str) -> dict[str, float]:
    """Peak and rms (m) in a row of a table, as its head calls the columns."""
    lines = text(page).splitlines()
    at = next(number for number, line in enumerate(lines) if line.startswith(f"| {row} |"))
    head = next(lines[number - 1] for number in range(at, 0, -1) if lines[number].startswith("|---"))
    cells = zip(head.split("|"), lines[at].split("|"), strict=True)
    named = [
        (kind, cell.split()) for title, cell in cells for kind in ("peak", "rms") if kind in re.split(r"\W+", title)
    ]
    return {kind: float(words[0]) * UNITS[words[1]] for kind, words in named if words[-1] in UNITS}


@pytest.mark.parametrize("reader", ["index.md"], indirect=True)
def test_a_line_that_fails_beside_a_service_says_what_the_service_saw(reader: Reader) -> None:
    with pytest.raises(pytest.fail.Exception) as caught:
        reads(reader, ["stagectl serve config/ball-screw.yaml", "stagectl jog nonsense"])
    said = str(caught.value)
    assert str(reader.folder / "stagectl" / "control.sock") in said.partition("the other terminal:")[2]
    assert "no fault" in said.partition("stagectl fault list:")[2]


def test_every_page_with_commands_is_read() -> None:
    assert {page.name for page in DOCS.glob("*.md") if commands(page.name)} <= {page for page, _ in PAGES}


def used(lines: list[str]) -> set[tuple[str, str]]:
    """Each verb in these lines, with each of its options and without."""
    found = set()
    for words in (shlex.split(line, comments=True) for line in lines):
        verb = " ".join(words[1:3] if words[1] in GROUPS else words[1:2])
        found |= {(verb, ""), *((verb, word) for word in words if word.startswith("-"))}
    return found


def test_what_is_left_to_the_night_is_typed_by_day_on_another_page() -> None:
    typed = [(page, line) for page, _ in PAGES for line in commands(page) if line.startswith("stagectl ")]
    night = [line for page, line in typed if page in REPEATING or line.startswith(REPEATED)]
    day = [line for page, line in typed if page not in REPEATING and not line.startswith((*PAPERS, *REPEATED))]
    assert used(night) - ELSEWHERE <= used(day)


@pytest.mark.skipif(bool(NIGHTLY), reason="takes a minute: `make nightly`; `tests/gap` closes such a gap")
@pytest.mark.parametrize("reader", ["tutorial-log.md"], indirect=True)
def test_the_gap_of_the_tutorial_is_found(reader: Reader) -> None:
    """The slow commands of the tutorial, whole, and their answer."""
    slow = ("sed ", "stagectl gap record", *SLOW)
    lines = [line for line in commands("tutorial-log.md") if line.startswith(slow)]
    assert len(lines) == 3
    for line in lines:
        outcome = reader.types(line)
        assert outcome.returncode == 0, outcome.stderr
    bar, answer = outcome.stderr.strip().splitlines()[:2]
    assert bar.startswith("diagnosis") and "100 %" in bar
    assert re.match(r"effects: (99|100) % of the closable gap is viscous asymmetry \(size 0\.1\)", answer), answer
    assert f"<pre>{lines[-1]}" in (reader.folder / "session" / "diagnosis.html").read_text()  # how to do it again


def spoken() -> Iterator[tuple[str, str]]:
    """Every command within a sentence or a block, by its page."""
    for page in ("README.md", *sorted(path.name for path in DOCS.glob("*.md"))):
        typed = [line for line in commands(page, "sh|console") if "stagectl " in line.partition(" #")[0]]
        for line in (*WITHIN.findall(text(page)), *typed):
            yield page, line
    for _, verb in verbs():
        yield "help", (verb.help or "").partition("Example: ")[2].splitlines()[0]


@pytest.mark.parametrize(("page", "line"), sorted(set(spoken())))
def test_what_a_sentence_names_exists(page: str, line: str) -> None:
    """Its verb, and each of its options."""
    words = shlex.split(line.replace("'s ", " ").partition(" #")[0])
    command = ROOT_COMMAND
    for word in words[words.index(next(program for program in words if program.endswith("stagectl"))) + 1 :]:
        if hasattr(command, "commands"):
            assert word in command.commands, line
            command = command.commands[word]
        elif word.startswith("-") and word != "-":
            assert word.partition("=")[0] in {option for param in command.params for option in param.opts}, line
    assert not hasattr(command, "commands"), f"{line} names a group, not a verb"
