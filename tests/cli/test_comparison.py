"""learn and compare as commands: what they keep, say and refuse; and a layer that is off is absent."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stagectl.recording.hdf5 import open_recording
from tests.cli.conftest import Command
from tests.conftest import CONFIG

STAGE = CONFIG / "ball-screw.yaml"
SHORT = "type: sine\namplitude: 1 mm\nfrequency: 3.2 Hz\nperiods: 1\nramp: 0.5\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty folder with a short motion, and a noisy stage."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("STAGECTL_KERNELS", "compiled")
    Path("sine.yaml").write_text(SHORT)
    text = STAGE.read_text()
    assert "simulation:\n" in text and "control:\n" in text
    Path("noisy.yaml").write_text(text.replace("simulation:\n", "simulation:\n  current_noise: 0.045 A\n"))
    Path("watched.yaml").write_text(text.replace("control:\n", "control:\n  layers: [ptc, observer]\n"))


def result(out: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(out)
    return found


def test_learn_keeps_a_current_that_simulate_uses(command: Command) -> None:
    code, out, err = command(
        "learn", STAGE, "sine.yaml", "--simulate", "--without", "friction", "--trials", 4, "-o", "l.h5", "--json", "-"
    )
    assert code == 0, err
    found = result(out)
    peaks = [trial["tracking_error"]["peak"] for trial in found["trials"]]
    assert len(peaks) == 4
    assert peaks[-1] < 0.06 * peaks[0]
    assert (found["kept"], found["layers"], found["stopped"]) == (4, ["ptc"], "")
    assert found["convergence"][0]["most"] == pytest.approx(0.2, abs=1e-3)
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
    found = {}
    for name, arguments in (
        ("absent.h5", (STAGE, "sine.yaml", "--without", "friction")),
        ("off.h5", ("watched.yaml", "sine.yaml", "--without", "observer")),
        ("on.h5", ("watched.yaml", "sine.yaml")),
    ):
        code, _, err = command("simulate", *arguments, "-o", name)
        assert code == 0, err
        found[name] = open_recording(Path(name)).samples
    assert found["absent.h5"].tobytes() == found["off.h5"].tobytes()
    assert np.all(found["off.h5"]["observer"] == 0.0)
    assert np.all(found["off.h5"]["learned"] == 0.0)
    assert np.ptp(found["on.h5"]["observer"]) > 1.0
    assert not np.array_equal(found["on.h5"]["measured"], found["off.h5"]["measured"])


def test_compare_says_what_helps(command: Command) -> None:
    code, out, err = command(
        *("compare", "noisy.yaml", "sine.yaml", "off", "ptc", "ptc+observer", "ptc+ilc", "--simulate"),
        *("--repeats", 3, "--trials", 3, "-o", "there", "--json", "-"),
    )
    assert code == 0, err
    found = result(out)
    means = {one["name"]: one["peak"]["mean"] for one in found["variants"]}
    assert means["ptc"] < means["off"]
    assert 0.8 < means["ptc+observer"] / means["ptc"] < 0.95
    assert means["ptc+ilc"] < 0.2 * means["ptc"]
    assert found["best"] == "ptc+ilc"
    assert not found["identical"]
    assert all(one["certain"] for one in found["against_first"]["peak"])
    assert sorted(found["order"][0]) == sorted(means)
    assert "ptc+ilc cuts the peak error from " in err
    assert "all 3 of 3 repeats agree (95 %: " in err
    page = Path(found["report"]).read_text()
    assert page.count("<img src=") == 3
    assert "ptc+ilc learned from 3 trials: " in page
    recordings = [Path(path) for one in found["variants"] for path in one["recordings"]]
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
    found = result(out)
    assert found["identical"]
    assert found["against_first"]["peak"][0]["low"] is None
    assert "All 2 repeats are identical: nothing varied from run to run" in err
    assert "ptc+friction: the peak error goes from " in err


REFUSED = [
    (("ptc", "pct"), "pct: no layer 'pct'; write off, or some of ptc, friction, observer, ilc with +"),
    (("ptc",), "ptc: at least two variants, each once"),
    (("ptc+friction", "friction+ptc"), "at least two variants, each once"),
    (("ptc+ptc", "off"), "ptc+ptc: a layer stands there twice"),
    (("off", "ptc", "--learned", "none.h5"), "none.h5: no such file; `stagectl learn` writes one"),
    (("off", "ptc", "--plant", "noisy.yaml"), "--plant noisy.yaml without --simulate"),
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
