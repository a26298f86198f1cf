"""The exam on a local Dask cluster of two workers: the same bytes, also when a worker is killed on the way."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from stagectl_studies.cluster import ClusterError, on_cluster
from stagectl_studies.exam import exam
from stagectl_studies.exam.question import Manner
from stagectl_studies.exam.run_trial import Job, sit
from stagectl_studies.exam.totals import totals

distributed = pytest.importorskip("distributed", reason="Dask is not installed: pip install 'stagectl[cluster]'")
pytestmark = [pytest.mark.filterwarnings("ignore"), pytest.mark.filterwarnings("ignore::ResourceWarning")]

STAND_IN = Path(__file__).parent / "answering" / "stand_in.py"
ASKED = exam.Asked(3, 41, ("null-exact", "poor"))


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster.scheduler_address


def code(folder: Path, *, deadly: bool) -> Manner:
    folder.mkdir()
    (folder / "stand_in.py").write_bytes(STAND_IN.read_bytes())
    if deadly:
        (folder / "deadly").write_text("answer-1")  # when the answer to an experiment is due
    return Manner(short=True, module="stand_in", code=str(folder))


def test_the_same_bytes_on_a_cluster(scheduler: str, tmp_path: Path) -> None:
    """Three trials here, and the same three there with one worker killed between two rounds of a poor battery."""
    manner = code(tmp_path / "deadly", deadly=True)
    planned = exam.prepared(tmp_path / "there", ASKED, manner, resume=False)
    there = exam.held(
        tmp_path / "there", planned, manner, lambda jobs: on_cluster(sit, jobs, scheduler), lambda *_: None
    )
    assert not (tmp_path / "deadly" / "deadly").exists()
    assert len((tmp_path / "there" / "register.jsonl").read_text().splitlines()) == 4
    assert [len(record.get("rounds", [])) for record in sorted(there, key=lambda record: record["stratum"])] == [
        0,
        3,
        3,
    ]
    calm = code(tmp_path / "calm", deadly=False)
    exam.prepared(tmp_path / "here", ASKED, calm, resume=False)
    for planned_trial in planned:
        sit(Job(planned_trial, str(tmp_path / "here"), calm))
        name = f"trials/{planned_trial.number:04d}/record.json"
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()
    scores = [
        json.dumps(totals(scored), sort_keys=True) for scored in (there, exam.records(tmp_path / "here", planned))
    ]
    assert scores[0] == scores[1]


def test_errors_of_the_function_come_back(scheduler: str) -> None:
    assert sorted(on_cluster(abs, [-3, 2], scheduler)) == [2, 3]
    with pytest.raises(TypeError, match="int"):
        list(on_cluster(int, [[]], scheduler))  # type: ignore[arg-type]


def failing(folder: Path) -> str:
    """It fails the first two times that it is asked."""
    (folder / str(len(list(folder.iterdir())))).touch()
    if len(list(folder.iterdir())) < 3:
        raise MemoryError(folder.name)
    return folder.name


def test_what_fails_is_tried_again_and_holds_up_no_other(scheduler: str, tmp_path: Path) -> None:
    """Once more is not enough here: the others come first, then what was raised."""
    folders = [tmp_path / name for name in "abc"]
    for folder in folders:
        folder.mkdir()
    for _ in range(2):
        (folders[1] / str(_)).touch()
    coming = on_cluster(failing, folders, scheduler, retries=1)
    assert next(coming) == "b"
    with pytest.raises(MemoryError):
        next(coming)
    assert sorted(on_cluster(failing, folders, scheduler, retries=1)) == ["a", "b", "c"]


def test_nobody_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stagectl_studies.cluster.PATIENCE", 0.5)
    with pytest.raises(ClusterError, match="no Dask scheduler answers"):
        list(on_cluster(abs, [1], "tcp://127.0.0.1:9"))
