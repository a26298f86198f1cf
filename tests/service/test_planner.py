"""Planning in a process of its own: what it reads, what it refuses, and that it can be killed."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from stagectl.config.stage_file import load_stage
from stagectl.plan import AT_ZERO
from stagectl.problem import ProblemKind
from stagectl.service import planner as planners
from stagectl.service.axis_controller import AxisController, ServiceError
from stagectl.service.limits import PLANNED_ROWS
from stagectl.service.planner import Planner
from stagectl.service.planning import Motion, Upload, laid_out
from stagectl.units import StageError
from tests.conftest import CONFIG
from tests.problems import refused

SINE = "{type: sine, amplitude: 1 mm, frequency: 1 Hz, periods: %d}"
TABLE = "time_s,reference_mm\n" + "".join(f"{k / 1000:g},{0.001 * k * k / 1e4:g}\n" for k in range(100))


@pytest.fixture(scope="module")
def axis() -> AxisController:
    return AxisController("axis", load_stage(CONFIG / "ball-screw.yaml"))


@pytest.fixture
def planner() -> Iterator[Planner]:
    planner = Planner()
    yield planner
    planner.close()


def planned(planner: Planner, axis: AxisController, yaml: str, tables: dict[str, str] | None = None) -> Motion:
    return asyncio.run(planner.plan(axis.task("motion", Upload(yaml, tables or {}))))


def test_it_lays_out_what_is_laid_out_here(planner: Planner, axis: AxisController) -> None:
    motion = planned(planner, axis, SINE % 2)
    own = laid_out(axis.task("motion", Upload(SINE % 2, {})))
    assert motion.rows == own.rows and motion._replace(rows=b"", left=AT_ZERO) == own._replace(rows=b"", left=AT_ZERO)


def test_it_says_which_effect_demands_more_current_than_it_gets(axis: AxisController) -> None:
    """The effect is named, with its own current, what it gets, and what to do; the other one is not limited."""
    setup, upload = axis.setup, Upload(SINE % 1, {})
    assert laid_out(axis.task("motion", upload)).limited == ""
    p = setup.stage
    cogging = p.motor.cogging._replace(amplitude=0.6 * p.drive.current_limit * p.motor.force_constant, order=4.0)
    mechanics = p.mechanics._replace(viscous_asymmetry=0.2)
    strong = setup._replace(stage=p._replace(motor=p.motor._replace(cogging=cogging), mechanics=mechanics))
    words = laid_out(AxisController("axis", strong).task("motion", upload)).limited
    assert "motor.cogging would take up to" in words and f"gets {0.3 * p.drive.current_limit:.3g} A" in words
    assert "viscous_asymmetry" not in words and "together" not in words and "`stagectl gap close" in words
    weak = strong._replace(stage=p._replace(mechanics=mechanics))
    assert laid_out(AxisController("axis", weak).task("motion", upload)).limited == ""


def test_a_limit_is_quoted_as_it_was_read_whatever_becomes_of_the_file(tmp_path: Path) -> None:
    """By then the set-up holds the travel that is left, in the motor's unit: no place that a person knows."""
    path = tmp_path / "gone.yaml"
    path.write_text((CONFIG / "ball-screw.yaml").read_text())
    axis = AxisController("axis", load_stage(path))
    path.unlink()
    yaml = "{type: trapezoid, distance: 60 mm, velocity: 10 mm/s, acceleration: 1 m/s^2}"
    with refused(StageError, key="limits.travel", value="[-50, 50] mm"):
        laid_out(axis.task("motion", Upload(yaml, {})))


async def rehearsed(planner: Planner) -> None:
    """Wait until the process with compiled kernels has loaded them, or has ended."""
    planner.look()
    assert planner._taking_over is not None
    await asyncio.wait_for(planner._taking_over, 300.0)  # it may have to compile


def test_compiled_kernels_take_over_with_the_same_rows(axis: AxisController) -> None:
    said: list[str] = []
    planner = Planner(lambda: [axis.rehearsal()], said.append)

    async def both() -> tuple[Motion, Motion]:
        task = axis.task("motion", Upload(SINE % 2, {}))
        slow = await planner.plan(task)
        await rehearsed(planner)
        return slow, await planner.plan(task)

    try:
        slow, fast = asyncio.run(both())
        assert planner._process is not None and planner._process.compiled and not said
    finally:
        planner.close()
    assert fast.rows == slow.rows and fast._replace(rows=b"", left=AT_ZERO) == slow._replace(rows=b"", left=AT_ZERO)


def test_planning_goes_on_where_compiled_kernels_cannot_be_loaded(
    axis: AxisController, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    planner = Planner(lambda: [axis.rehearsal()], said.append)
    planner.start()
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "numba.py").write_text("import os; os._exit(1)")

    async def tried() -> Motion:
        await rehearsed(planner)
        planner.look()  # not again
        assert planner._next is None
        return await planner.plan(axis.task("motion", Upload(SINE % 1, {})))

    try:
        assert asyncio.run(tried()).length > 2000
    finally:
        planner.close()
    assert len(said) == 1 and "interpreted" in said[0]


@pytest.mark.parametrize(
    ("yaml", "key"),
    [
        ("{type: csv, file: %s}", "file"),
        ("{type: sequence, parts: [{type: dwell, duration: 1 s}, {type: csv, file: %s}]}", "parts[1].file"),
        ("{type: excited, motion: {type: csv, file: %s}, current: {type: current_sine, amplitude: 1 A, "
         "frequency: 5 Hz}}", ""),
    ],
)  # fmt: skip
@pytest.mark.parametrize("file", ["/etc/shadow", "../secret", "secret", "/proc/self/environ"])
def test_an_upload_names_no_file(
    planner: Planner,
    axis: AxisController,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    yaml: str,
    key: str,
    file: str,
) -> None:
    (tmp_path / "secret").write_text("time_s,reference_mm\nhunter2,1\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(StageError) as refused:
        laid_out(axis.task("motion", Upload(yaml % file, {"other": TABLE})))
    assert "hunter2" not in str(refused.value) and "root:" not in str(refused.value)
    if key:
        (problem,) = refused.value.problems
        assert (problem.key, problem.kind, problem.line) == (key, ProblemKind.FILE, 1)


def test_a_table_comes_with_it(axis: AxisController) -> None:
    yaml = "{type: csv, file: a.csv, run_up: 1 s, run_out: 1 s}"
    assert laid_out(axis.task("motion", Upload(yaml, {"a.csv": TABLE}))).length > 4000


def test_what_is_longer_than_a_service_takes_is_refused_at_once(planner: Planner, axis: AxisController) -> None:
    planned(planner, axis, SINE % 1)
    began = time.monotonic()
    with pytest.raises(StageError) as refused:
        planned(planner, axis, SINE % 7200)
    assert time.monotonic() - began < 10.0
    assert refused.value.problems[0].kind is ProblemKind.LIMIT
    assert PLANNED_ROWS * axis.setup.dt < 7200.0


def test_it_is_killed_with_who_asked_and_a_new_one_plans(planner: Planner, axis: AxisController) -> None:
    planned(planner, axis, SINE % 1)
    assert planner._process is not None
    first = planner._process.process.pid

    async def cancelled() -> None:
        work = asyncio.create_task(planner.plan(axis.task("motion", Upload(SINE % 900, {}))))
        await asyncio.sleep(0.3)
        work.cancel()
        await asyncio.wait([work])
        assert work.cancelled()

    asyncio.run(cancelled())
    assert not os.path.exists(f"/proc/{first}")
    assert planned(planner, axis, SINE % 1).length > 2000


def test_it_is_given_up_after_a_while(planner: Planner, axis: AxisController, monkeypatch: pytest.MonkeyPatch) -> None:
    planned(planner, axis, SINE % 1)
    monkeypatch.setattr(planners, "PLANNING_TIME", 0.2)
    with pytest.raises(ServiceError):
        planned(planner, axis, SINE % 900)


def test_it_imports_nothing_from_the_working_folder(
    planner: Planner, axis: AxisController, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("csv", "yaml", "pickle", "stagectl"):
        (tmp_path / f"{name}.py").write_text("open('executed', 'w')")
    monkeypatch.chdir(tmp_path)
    assert planned(planner, axis, SINE % 1).length > 2000
    assert not (tmp_path / "executed").exists()
