"""Wrong inputs of newcomers: each ends with its exit code, its place in the first two lines, and what to do next."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cli.conftest import Command
from tests.conftest import CONFIG

S, T = "config/ball-screw.yaml", "config/trajectories/sine-1.6hz.yaml"
_HEAD = "time_s,position_rad,current_A"
_ROWS = [f"{k * 1e-3:.3f},{0.5 * math.sin(k * 1e-2):.6f},{math.cos(k * 1e-2):.4f}" for k in range(300)]
# What a person can do: a command, a file or a word that is meant, what is admissible, or an order.
_NEXT = re.compile(
    r"stagectl [a-z]|--help|`ls |[Dd]id you mean|must (be|lie|have|increase|give)|its columns are"
    r"|: known are|give |choose |write it|check |replace |remove |save it|cut the log|python -m "
    r"|write 0x"
    r"|copy it|make room|name the|these can|record a|relative to|nothing has moved|: take |comes (first|before)"
)

_RAW = re.compile(r"codec can't|Expecting |indices must|ErrorID|XML_ERROR")  # a parser's or decoder's own words


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A newcomer's folder, with a bus of its own."""
    shutil.copytree(CONFIG, tmp_path / "config")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    (tmp_path / "folder").mkdir()
    (tmp_path / "good.csv").write_text("\n".join([_HEAD, *_ROWS]) + "\n")
    yield tmp_path
    assert not list((tmp_path / "folder").iterdir())


# A file that holds these bytes; the stage file with one text replaced; a log with these rows.
FILES: dict[str, bytes] = {
    "empty.yaml": b"",
    "latin.yaml": "name: Tisch für\n".encode("latin-1"),
    "glued.yaml": b"type: sine\namplitude:5 mm\nfrequency: 1 Hz\nperiods: 1\n",
    "circle.yaml": b"type: circle\nradius: 1 mm\n",
    "far.yaml": b"type: sine\namplitude: 80 mm\nfrequency: 1 Hz\nperiods: 1\n",
    "angle.yaml": b"type: sine\namplitude: 5 deg\nfrequency: 1 Hz\nperiods: 1\n",
    "picture.csv": bytes(range(256)),
    "log.xlsx": b"PK\x03\x04",
    "log.mat": b"hello" * 100,
    "list.yaml": b"- a\n- b\n",
    "empty.h5": b"",
    "fake.h5": b"not HDF5",
    "short.h5": b"\x89HDF\r\n\x1a\n\x03",
    "cut.h5": b"\x89HDF\r\n\x1a\n\x03\x08\x08\x00" + bytes(16) + (509003).to_bytes(8, "little") + bytes(100),
    "dash.yaml": b"type: sequence\nparts:\n  - {type: dwell, duration: 1 s}\n  type: dwell\n",
    "other.json": b'{"a": 1}',
    "picture.json": b"\x89PNG\r\n",
    "half.json": b'{\n "content": {',
    "list.json": b"[1, 2]",
    "broken.xml": b"<mujoco>\n <worldbody>\n</mujoco>",
    "foreign.xml": b"<robot/>",
}
STAGES = {
    "tabs.yaml": ("  inertia:", "\tinertia:"),
    "comma.yaml": ("0.010 kg", "0,010 kg"),
    "bare.yaml": ("period: 0.5 ms", "period: 0.5"),
    "hertz.yaml": ("period: 0.5 ms", "period: 2 kHz"),
    "typo.yaml": ("viscous:", "viscos:"),
    "twice.yaml": ("  viscous: 0.14 N m s/rad", "  viscous: 0.14 N m s/rad\n  viscous: 0.2 N m s/rad"),
    "negative.yaml": ("inertia: 0.010", "inertia: -0.010"),
    "torque.yaml": ("coulomb: 1.0 N m", "coulomb: 1.0 Nm"),
    "minus.yaml": ("[-50 mm", "[\u221250 mm"),
    "turned.yaml": ("[-50 mm, 50 mm]", "[50 mm, -50 mm]"),
    "eds.yaml": ("stagectl-virtual.eds", "my-drive.eds"),
    "text.eds.yaml": ("drives/stagectl-virtual.eds", "ball-screw.yaml"),
    "index.yaml": ("0x6071_00", "0x6071"),
    "weak.yaml": ("current_limit: 15 A", "current_limit: 1 A"),
    "tight.yaml": ("following_error: 0.2 mm", "following_error: 1 nm"),
    "beyond.yaml": ("[-50 mm, 50 mm]", "[10 mm, 50 mm]"),
    "interface.yaml": ("interface: embedded", "interface: sockecan"),
}
LOGS = {
    "rotary.csv": ["time_s,measured_rad,current_A,measured_current_A", *(f"{row},0" for row in _ROWS)],
    "empty.csv": [],
    "head.csv": [_HEAD],
    "nan.csv": [_HEAD, *(f"{k * 1e-3},nan,nan" for k in range(300))],
    "exported.csv": ["time_s,measured_rad,measured_current_A", *_ROWS],
    "text.csv": [_HEAD, *_ROWS[:100], "0.1,abc,1", *_ROWS[101:]],
    "no-current.csv": [_HEAD.rpartition(",")[0], *(row.rpartition(",")[0] for row in _ROWS)],
    "still.csv": [_HEAD, *(f"{k * 1e-3},0.5,0" for k in range(300))],
    "date.csv": [_HEAD, *(f"2026-01-01T00:00:{row}" for row in _ROWS)],
    "twice.csv": [_HEAD, *_ROWS[:100], _HEAD, *_ROWS[100:]],
    "german.csv": [_HEAD, *(row.replace(".", ",") for row in _ROWS)],
    "back.csv": [_HEAD, *_ROWS[::-1]],
}
# The words typed after `stagectl`; the place that must be named; the exit code.
MISTAKES = [
    (f"simulate config/ballscrew.yaml {T}", "did you mean config/ball-screw.yaml?", 2),
    (f"simulate https://example.com/stage.yaml {T}", "download it first", 2),
    (f"drive accept {S} --yes --person me --current 100A", "--current is 100 A", 2),
    (f"simulate {S} config/trajectories/sine-16hz.yaml", "sine-16hz.yaml", 2),
    (f"simulate config {T}", "config is not a file", 2),
    (f"run {S} config/trajectories", "config/trajectories", 2),
    (f"simulate good.csv {T}", "good.csv:1", 2),
    (f"simulate {T} {S}", "trajectory file", 2),
    (f"simulate {S} {T} --plant {T}", "trajectory file", 2),
    (f"serve {T}", "trajectory file", 2),
    (f"identify least-squares {S} {S}", S, 2),
    ("config check tabs.yaml", "tabs.yaml:14", 1),
    ("config check empty.yaml", "empty.yaml:1", 1),
    ("config check latin.yaml", "latin.yaml:1", 1),
    ("config check comma.yaml", "comma.yaml:14", 1),
    ("config check bare.yaml", "control.period = 0.5", 1),
    ("config check hertz.yaml", "control.period = 2 kHz", 1),
    ("config check typo.yaml", "mechanics.viscos", 1),
    ("config check twice.yaml", "mechanics.viscous", 1),
    ("config check negative.yaml", "mechanics.inertia", 1),
    ("config check turned.yaml", "limits.travel", 1),
    (f"run eds.yaml {T}", "see `ls config/drives`", 2),
    (f"simulate {S} glued.yaml", "a blank after the colon is missing: write 'amplitude: 5 mm' (glued.yaml:2)", 2),
    (f"simulate {S} dash.yaml", "an item of a list begins with `- `", 2),
    (f"simulate {S} circle.yaml", "type = circle", 2),
    (f"simulate {S} far.yaml", "limits.travel", 2),
    (f"simulate {S} {T} --without fricton", "--without fricton", 2),
    (f"tune {S} --margin 30", "--margin 30", 2),
    (f"tune {S} --margin 300deg", "[0, 85.9] deg", 2),
    (f"tune {S} --bandwidth 40kg", "--bandwidth 40kg", 2),
    (f"identify least-squares {S} empty.csv", "empty.csv", 2),
    (f"identify least-squares {S} head.csv", "head.csv", 2),
    (f"identify least-squares {S} nan.csv", "nan.csv", 2),
    (f"import nan.csv --stage {S}", "no number in position_rad, row 1", 2),
    (f"identify least-squares {S} text.csv", "'abc'", 2),
    (f"identify least-squares {S} no-current.csv", "no-current.csv", 2),
    (f"identify least-squares {S} still.csv", "still.csv", 2),
    (f"identify least-squares {S} back.csv", "row 2", 2),
    (f"identify least-square {S} good.csv", "least-square", 2),
    (f"identify {S} good.csv", f"stagectl identify simultaneous {S} good.csv", 2),
    (f"import good.csv --stage {S} --columns time=zeit,position=pos:mm", "zeit", 2),
    (f"import good.csv --stage {S} --columns time=1,position=2:mm,current=2:A", "are both column 2 of good.csv", 2),
    (f"import good.csv --stage {S} --columns zeit", "--columns zeit", 2),
    (f"import picture.csv --stage {S}", "picture.csv", 2),
    ("import log.xlsx", "log.xlsx", 2),
    ("import goood.csv", "did you mean good.csv?", 2),
    ("import log.mat", "log.mat", 2),
    ("replay fake.h5", "fake.h5", 2),
    ("replay short.h5", "short.h5 has 9 of 36 bytes", 2),
    ("replay cut.h5", "of 509003 bytes", 2),
    ("gap diagnose sesion", "sesion", 2),
    (f"gap diagnose {S}", f"give it as --stage {S}", 2),
    ("gap diagnose good.csv --model kind=rotary,force_const=0.7,inertia=1", "did you mean force_constant?", 2),
    ("gap diagnose good.csv --model kind=rotary,force_constant=0.7A,inertia=1", "--model force_constant = 0.7A", 2),
    (f"gap diagnose good.csv --stage {S} --exclude coging", "--exclude coging", 2),
    ("import good.csv --counts -8192", "--counts -8192", 2),
    ("import empty.h5", "empty.h5 is empty", 2),
    ("gap diagnose folder", "folder", 2),
    ("gap diagnose good.csv", "good.csv", 2),
    (f"gap apply folder {S}", "folder", 2),
    (f"gap apply {S} folder", "captures first", 2),
    ("status --socket none/control.sock", "none/control.sock", 2),
    (f"inject {S} encoder-stck", "encoder-stck", 2),
    (f"inject {S} encoder-stuck duration=5kg", "fault.duration = 5kg", 2),
    (f"simulate {S} {T} -o folder", "folder", 2),
    (f"simulate {S} {T} -o good.csv/x.h5", "good.csv", 2),
    ("drive probe interface.yaml", "sockecan", 2),
    ("drive verify other.json", "other.json", 2),
    (f"simulte {S} {T}", "simulte", 2),
    (f"simulate {S} {T} --whitout friction", "--whitout", 2),
    (f"simulate {S}", "TRAJECTORY.yaml", 2),
    (f"simulate {S} {T} {T}", T, 2),
    ("report folder", "folder: it is a folder", 2),
    ("drive verify none.json", "none.json", 2),
    ("drive verify picture.json", "byte 1 is not UTF-8 text", 2),
    ("drive verify half.json", "line 2, column 14", 2),
    ("drive verify list.json", "it has no content", 2),
    (f"drive accept {S} --yes --person Ann --key none.key", "none.key", 2),
    (f"drive accept {S} --yes --person Ann -o picture", "picture.json", 2),  # before anything moves
    ("gap diagnose good.csv --model none.xml", "none.xml", 2),
    ("gap diagnose good.csv --model broken.xml", "broken.xml:3", 2),
    ("gap diagnose good.csv --model foreign.xml", "there are: none; `stagectl export", 2),
    ("record --for 2", "--for 2", 2),
    ("config check weak.yaml", "must lie in (1.389, inf) A (weak.yaml:29)", 1),
    ("config check tight.yaml", "must lie in (1.144e-08, 0.1) m (tight.yaml:57)", 1),
    (f"simulate beyond.yaml {T}", "limits.travel = [10, 50] mm; the motion begins 10 mm outside", 2),
    ("identify least-squares config/linear-slider.yaml exported.csv", "exported.csv has measured_rad", 2),
    ("record --for -1s", "must lie in (0,", 2),
    ("record --before 2h", "must lie in [0,", 2),
    (f"serve {S} --tcp 0.0.0.0:99999", "must lie in [1, 65535]", 2),
    (f"tune 30Hz {S}", "takes STAGE.yaml alone: give `--bandwidth 30Hz`", 2),
    (f"gap close {T} {S}", "gap close` takes STAGE.yaml alone", 2),
    (f"gap record out {S}", "give `-o out`", 2),
    ("replay a.h5 b.h5", "replay` takes RECORDING.h5 alone, not a.h5 b.h5", 2),
    ("enable x", "give `--axis x`", 2),
    (f"inject encoder-stuck {S}", "encoder-stuck is a fault: the stage file comes first", 2),
    (f"inject {S} jump", "fault = jump; is no fault: did you mean encoder-jump", 2),
    (f"selftest {S} --only encoder", "did you mean encoder-", 2),
    (f"compare {S} off ptc {T}", "off is a variant: the trajectory comes before it", 2),
    (f"gap diagnose good.csv --model {S}", f"it is a stage file: take --stage {S}", 2),
    ("gap next fake.h5", "it looks like a recording: give the folder", 2),
    ("gap diagnose rotary.csv --stage config/linear-slider.yaml", "rotary.csv has measured_rad", 2),
    (f"virtual-drive {S} --machine-of-the-day seven", "'seven' must be a whole number", 2),
    ("report good.h5 -o x.pdf", "x.pdf: a page ends in .html: take x.html", 2),
    (f"tune {S} --report x.pdf", "x.pdf: a page ends in .html: take x.html", 2),
    (f"selftest {S} --report x.html/y", "x.html/y: a page ends in .html", 2),
    ("move -10mm", "start one with `stagectl serve STAGE.yaml`", 2),
    ("move 5mm 6mm", "given twice for one axis: 5mm, 6mm; nothing has moved", 2),
    ("move 10 mm", 'two arguments: write `stagectl move "10 mm"`', 2),
    ("move x=1mm x=2mm", "given twice for axis x: 1mm, 2mm; nothing has moved", 2),
    ("config check list.yaml", "list.yaml:1", 1),
    ("replay empty.h5", "empty.h5 is empty", 2),
    ("simulate config/linear-slider.yaml angle.yaml", "amplitude = 5 deg; 'deg' does not measure m", 2),
    ("config check torque.yaml", "unknown unit 'Nm', perhaps N m", 1),
    ("config check minus.yaml", "U+2212 in it, type it in ASCII", 1),
    ("config check link.yaml", "it is a link to gone.yaml, which is not there: see `ls -l link.yaml`", 2),
    ("config check conf/ball-screw.yaml", "did you mean config/ball-screw.yaml?", 2),
    ("config check config\\ball-screw.yaml", "did you mean config/ball-screw.yaml?", 2),
    ("config check ~/stage.yaml", "~/stage.yaml", 2),
    ("config check -", "standard input is not read here", 2),
    (
        f"import date.csv --stage {S}",
        "'2026-01-01T00:00:0.000'; no time that can be read; must be one of a number (s), a date such as 2024-03-05T",
        2,
    ),
    (f"import twice.csv --stage {S}", "row 102, column 1: 'time_s' is no number; correct the row", 2),
    (f"import german.csv --stage {S}", "german.csv: row 2 has", 2),
    (
        f"import good.csv --stage {S} -o good.mat",
        "good.mat is not the name of a recording, which ends in .h5",
        2,
    ),
    (f"drive dump {S} -o {S}", "which ends in .dcf", 2),
    (f"simulate {S} {T} --json folder", "folder is a folder", 2),
    (f"tune {S} --write tuned", "tuned does not end in .yaml", 2),
    (f"tune {S} --write list.yaml", "list.yaml exists", 2),
    (f"identify leastsquares {S} good.csv", "did you mean least-squares?", 2),
    (f"identify good.csv {S}", f"stagectl identify simultaneous {S} good.csv", 2),
    (f"identify {S} least-squares good.csv", f"stagectl identify least-squares {S} good.csv", 2),
    (f"identify least-squares {S} good.csv --delay 3s", "delay 3s; must lie in [-0.1, 0.1] s", 2),
    (f"identify least-squares {S} good.csv --compensation dahl", "no compensator 'dahl'", 2),
    (f"identify least-squares {S} good.h5 --columns time=t", "good.h5 is a recording", 2),
    ("config check text.eds.yaml", "must be an EDS or DCF file: name the file", 1),
    ("config check index.yaml", "drive.wire.command_object = 0x6071; an object is hexadecimal", 1),
    ("config schema --json /dev/full", "/dev/full: No space left on device; make room: see `df -h`", 2),
]


def _prepare(line: str) -> None:
    """Write the files that `line` names."""
    for name, content in FILES.items():
        Path(name).write_bytes(content)
    Path("link.yaml").symlink_to("gone.yaml")
    for name, rows in LOGS.items():
        Path(name).write_text("\n".join(rows) + "\n" if rows else "")
    for name, (old, new) in STAGES.items():
        if name in line:
            text = Path(S).read_text().replace("drives/", "config/drives/")
            assert old in text
            Path(name).write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(("line", "place", "code"), MISTAKES, ids=[line[:60] for line, _, _ in MISTAKES])
def test_it_says_where_and_what_next(command: Command, line: str, place: str, code: int) -> None:
    _prepare(line)
    ended, out, err = command(*line.split())
    assert (ended, out) == (code, ""), err
    assert "Traceback" not in err
    assert not (line.startswith("drive verify") or "--model" in line) or not _RAW.search(err), err
    first = "\n".join(err.splitlines()[:2])
    assert first.startswith("error: ") and place in first, err
    assert _NEXT.search("\n".join(err.splitlines()[:3])), err


def test_an_imported_log_is_no_run(command: Command, folder: Path) -> None:
    assert command("import", "good.csv", "--stage", S, "-o", "imported.h5")[0] == 0
    for verb in ("report", "replay"):
        code, _, err = command(verb, "imported.h5")
        assert code == 2
        assert "imported.h5 was imported: it holds no law" in err


def test_a_slip_of_the_unit_that_leaves_a_stable_loop_is_a_warning(command: Command, folder: Path) -> None:
    text = Path(S).read_text().replace("drives/", "config/drives/")
    Path("heavy.yaml").write_text(text.replace("inertia: 0.010 kg", "inertia: 10 kg"))
    code, _, err = command("config", "check", "heavy.yaml")
    assert code == 0
    assert err.startswith("valid ") and "(at least 20)" in err
    assert "warning: heavy.yaml: from limits.speed the axis stops within 21.8 m" in err


def test_a_motion_beyond_the_limits_of_the_stage_beside_it_is_not_good(command: Command, folder: Path) -> None:
    _prepare("far.yaml")
    code, _, err = command("config", "check", S, "far.yaml")
    assert code == 1
    assert "error: limits.travel = [-50, 50] mm; the trajectory needs" in err
    assert command("config", "check", S, "config/linear-slider.yaml", "far.yaml")[0] == 0  # of two, which one?


def test_a_way_of_running_the_kernels_that_there_is_not_is_refused(folder: Path) -> None:
    words = [sys.executable, "-m", "stagectl", "simulate", S, T]
    ended = subprocess.run(words, env={**os.environ, "STAGECTL_KERNELS": "fast"}, capture_output=True, text=True)
    assert ended.returncode == 2
    assert "error: STAGECTL_KERNELS = fast; must be one of compiled, interpreted" in ended.stderr


def test_there_are_fifty() -> None:
    assert len({line for line, _, _ in MISTAKES}) >= 50
