"""The ten mistakes that people make first: each ends in words that name the cause and what to type next."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import typer

from stagectl.cli.streams import usage_error
from stagectl.replacing import PAGE
from stagectl.web import client
from tests.cli.conftest import Command
from tests.conftest import CONFIG
from tests.identification.synthetic import motion, write_csv

STAGE, SINE = CONFIG / "ball-screw.yaml", CONFIG / "trajectories" / "sine-1.6hz.yaml"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in, with a bus of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path


def stage_with(old: str, new: str) -> Path:
    text = STAGE.read_text()
    assert old in text
    path = Path("stage.yaml")
    path.write_text(text.replace(old, new, 1))
    return path


def ends(outcome: tuple[int, str, str], *words: str) -> None:
    """Exit 2, without a result and without a traceback, and with all of the `words`."""
    code, out, err = outcome
    assert (code, out) == (2, ""), err
    assert "Traceback" not in err
    for word in words:
        assert word in err, err


def test_wrong_unit(command: Command) -> None:
    stage = stage_with("lead: 12 mm", "lead: 12 kg")
    ends(command("simulate", stage, SINE), "axis.lead = 12 kg", "(stage.yaml:8)", "stagectl config check stage.yaml")


def test_swapped_sign(command: Command, folder: Path) -> None:
    """A log whose current has the other sign would give a negative inertia."""
    columns = motion()
    columns["measured_current"] = -columns["measured_current"]
    write_csv(folder / "log.csv", columns)
    ends(
        command("identify", "least-squares", STAGE, "log.csv"),
        "the current has the opposite sign",
        "turn the sign in the log",
        "--doubtful",
    )


def test_wrong_node_id(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """The drive has another id than the stage file says: who does answer is told."""
    from stagectl.drives.bus.embedded import Embedded
    from stagectl.drives.bus.frames import frame, parse

    class Answering(Embedded):
        """A bus on which node 5 answers, and nobody else."""

        def send(self, frame_: bytes) -> None:
            identifier, data = parse(frame_)
            if identifier == 0x605:
                self.waiting.append(frame(0x585, b"\x43" + data[1:4] + bytes.fromhex("92 01 02 00")))

        def receive(self, timeout: float) -> bytes | None:
            return self.waiting.pop(0) if self.waiting else None

        waiting: list[bytes] = []  # noqa: RUF012

    monkeypatch.setattr("stagectl.workflows.motion.open_bus", lambda *_: Answering("alone"))
    monkeypatch.setattr("stagectl.workflows.motion.drive_present", lambda *_: contextlib.nullcontext())
    stage = stage_with("node: 5", "node: 9")
    ends(
        command("drive", "probe", stage),
        "node 9 does not answer",
        "node 5 does: set 'node: 5'",
        f"stagectl doctor {stage}",
    )


def test_bus_down(command: Command) -> None:
    stage = stage_with("interface: embedded", "interface: socketcan")
    stage.write_text(stage.read_text().replace("channel: stage", "channel: can7"))
    ends(command("run", stage, SINE), "sudo ", "can")


def test_no_permission(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """The control socket belongs to another group."""

    def refused(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(client._UnixConnection, "connect", refused)
    ends(command("enable", "--socket", "control.sock"), "usermod -aG", "sudo usermod -aG stagectl $USER")


def test_drive_in_fault(folder: Path) -> None:
    """The drive trips in mid motion: exit 1, what it said, and how to go on."""
    faults = "\nvirtual_drive:\n  faults: [{fault: drive-fault, after: 0.05 s}]\n"
    (folder / "stage.yaml").write_text(STAGE.read_text() + faults)
    short = "type: sine\namplitude: 1 mm\nfrequency: 2 Hz\nperiods: 1\n"
    (folder / "motion.yaml").write_text(short)
    done = subprocess.run(
        [sys.executable, "-m", "stagectl", "run", "stage.yaml", "motion.yaml"],
        capture_output=True,
        text=True,
        timeout=200,
        env=dict(os.environ),
    )
    assert done.returncode == 1, done.stderr
    for words in ("stopped after", "0x2310", "Remove the cause", "--reset-fault", "stagectl run stage.yaml"):
        assert words in done.stderr, done.stderr
    assert "Traceback" not in done.stderr


def test_limit_too_small(command: Command) -> None:
    stage = stage_with("speed: 300 mm/s", "speed: 10 mm/s")
    ends(
        command("simulate", stage, SINE),
        "limits.speed = 10 mm/s",
        "the trajectory needs 50.2655 mm/s",
        "raise the limit (stage.yaml:",
    )


def test_capture_too_short(command: Command, folder: Path) -> None:
    write_csv(folder / "log.csv", {name: values[:40] for name, values in motion().items()})
    ends(command("identify", "least-squares", STAGE, "log.csv"), "log.csv", "record longer", "stagectl record --for")


def test_stale_schema(command: Command) -> None:
    """A recording of another version, and a stage file with an entry of another."""
    with h5py.File("old.h5", "w") as file:
        file.attrs["format"] = "stagectl-recording/0"
        file["samples"] = np.zeros(3)
    ends(command("replay", "old.h5"), "format 0", "stagectl export FILE --to csv", "stagectl import FILE.csv")
    stage = stage_with("viscous: 0.14", "viscosity: 0.14")
    ends(command("simulate", stage, SINE), "viscosity is not known: did you mean viscous?", "config check stage.yaml")


def test_files_in_each_others_place(command: Command) -> None:
    """Both are good; what is wrong is their order."""
    ends(command("simulate", SINE, STAGE), "is a valid trajectory file", "the stage file comes first")


def test_layers_and_variants_are_words_of_their_own(command: Command) -> None:
    ends(command("simulate", STAGE, SINE, "--without", "friction,ptc"), "--without friction --without ptc")
    ends(command("compare", STAGE, SINE, "off,ptc", "--simulate"), "blanks separate variants: off ptc")


def test_a_layer_that_a_stage_does_not_have_is_said_to_change_nothing(command: Command) -> None:
    code, out, err = command("simulate", STAGE, SINE, "--without", "cogging", "--without", "ptc")
    assert (code, out) == (0, "")
    assert [line for line in err.splitlines() if "note" in line] == [
        f"note: --without cogging changes nothing: the model in {STAGE} has none"
    ]


def test_a_file_that_may_not_be_read() -> None:
    words = usage_error(typer.BadParameter("Path 'secret.yaml' is not readable."))
    assert "`ls -l secret.yaml`" in words and "`chmod u+r secret.yaml`" in words


def test_no_port_of_a_virtual_drive(command: Command) -> None:
    odrive = CONFIG / "odrive.yaml"
    ends(command("run", odrive, SINE), "drive.wire.port = odrive", f"stagectl virtual-drive {odrive}")


def test_a_stage_file_in_place_of_a_recording(command: Command) -> None:
    ends(command("replay", STAGE), "is a YAML file", "a recording (.h5) belongs here")


def test_a_python_file_that_python_cannot_import(command: Command) -> None:
    ends(command("export", STAGE, "--to", "isaac", "-o", "ball-screw.py"), "take -o ball_screw.py")
    assert not Path("ball-screw.py").exists()


def test_port_taken(command: Command, folder: Path) -> None:
    """Another service has the control socket."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as other:
        other.bind("control.sock")
        other.listen()
        ends(
            command("serve", STAGE, "--socket", "control.sock", "--state", "state"),
            "a service listens on control.sock already",
            "another --socket",
        )


@pytest.mark.parametrize("second", ["q.h5", "./q.h5"])
def test_one_name_for_two_results(command: Command, second: str) -> None:
    ends(command("simulate", STAGE, SINE, "-o", "q.h5", "--json", second), "--output", "--json", "q.h5")
    assert not Path("q.h5").exists()


def test_json_over_a_result_of_the_same_command(command: Command) -> None:
    """The name that the page gets by itself."""
    assert command("simulate", STAGE, SINE, "-o", "q.h5")[0] == 0
    ends(command("report", "q.h5", "--json", "q.html"), "q.html")
    assert PAGE in Path("q.html").read_text()


@pytest.mark.parametrize(
    ("redirected", "code", "words"),
    [
        (">&-", 2, "standard output is closed"),
        ("> /dev/full", 2, "standard output: No space left"),
        ("2>&-", 0, ""),
    ],
)
def test_a_standard_stream_that_takes_nothing(redirected: str, code: int, words: str) -> None:
    """Neither is a result lost in silence, nor do messages go into it."""
    typed = f"{sys.executable} -m stagectl config schema --json - {redirected}"
    if code == 0:
        typed = f"{sys.executable} -m stagectl simulate {STAGE} {SINE} -o a.h5 --json - {redirected}"
    done = subprocess.run(["bash", "-c", typed], capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, words in done.stderr, "Traceback" in done.stderr) == (code, True, False)
    if code == 0:
        assert json.loads(done.stdout)["recording"] == "a.h5"
