"""What all tests share: the repository's own configuration, and small variations of it."""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

# Before numpy is loaded, and for each program that a test starts: workers share the cores, and threads of the algebra
# would only wait for each other there.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import settings
from numpy.typing import NDArray

from stagectl import design
from stagectl.config.stage_file import Setup, load_stage
from stagectl.evaluation import latched_reference
from stagectl.plan import plan
from stagectl.simulation import simulate
from stagectl.trajectories import Trajectory

Tracked = Callable[..., Any]
Command = Callable[..., tuple[int, str, str]]
ROOT = Path(__file__).parents[1]
CONFIG = ROOT / "config"
SOURCES = os.pathsep.join(str(ROOT / place) for place in (".", "tools/studies"))  # for a child's PYTHONPATH

# Started in the background by a script, Ctrl-C is ignored, and every child would ignore it, too.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The files that take longest, about in order.  Begun first, none of them runs alone at the end of the suite.
LONGEST = (
    "tests/test_printed.py",
    "tests/zoo/test_run.py",
    "tests/test_run.py",
    "tests/studies/test_exam.py",
    "tests/web/test_openapi.py",
    "tests/web/test_page.py",
    "tests/attacks/test_stop_under_attack.py",
    "tests/gap/test_diagnose.py",
    "tests/test_acceptance.py",
    "tests/zoo/test_killed.py",
    "tests/gap/test_examples.py",
    "tests/gap/inference/test_unstructured_residual.py",
    "tests/gap/inference/test_constant_force.py",
    "tests/studies/test_baselines.py",
    "tests/gap/test_measured_records.py",
    "tests/api/test_commission.py",
    "tests/cli/test_scope.py",
    "tests/service/test_service.py",
    "tests/service/test_shutdown_signals.py",
    "tests/studies/test_reproduction.py",
    "tests/test_second_master.py",
    "tests/zoo/test_serve.py",
    "tests/zoo/test_reboot.py",
    "tests/test_readme.py",
    "tests/test_manual.py",
    "tests/gap/test_closing.py",
    "tests/interchange/test_fmu.py",
    "tests/kernels/test_bits.py",
)


settings.register_profile("suite", deadline=None)  # an example of 10 ms takes 200 ms where the machine is busy
settings.load_profile("suite")

gc.disable()  # until all is collected


def pytest_collection_finish() -> None:
    """What has been imported and collected stays: it is not searched for garbage again and again."""
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first, the others as they come; the order within a file stays."""
    ranks = {ROOT / name: rank for rank, name in enumerate(LONGEST)}
    items.sort(key=lambda item: ranks.get(item.path, len(ranks)))


def movable(text: str) -> str:
    """A shipped stage file that may lie anywhere: its EDS is named whole."""
    return text.replace("eds: drives/", f"eds: {CONFIG / 'drives'}/")


_HALF_SECOND = """\
    heartbeat: 100 ms
    heartbeat_timeout: 500 ms
    rpdo_timeout: 500 ms
    feedback_timeout: 500 ms
"""


def half_second(text: str) -> str:
    """A shipped stage file with time-outs that it does not leave to its free distance, and any late cycles."""
    assert text.count("    kind: canopen\n") == text.count("realtime:\n") == 1
    text = text.replace("    kind: canopen\n", f"    kind: canopen\n{_HALF_SECOND}")
    return text.replace("realtime:\n", "realtime:\n  late_limit: 2000\n")


@pytest.fixture(scope="session")
def slow_screw() -> Setup:
    """Stage A with time-outs of half a second."""
    path = CONFIG / "ball-screw.yaml"
    return load_stage(path, text=half_second(path.read_text()))


@pytest.fixture(scope="session")
def ball_screw() -> Setup:
    """Stage A as the repository ships it."""
    return load_stage(CONFIG / "ball-screw.yaml")


@pytest.fixture(autouse=True)
def kernels_stay_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command that chooses interpreted kernels does so for its own process; here many commands share one."""
    monkeypatch.setenv("STAGECTL_KERNELS", os.environ.get("STAGECTL_KERNELS", "compiled"))


@pytest.fixture(autouse=True)
def signals_stay_as_they_are() -> Iterator[None]:
    """What blocks a signal here blocks it in every process that a later test starts: none of those would end."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    yield
    after = signal.pthread_sigmask(signal.SIG_SETMASK, before)
    assert after == before, after ^ before


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Command:
    """``command("config", "check", path)``: (exit code, standard output, standard error), in this process."""
    from stagectl.cli import main

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["stagectl", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        return int(ended.value.code or 0), out, err

    return run


@contextlib.contextmanager
def endlessly(program: str, descriptor: int) -> Iterator[None]:
    """Another process runs `program` again and again after its first line; `descriptor` is shared, its argument."""
    begin, again = program.split("\n")
    words = [sys.executable, "-uc", f"import sys; {begin}; print()\nwhile True: {again}", str(descriptor)]
    with subprocess.Popen(words, pass_fds=[descriptor], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield
        process.kill()


def _text(path: Path) -> str:
    """What a file of /proc says; nothing if its process has ended meanwhile."""
    with contextlib.suppress(OSError):
        return path.read_text()
    return ""


def child_of(parent: int, module: str) -> int | None:
    """Process id of the child that runs `module`."""
    for listed in Path(f"/proc/{parent}/task").glob("*/children"):
        for name in _text(listed).split():
            if module in _text(Path(f"/proc/{name}/cmdline")):
                return int(name)
    return None


def varied(setup: Setup, **changes: Any) -> Setup:
    """`setup` with other delays (nd, nm), steps (quantum, step), band at standstill, noise or sub-steps."""
    drive, encoder = setup.stage.drive, setup.stage.encoder
    drive = drive._replace(
        delay_samples=changes.get("nd", drive.delay_samples),
        current_quantum=changes.get("quantum", drive.current_quantum),
    )
    encoder = encoder._replace(
        delay_samples=changes.get("nm", encoder.delay_samples), step=changes.get("step", encoder.step)
    )
    simulation = setup.file.simulation._replace(
        **{name: changes[name] for name in ("substeps", "current_noise", "encoder_noise", "seed") if name in changes}
    )
    control = setup.file.control
    control = control._replace(standstill_band=changes.get("band", control.standstill_band))
    return setup._replace(
        stage=setup.stage._replace(drive=drive, encoder=encoder),
        file=setup.file._replace(simulation=simulation, control=control),
    )


class Run:
    """A simulated run and its errors in micrometres of table travel."""

    def __init__(self, setup: Setup, trajectory: Trajectory, without: frozenset[str] = frozenset()) -> None:
        control = setup.file.control._replace(margin=0.15)  # nd = 2 is below what the daemon accepts
        self.setup = setup
        self.law, self.feedforward = design.design(setup.stage, control).without(without)
        self.plan = plan(setup, trajectory, self.feedforward)
        self.samples = simulate(setup, self.plan, self.law)

    def steady(self) -> NDArray[np.bool_]:
        """Rows of the steady window."""
        start, end = self.plan.steady
        inside: NDArray[np.bool_] = (self.samples["time"] >= start) & (self.samples["time"] < end)
        return inside

    def error(self, of: str = "measured") -> NDArray[np.float64]:
        """Reference minus `of` (um) over the whole run; the measured one with the reference of its instant."""
        scale = 1e6 * self.setup.file.axis.travel_per_unit
        reference = self.samples["reference"]
        if of == "measured":
            reference = latched_reference(self.samples, {"nm": self.setup.stage.encoder.delay_samples})
        error: NDArray[np.float64] = (reference - self.samples[of]) * scale
        return error

    def peak(self, of: str = "measured") -> float:
        """Largest error in the steady window (um)."""
        return float(np.max(np.abs(self.error(of)[self.steady()])))


@pytest.fixture
def tracked(ball_screw: Setup) -> Callable[..., Run]:
    """``tracked(trajectory, without=..., nd=..., ...)``: stage A tracks it."""

    def run(trajectory: Trajectory, without: frozenset[str] = frozenset(), **changes: Any) -> Run:
        return Run(varied(ball_screw, **changes), trajectory, without)

    return run
