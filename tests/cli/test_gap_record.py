"""gap record: what it keeps, how it goes on after a stop, and what it refuses."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from stagectl.config.stage_file import load_stage
from stagectl.drives.drive import DriveError
from stagectl.gap.experiment_design.battery import battery, held_out
from stagectl.recording.hdf5 import open_recording
from stagectl.service import virtual_drive
from stagectl.workflows import campaign, simulated_motion
from stagectl.workflows import motion as session
from tests.cli.conftest import Command
from tests.conftest import CONFIG

STAGE = CONFIG / "ball-screw.yaml"
QUICK = ("--only", "sine-strong,check-micro")
NOISE = "simulation:\n  current_noise: 20 mA\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty folder, and a noisy stage."""
    monkeypatch.chdir(tmp_path)
    text = STAGE.read_text()
    assert text.count("simulation:\n") == 1
    Path("noisy.yaml").write_text(text.replace("simulation:\n", NOISE))


def recordings(folder: str) -> list[str]:
    return sorted(path.name for path in Path(folder).glob("*.h5"))


def test_repeats_are_interleaved_and_each_has_its_noise(command: Command) -> None:
    code, out, err = command("gap", "record", "noisy.yaml", *QUICK, "--simulate", "-o", "there", "--json", "-")
    assert code == 0, err
    answer = json.loads(out)
    runs = [(run["experiment"], run["repeat"], run["use"]) for run in answer["runs"]]
    strong, check = ("sine-strong", "diagnose"), ("check-micro", "held-out")
    rounds = [(strong, 1), (check, 1), (strong, 2), (check, 2), (strong, 3)]  # two of what is held out
    assert runs == [(name, repeat, use) for (name, use), repeat in rounds]
    assert answer["left"] == [] and answer["stopped"] == "" and answer["notes"] == []
    starts = [run["start_s"] for run in answer["runs"]]
    assert starts[0] == 0.0
    assert np.diff(starts) == pytest.approx([3.2, 3.62] * 2, abs=0.01)  # the motion, its standstill, and a pause
    assert "5 runs of 2 experiments, 0.2 min of motion, to there" in err
    assert "next: stagectl gap diagnose there" in err
    first, second = (open_recording(Path(f"there/sine-strong-{k}.h5")) for k in (1, 2))
    assert first.meta["capture"] == {"experiment": "sine-strong", "repeat": 1, "use": "diagnose", "start_s": 0.0}
    assert first.complete and first.meta["files"]["trajectory"]["name"] == "sine-strong.yaml"
    differs = first.column("measured_current") - second.column("measured_current")
    assert 0.5 < np.std(differs) / (np.sqrt(2.0) * 0.02) < 1.5  # 20 mA of noise each, through the current loop's lag
    assert not Path("there/unfinished").exists()


def test_a_folder_of_captures_keeps_use_and_clock(command: Command) -> None:
    command("gap", "record", STAGE, *QUICK, "--simulate", "-o", "there", "--repeats", 1)
    files = [f"there/{name}" for name in recordings("there")]
    code, _, err = command("export", *files, "--to", "folder", "-o", "captures")
    assert code == 0, err
    entries = {
        capture["experiment"]: capture
        for capture in yaml.safe_load(Path("captures/captures.yaml").read_text())["captures"]
    }
    assert (entries["sine-strong"]["use"], entries["check-micro"]["use"]) == ("diagnose", "held-out")
    assert entries["check-micro"]["start_s"] == pytest.approx(3.2, abs=0.01)


def test_what_is_the_same_each_time_is_said(command: Command) -> None:
    code, _, err = command("gap", "record", STAGE, "--only", "check-micro", "--simulate", "-o", "there")
    assert code == 0
    assert "the repeats of check-micro are identical to the last bit" in err
    code, _, err = command("gap", "record", STAGE, "--only", "check-micro", "--simulate", "--repeats", 1)
    assert code == 0
    assert "one repeat only" in err


def test_a_machine_warms_up_on_the_clock_of_the_session(command: Command) -> None:
    """The second run starts 3.2 s later: exp(-3.2 / 30) of a rise of 30 % in viscous friction is left.

    At the largest current, 1.2 s into the run, D falls from 1.288 to 1.259 of its warm value; of ``|J w^2 + i D w|`` at
    5 Hz it makes a quarter in square, so the current falls by half a per cent.
    """
    text = STAGE.read_text()
    warm = "  viscous: 0.14 N m s/rad\n  viscous_warming: {rise: 0.3, time: 30 s}\n"
    Path("plant.yaml").write_text(text.replace("  viscous: 0.14 N m s/rad\n", warm))
    arguments = ("--only", "sine-strong", "--repeats", 2, "--simulate", "--plant", "plant.yaml", "-o", "there")
    code, _, err = command("gap", "record", STAGE, *arguments)
    assert code == 0, err
    assert "identical" not in err
    peaks = [np.abs(open_recording(Path(f"there/sine-strong-{k}.h5")).column("command")).max() for k in (1, 2)]
    assert 1.0035 < peaks[0] / peaks[1] < 1.0065


def stopping(at: int, words: str) -> Any:
    """`pretend` whose run number `at` ends in a fault, or in an interrupt."""
    count = itertools.count(1)

    def pretended(*arguments: Any) -> dict[str, Any]:
        answer = simulated_motion.pretend(*arguments)
        if next(count) != at:
            return answer
        if not words:
            raise KeyboardInterrupt
        return answer | {"fault": words}

    return pretended


@pytest.mark.parametrize(
    ("fault", "said", "ends"), [("following error at 0.2 s", "following error at 0.2 s", 1), ("", "interrupted", 130)]
)
def test_stopped_it_goes_on_where_it_was(
    command: Command, monkeypatch: pytest.MonkeyPatch, fault: str, said: str, ends: int
) -> None:
    arguments = ("gap", "record", "noisy.yaml", *QUICK, "--simulate", "-o", "there", "--json", "-")
    monkeypatch.setattr(campaign, "pretend", stopping(3, fault))
    code, out, err = command(*arguments)
    assert code == ends
    answer = json.loads(out)
    assert answer["stopped"].startswith(said)
    assert answer["left"] == ["sine-strong-2", "check-micro-2", "sine-strong-3"]
    assert f"sine-strong-2: {said}" in err
    assert "2 of 5 runs are kept in there; the same command with -o there goes on with sine-strong-2" in err
    assert "--skip sine-strong leaves that experiment out" in err
    assert recordings("there") == ["check-micro-1.h5", "sine-strong-1.h5"]
    assert Path("there/unfinished/sine-strong-2.h5").is_file()
    kept = Path("there/sine-strong-1.h5").read_bytes()
    monkeypatch.setattr(campaign, "pretend", stopping(-1, ""))
    code, out, err = command(*arguments)
    assert code == 0, err
    assert "2 of 5 runs are in there already: going on with sine-strong-2" in err
    assert len(json.loads(out)["runs"]) == 5
    assert Path("there/sine-strong-1.h5").read_bytes() == kept
    assert not Path("there/unfinished").exists()
    monkeypatch.setattr(campaign, "pretend", lambda *_: pytest.fail("nothing is left to be made"))
    assert command(*arguments)[0] == 0


def test_a_first_run_that_cannot_be_made_is_an_error(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: Any) -> dict[str, Any]:
        raise DriveError("no drive answers")

    monkeypatch.setattr(campaign, "perform", refused)
    code, out, err = command("gap", "record", STAGE, *QUICK, "-o", "there")
    assert (code, out) == (2, "")
    assert "error: no drive answers" in err
    assert recordings("there") == []


def test_over_the_bus_each_run_has_its_seed_and_its_time(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """A virtual drive that is started for a run takes its noise from the run's number; the clock is the wall's."""
    seeds = list[int]()
    clock: Iterator[float] = itertools.count(1e9, 100.0)

    def run(motion: Any, *_: Any) -> dict[str, Any]:
        seeds.append(motion.setup.file.simulation.seed)
        return simulated_motion.pretend(motion)

    monkeypatch.setattr(campaign, "perform", run)
    monkeypatch.setattr("time.time", lambda: next(clock))
    code, out, err = command("gap", "record", "noisy.yaml", *QUICK, "-o", "there", "--seed", 5, "--json", "-")
    assert code == 0, err
    names = [experiment.name for experiment in (*battery(load_stage(STAGE)), *held_out(load_stage(STAGE)))]
    numbers = [names.index("sine-strong"), names.index("check-micro")]
    expected = [5 + repeat + 1000 * number for repeat in (1, 2, 3) for number in numbers]
    assert seeds == expected[:5]
    starts = [run["start_s"] for run in json.loads(out)["runs"]]
    assert starts == [100.0, 200.0, 300.0, 400.0, 500.0]


def test_a_virtual_drive_is_told_its_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = list[int]()

    def started(_: Path, __: str, seed: int, ___: int) -> None:
        numbers.append(seed)
        raise DriveError("far enough")

    monkeypatch.setattr(virtual_drive, "answers", lambda _: False)
    monkeypatch.setattr(virtual_drive, "start", started)
    setup = session.reseeded(load_stage(STAGE), 2**31 + 4)
    with suppress(DriveError), session.drive_present(setup, lambda _: None):
        pass
    assert numbers == [4]


REFUSED = [
    (("--only", "stars"), "--only stars: no such experiment; the experiments are: sine-slow, "),
    (("--simulate", "--skip", "star"), "--skip star: no such experiment; the experiments are: sine-slow, "),
    (("--simulate", *QUICK, "--skip", QUICK[1]), "--skip leaves no experiment to record"),
    (
        ("--plant", "noisy.yaml"),
        "the runs are on a drive, which has its own machine; add --simulate",
    ),
    (("--simulate", "--seed", "7", *QUICK, "-o", "there"), "was recorded with another machine, simulation or seed"),
    (("--simulate", "--plant", STAGE, *QUICK, "-o", "there"), "was recorded with another machine, simulation or seed"),
]


@pytest.mark.parametrize(("arguments", "words"), REFUSED)
def test_what_it_refuses(command: Command, arguments: tuple[Any, ...], words: str) -> None:
    if "there" in arguments:
        command("gap", "record", "noisy.yaml", *QUICK, "--simulate", "--repeats", 1, "-o", "there")
    code, out, err = command("gap", "record", "noisy.yaml", *arguments)
    assert (code, out) == (2, "")
    assert words in " ".join(err.split())


def test_a_folder_belongs_to_one_stage(command: Command) -> None:
    command("gap", "record", "noisy.yaml", *QUICK, "--simulate", "--repeats", 1, "-o", "there")
    code, _, err = command("gap", "record", CONFIG / "emps.yaml", *QUICK, "--simulate", "-o", "there")
    assert code == 2
    assert "sine-strong.yaml is another motion than the one for" in err
    Path("changed.yaml").write_text(Path("noisy.yaml").read_text().replace("20 mA", "21 mA"))
    code, _, err = command("gap", "record", "changed.yaml", *QUICK, "--simulate", "-o", "there")
    assert code == 2
    assert "was recorded with another stage file or trajectory than this campaign has" in err
