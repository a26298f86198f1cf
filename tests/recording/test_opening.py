"""What lies at a path: every reader of captures finds the same there."""

from pathlib import Path

import pytest

import stagectl as sc
from stagectl.api.record import MotionRecord, RecordFolder
from stagectl.config.stage_file import load_stage
from stagectl.gap.logs.sources import Description, read_logs
from stagectl.identification.captures import opened
from stagectl.problem import ProblemKind
from stagectl.recording.hdf5 import RecordingError
from tests.identification.synthetic import motion, write_csv
from tests.problems import refused

STAGE = Path("config/ball-screw.yaml").resolve()


@pytest.fixture(scope="module")
def record() -> MotionRecord:
    return sc.simulate(STAGE, STAGE.parent / "trajectories/sine-1.6hz.yaml")


@pytest.mark.parametrize(("kinds", "found"), [(("h5",), ["a.h5"]), (("csv",), ["a.csv"]), (("csv", "h5"), ["a.h5"])])
def test_a_folder_is_the_same_to_every_reader(
    record: MotionRecord, tmp_path: Path, kinds: tuple[str, ...], found: list[str]
) -> None:
    """Our recordings; logs of other programs where there are none, as an export next to its recording is no second."""
    if "h5" in kinds:
        record.save(tmp_path / "a.h5")
    if "csv" in kinds:
        write_csv(tmp_path / "a.csv", motion())
    loaded = sc.load_log(tmp_path)
    assert isinstance(loaded, RecordFolder)
    assert [one.path.name for one in loaded] == found
    assert [one.path.name for one in opened([tmp_path], load_stage(STAGE))] == found
    assert [log.name for log in read_logs([tmp_path], load_stage(STAGE), Description())] == found


def test_a_folder_of_neither(tmp_path: Path) -> None:
    for read in (sc.load_log, lambda path: opened([path], load_stage(STAGE))):
        with refused(RecordingError, kind=ProblemKind.MISSING):
            read(tmp_path)
