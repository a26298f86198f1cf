"""learn and compare as commands: what they keep, say and refuse; and a layer that is off is absent."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stagectl.recording.hdf5 import open_recording
from stagectl.recording.learned_current import load
from stagectl.workflows import simulated_motion as session
from stagectl.workflows import trials
from tests.cli.conftest import Command
from tests.conftest import CONFIG

STAGE = CONFIG / "ball-screw.yaml"
SHORT = "type: sine\namplitude: 1 mm\nfrequency: 3.2 Hz\nperiods: 1\nramp: 0.5\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty folder with a short motion, and a noisy stage."""
    monkeypatch.chdir(tmp_path)
    Path("sine.yaml").write_text(SHORT)
    text = STAGE.read_text()
    assert "simulation:\n" in text and "control:\n" in text
    Path("noisy.yaml").write_text(text.replace("simulation:\n", "simulation:\n  current_noise: 0.045 A\n"))
    Path("watched.yaml").write_text(text.replace("control:\n", "control:\n  layers: [ptc, observer]\n"))


def result(out: str) -> dict[str, Any]:
    answer: dict[str, Any] = json.loads(out)
    return answer


def test_learn_keeps_a_current_that_simulate_uses(command: Command) -> None:
    code, out, err = command(
        "learn", STAGE, "sine.yaml", "--simulate", "--without", "friction", "--trials", 4, "-o", "l.h5", "--json", "-"
    )
    assert code == 0, err
    answer = result(out)
    peaks = [trial["tracking_error"]["peak"] for trial in answer["trials"]]
    assert len(peaks) == 4
    assert peaks[-1] < 0.06 * peaks[0]
    assert (answer["kept"], answer["layers"], answer["stopped"]) == (4, ["ptc"], "")
    assert answer["convergence"][0]["most"] == pytest.approx(0.2, abs=1e-3)
    assert "trial 4: tracking error peak" in err
    assert "held by rolling friction would grow; with learning.cutoff at 70 Hz it shrinks everywhere" in err
    code, out, err = command(
        "simulate", STAGE, "sine.yaml", "--without", "friction", "--learned", "l.h5", "-o", "s.h5", "--json", "-"
    )
    assert code == 0, err
    assert result(out)["tracking_error"]["peak"] == peaks[-1]
    assert np.ptp(open_recording(Path("s.h5")).samples["learned"]) > 1.0
    code, out, err = command("simulate", STAGE, "sine.yaml", "--learned", "l.h5")
    assert (code, out) == (2, "")
    assert "l.h5 was learned with the layers ptc, this run has friction+ptc; nothing has moved" in err


def test_layers_that_are_off_are_absent(command: Command) -> None:
    """Every column of the recording, bit for bit: observer and learning switched off, and never there."""
    recording = {}
    for name, arguments in (
        ("absent.h5", (STAGE, "sine.yaml", "--without", "friction")),
        ("off.h5", ("watched.yaml", "sine.yaml", "--without", "observer")),
        ("on.h5", ("watched.yaml", "sine.yaml")),
    ):
        code, _, err = command("simulate", *arguments, "-o", name)
        assert code == 0, err
        recording[name] = open_recording(Path(name)).samples
    assert recording["absent.h5"].tobytes() == recording["off.h5"].tobytes()
    assert np.all(recording["off.h5"]["observer"] == 0.0)
    assert np.all(recording["off.h5"]["learned"] == 0.0)
    assert np.ptp(recording["on.h5"]["observer"]) > 1.0
    assert not np.array_equal(recording["on.h5"]["measured"], recording["off.h5"]["measured"])


def test_compare_says_what_helps(command: Command) -> None:
    code, out, err = command(
        *("compare", "noisy.yaml", "sine.yaml", "off", "ptc", "ptc+observer", "ptc+ilc", "--simulate"),
        *("--repeats", 3, "--trials", 3, "-o", "there", "--json", "-"),
    )
    assert code == 0, err
    answer = result(out)
    means = {variant["name"]: variant["peak"]["mean"] for variant in answer["variants"]}
    assert means["ptc"] < means["off"]
    assert 0.8 < means["ptc+observer"] / means["ptc"] < 0.95
    assert means["ptc+ilc"] < 0.2 * means["ptc"]
    assert answer["best"] == "ptc+ilc"
    assert not answer["identical"]
    assert all(difference["certain"] for difference in answer["against_first"]["peak"])
    assert sorted(answer["order"][0]) == sorted(means)
    assert "ptc+ilc cuts the peak error from " in err
    assert "all 3 of 3 repeats agree (95 %: " in err
    page = Path(answer["report"]).read_text()
    assert page.count("<img src=") == 3
    assert "ptc+ilc learned from 3 trials: " in page
    recordings = [Path(path) for variant in answer["variants"] for path in variant["recordings"]]
    assert len(recordings) == 12
    assert all(path.is_file() for path in recordings)
    last = open_recording(Path("there/repeat-3-ptc+observer.h5"))
    assert last.meta["layers"] == ["observer", "ptc"]
    assert np.ptp(last.samples["observer"]) > 1.0


def test_identical_repeats_are_said_to_be(command: Command) -> None:
    code, out, err = command(
        "compare", STAGE, "sine.yaml", "ptc", "ptc+friction", "--simulate", "--repeats", 2, "-o", "there", "--json", "-"
    )
    assert code == 0, err
    answer = result(out)
    assert answer["identical"]
    assert answer["against_first"]["peak"][0]["low"] is None
    assert "All 2 repeats are identical: nothing varied from run to run" in err
    assert "ptc+friction: the peak error goes from " in err


REFUSED = [
    (("ptc", "pct"), "pct: no layer 'pct': did you mean ptc?"),
    (("ptc",), "ptc: at least two variants, each once"),
    (("ptc+friction", "friction+ptc"), "at least two variants, each once"),
    (("ptc+ptc", "off"), "ptc+ptc: a layer stands there twice"),
    (("off", "ptc", "--learned", "none.h5"), "none.h5: no such file; `stagectl learn` writes one"),
    (
        ("off", "ptc", "--plant", "noisy.yaml"),
        "the runs are on a drive, which has its own machine; add --simulate",
    ),
]


@pytest.mark.parametrize(("arguments", "words"), REFUSED)
def test_what_compare_refuses(command: Command, arguments: tuple[str, ...], words: str) -> None:
    simulated = () if "--plant" in arguments else ("--simulate",)
    code, out, err = command("compare", STAGE, "sine.yaml", *arguments, *simulated)
    assert (code, out) == (2, "")
    assert words in " ".join(err.split())
    assert not Path("recordings").exists()


def test_an_open_loop_teaches_nothing(command: Command) -> None:
    Path("current.yaml").write_text("type: current_sine\namplitude: 2 A\nfrequency: 5 Hz\nperiods: 2\n")
    code, _, err = command("learn", STAGE, "current.yaml", "--simulate")
    assert code == 2
    assert "there is no tracking error to learn from; take a trajectory that is a motion alone" in err
    code, _, err = command("compare", STAGE, "current.yaml", "off", "ptc", "--simulate")
    assert code == 2
    assert "has no tracking error to compare: its loop is open" in err


def test_a_learning_that_is_stopped_keeps_what_it_has(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """A fault in the third trial: the second one's current is kept, the fault is said, exit 1."""
    real, calls = session.pretend, list[Any]()

    def stopping(motion: Any, *where: Any) -> dict[str, Any]:
        calls.append(motion)
        return real(motion, *where) | ({"fault": "following error at 0.2 s"} if len(calls) == 3 else {})

    monkeypatch.setattr(trials, "pretend", stopping)
    options = ("--simulate", "--without", "friction", "-o", "l.h5", "--json", "-")
    code, out, err = command("learn", STAGE, "sine.yaml", *options)
    assert code == 1
    answer = result(out)
    assert (len(answer["trials"]), answer["kept"]) == (2, 2)
    assert answer["stopped"].startswith("trial 3: the run was stopped: following error at 0.2 s; ")
    assert "it is undone, and what was learned before is kept" in err
    assert np.array_equal(load(Path("l.h5")).current, calls[1].plan.setpoints[:, 5])
    calls.extend([None] * 10)
    monkeypatch.setattr(trials, "pretend", lambda *_: real(*_) | {"fault": "late"})
    code, out, err = command("learn", STAGE, "sine.yaml", *options)
    assert (code, out) == (2, "")
    assert "error: the run was stopped: late; " in err


def test_a_file_that_cannot_be_kept_is_refused_before_anything_moves(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trials, "pretend", lambda *_: pytest.fail("something moved"))
    Path("text.h5").write_text("not a current")
    for target, words in (("text.h5", "text.h5 exists"), ("text.h5/l.h5", "cannot be written"), ("l.csv", "l.h5")):
        code, out, err = command("learn", STAGE, "sine.yaml", "--simulate", "-o", target)
        assert (code, out) == (2, "")
        assert words in err
    assert not Path("recordings").exists() and not Path("l.csv").exists()


def test_what_a_wrong_friction_model_leaves_is_learned(command: Command) -> None:
    """The machine has a tenth more friction than its model: the combination takes what the model leaves over."""
    Path("model.yaml").write_text(STAGE.read_text().replace("coulomb: 1.0 N m", "coulomb: 0.9 N m"))
    code, out, err = command(
        *("compare", "model.yaml", "sine.yaml", "ptc", "ptc+friction", "ptc+friction+ilc", "--plant", STAGE),
        *("--simulate", "--repeats", 1, "--trials", 6, "-o", "there", "--json", "-"),
    )
    assert code == 0, err
    means = {variant["name"]: variant["peak"]["mean"] for variant in result(out)["variants"]}
    assert 0.08 < means["ptc+friction"] / means["ptc"] < 0.14
    assert means["ptc+friction+ilc"] < 0.06 * means["ptc+friction"]
    assert "--repeats 5" in err
    page = Path("there/report.html").read_text()
    assert "one run each" in page and "error [" in page and "after Holm" not in page


COMPENSATORS = """
compensators:
  table:
    displacement: [0 um, 0.6 um, 2 um, 6 um, 18 um]
    force: [-1 N m, -0.39 N m, 0.22 N m, 0.71 N m, 1 N m]
  gms: {weight: [0.4 N m, 0.6 N m], slip: [0.6 um, 5 um]}
"""


def test_compare_takes_compensators_by_name(command: Command) -> None:
    """Each name is the layer friction with that compensator; learning belongs to one of them."""
    Path("several.yaml").write_text(STAGE.read_text() + COMPENSATORS)
    code, out, err = command(
        *("compare", "several.yaml", "sine.yaml", "ptc", "ptc+model", "ptc+friction", "ptc+table", "ptc+gms+ilc"),
        *("--simulate", "--repeats", 1, "--trials", 1, "-o", "there", "--json", "-"),
    )
    assert code == 0, err
    peaks = {variant["name"]: variant["peak"]["mean"] for variant in result(out)["variants"]}
    assert peaks["ptc+model"] == peaks["ptc+friction"] < peaks["ptc+table"] < 0.1 * peaks["ptc"]
    assert load(Path("there/learned-ptc+gms+ilc.h5")).meta["layers"] == ["gms", "ptc"]


@pytest.mark.parametrize("variant", ["ptc+rheology", "ptc+table+gms", "ptc+friction+table"])
def test_compare_refuses_compensators_that_are_not_there_or_two_at_once(command: Command, variant: str) -> None:
    Path("several.yaml").write_text(STAGE.read_text() + COMPENSATORS)
    code, out, err = command("compare", "several.yaml", "sine.yaml", "ptc", variant, "--simulate")
    assert (code, out) == (2, "")
    assert ("compensators.rheology" if "rheology" in variant else variant) in err
