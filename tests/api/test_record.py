"""Records: columns with units, frames, figures and files, of a run and of a log."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import stagectl as sc
from stagectl.api.arguments import ArgumentError
from stagectl.api.record import MotionRecord, RecordFolder
from stagectl.api.result import MissingPackageError
from stagectl.api.stage import DesignedStage
from stagectl.extras import MissingExtraError
from stagectl.problem import ProblemKind
from stagectl.recording.hdf5 import RecordingError
from tests.identification.synthetic import motion, write_csv
from tests.problems import refused


class Frame(dict[str, Any]):
    """As much of a pandas data frame as there need be."""

    def __init__(self, columns: dict[str, Any]) -> None:
        super().__init__(columns)
        self.attrs: dict[str, Any] = {}


@pytest.fixture
def pandas(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stand-in for pandas."""
    module = ModuleType("pandas")
    module.DataFrame = Frame  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pandas", module)


def test_columns_have_units(run: MotionRecord) -> None:
    assert run["error"].shape == (len(run),) == run.samples.shape
    assert (run.units["error"], run.units["current"], run.units["closed"]) == ("rad", "A", "")
    assert run.meanings["current"] and set(run.to_arrays()) == set(run.columns)
    with pytest.raises(RecordingError):
        run["torque"]


def test_the_record_stays_what_was_measured(run: MotionRecord) -> None:
    before = run["error"]
    for column in (run["error"], run.to_arrays()["error"]):
        column *= 1e6
    with pytest.raises(ValueError, match="read-only"):
        run.samples["error"] *= 1e6
    assert np.array_equal(run["error"], before)


def test_the_tracking_error_is_in_travel(run: MotionRecord) -> None:
    inside = (run["time"] >= run.summary["steady"][0]) & (run["time"] < run.summary["steady"][1])
    assert np.max(np.abs(run.tracking_error()[inside])) == run.summary["tracking_error"]["peak"]


def test_it_prints_what_it_achieved(run: MotionRecord) -> None:
    assert repr(run).splitlines()[0].startswith("ball-screw stage A, sine-3.2hz: The stage tracks within")
    assert "peak current" in repr(run) and "nan" not in repr(run)
    assert "<table>" in run._repr_html_()
    labels = [axes.get_ylabel() for axes in run.plot().axes]
    assert [label.split(" [")[0] for label in labels] == ["position", "tracking error", "current"]


@pytest.mark.usefixtures("pandas")
def test_a_frame_keeps_the_units(run: MotionRecord) -> None:
    frame = run.to_frame()
    assert frame.attrs["units"] == run.units
    assert np.array_equal(frame["measured"], run["measured"])


def test_without_pandas_the_error_says_what_to_install(run: MotionRecord, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingPackageError) as error:
        run.to_frame()
    assert error.value.package == "pandas" and "pip install pandas" in str(error.value)


def test_saved_it_is_read_again(run: MotionRecord) -> None:
    again = sc.load_log(run.save("run.h5"))
    assert isinstance(again, MotionRecord)
    assert again.samples.tobytes() == run.samples.tobytes()
    assert again.summary["tracking_error"] == run.summary["tracking_error"]
    assert run.save("run.csv").read_text().startswith("time_s,")
    endings = (".h5", ".csv", ".parquet", ".mat", ".mcap")
    with refused(RecordingError, kind=ProblemKind.VALUE, value=".docx", choices=endings):
        run.save("run.docx")


def test_a_log_of_another_program(stage: DesignedStage, folder: Path) -> None:
    write_csv(folder / "log.csv", motion())
    log = sc.load_log("log.csv")
    assert isinstance(log, MotionRecord) and log.summary == {}
    assert log.units == {"time": "s", "measured": "rad", "measured_current": "A"}
    assert "20000 rows" in repr(log) and len(log.plot().axes) == 2
    write_csv(folder / "bare.csv", motion(), header="")
    named = sc.load_log("bare.csv", {"time": "1", "position": "2:rad", "current": "3"}, stage)
    assert isinstance(named, MotionRecord) and np.allclose(named["measured"], log["measured"])
    typed = sc.load_log("bare.csv", "time=1,position=2:rad,current=3", stage)
    assert isinstance(typed, MotionRecord) and typed.samples.tobytes() == named.samples.tobytes()


def test_a_run_that_comes_back_as_a_table(run: MotionRecord, folder: Path) -> None:
    """It has every column, and does not say how late its position is: no summary, and errors row by row."""
    log = sc.load_log(run.save("run.csv"))
    assert isinstance(log, MotionRecord) and set(log.columns) == set(run.columns) and log.summary == {}
    assert np.allclose(log.tracking_error(), log["reference"] - log["measured"])
    write_csv(folder / "bare.csv", motion())
    bare = sc.load_log("bare.csv")
    assert isinstance(bare, MotionRecord)
    with refused(RecordingError, kind=ProblemKind.UNKNOWN, column="reference"):
        bare.tracking_error()


def test_a_folder_is_several_records(run: MotionRecord) -> None:
    for name in ("b", "a"):
        run.save(f"session/{name}.h5")
    records = sc.load_log("session")
    assert isinstance(records, RecordFolder)
    assert [record.path.name for record in records] == ["a.h5", "b.h5"]
    assert repr(records).startswith("2 records")


def test_nothing_to_read() -> None:
    for name in ("none.h5", "none.csv", "none"):
        with pytest.raises(RecordingError):
            sc.load_log(name)


def test_arguments_carry_their_name() -> None:
    error = ArgumentError("margin", "2 rad", "; must lie in [0, 1.5] rad")
    assert (error.name, error.value) == ("margin", "2 rad") and isinstance(error, sc.StageError)


def test_without_matplotlib_a_plot_says_what_to_install(run: MotionRecord, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stagectl.extras.find_spec", lambda name: None)
    with pytest.raises(MissingExtraError) as error:
        run.plot()
    assert (error.value.package, error.value.extra) == ("matplotlib", "report")
