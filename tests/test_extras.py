"""Without an extra: the core does its work, and a verb that needs the extra says so before it begins."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from stagectl_studies.commands import gap_exam, reproduce

from stagectl.cli import comparison, gap_diagnose, identification, records, service
from stagectl.cli import motion as motions
from stagectl.cli.show import page_path
from stagectl.config.stage_file import Setup
from stagectl.extras import EXTRAS, MissingExtraError, require
from stagectl.recording.exports import export
from stagectl.recording.hdf5 import Recording, RecordingError, open_recording
from stagectl.recording.imports import read
from stagectl.workflows.motion import prepare
from stagectl.workflows.simulated_motion import pretend
from tests.conftest import CONFIG, ROOT

STAGE, SINE = CONFIG / "ball-screw.yaml", CONFIG / "trajectories/sine-1.6hz.yaml"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
DISTRIBUTIONS = {"sklearn": "scikit-learn", "foxglove": "foxglove-sdk"}


def _names(requirements: list[str]) -> set[str]:
    return {re.split(r"[\[>=<]", requirement)[0] for requirement in requirements}


@pytest.mark.parametrize("extra", EXTRAS)
def test_an_extra_brings_what_it_is_asked_for(extra: str) -> None:
    brought = _names(PROJECT["optional-dependencies"][extra])
    assert {DISTRIBUTIONS.get(distribution, distribution) for distribution in EXTRAS[extra]} <= brought
    assert not brought & _names(PROJECT["dependencies"])


def test_make_run_brings_what_every_command_of_the_readme_needs() -> None:
    assert {"report", "tables", "service", "mcap"} <= set(
        re.findall(r"\w+", PROJECT["optional-dependencies"]["run"][0].partition("[")[2])
    )


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch) -> Any:
    """``without("pyarrow")``: as if this package were not installed."""
    return lambda package: monkeypatch.setitem(sys.modules, package, None)


@pytest.fixture
def recorded(ball_screw: Setup, tmp_path: Path) -> Recording:
    motion = prepare(ball_screw, SINE, frozenset(), tmp_path / "sine.h5")
    pretend(motion)
    return open_recording(motion.recording)


@pytest.mark.parametrize("extra", EXTRAS)
def test_what_is_missing_is_named(extra: str, without: Any) -> None:
    require(extra, "this test")
    without(EXTRAS[extra][-1])
    with pytest.raises(MissingExtraError) as caught:
        require(extra, "this test")
    assert (caught.value.extra, caught.value.package) == (extra, EXTRAS[extra][-1])
    assert f"pip install 'stagectl[{extra}]'" in str(caught.value)


@pytest.mark.parametrize(
    ("verb", "extra", "arguments"),
    [
        (records.report, "report", {"recording": Path("none.h5")}),
        (motions.demo, "report", {}),
        (comparison.compare, "report", {"stage": STAGE, "trajectory": SINE, "variants": ["off"]}),
        (reproduce.reproduce, "report", {"paper": "slider"}),
        (gap_diagnose.diagnose, "report", {"folder": [Path("none")]}),
        (gap_exam.exam, "report", {"output": Path("exam")}),
        (gap_exam.exam, "tables", {"output": Path("exam")}),
        (gap_exam.exam, "exam", {"output": Path("exam"), "baselines": True}),
        (service.serve, "service", {"stages": [str(STAGE)]}),
        (
            identification.identify,
            "report",
            {"method": "simultaneous", "stage": STAGE, "captures": [SINE], "report": SINE},
        ),
        (identification.tune, "report", {"stage": STAGE, "report": Path("page.html")}),
    ],
)
def test_a_verb_says_what_it_needs_before_it_begins(
    verb: Any, extra: str, arguments: dict[str, Any], without: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    without(EXTRAS[extra][0])
    with pytest.raises(MissingExtraError) as caught:
        verb(**arguments)
    assert caught.value.extra == extra


def test_a_result_comes_without_its_page(without: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert page_path(None, "run")
    without("matplotlib")
    assert page_path(None, "run") is None
    assert "stagectl[report]" in capsys.readouterr().err
    with pytest.raises(MissingExtraError):
        page_path(Path("page.html"), "run")


@pytest.mark.parametrize("to", ["csv", "parquet", "folder", "trajectory"])
def test_tables_need_arrow(to: str, tmp_path: Path, without: Any, recorded: Recording) -> None:
    without("pyarrow")
    with pytest.raises(MissingExtraError) as caught:
        export([recorded], to, tmp_path / "out")
    assert caught.value.extra == "tables"


def test_a_csv_needs_arrow(tmp_path: Path, without: Any) -> None:
    (tmp_path / "log.csv").write_text("time_s,position_mm\n0,1\n0.1,2\n", encoding="utf-8")
    assert len(read(tmp_path / "log.csv")[0].samples) == 2
    without("pyarrow")
    with pytest.raises(MissingExtraError):
        read(tmp_path / "log.csv")
    with pytest.raises(RecordingError):
        read(tmp_path / "none.csv")
