"""`identify --watch` on a running service whose axis rubs a quarter more than its stage file says."""

from __future__ import annotations

import contextlib
import itertools
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from stagectl.api.friction_watch import watch_friction
from stagectl.units import StageError
from tests.service.serving import Served, lasting

SINE = "{type: sine, amplitude: 5 mm, frequency: 2 Hz, periods: 8, ramp: 1}"


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Served]:
    """The drive is that of another stage file."""
    model = lasting(tmp_path, "model")
    served = Served(tmp_path, stages=(str(model),))
    served.stage = lasting(tmp_path, "rough", coulomb="1.25 N m")
    try:
        served.start_drive()
        served.start()
        served.until(lambda axis: axis["state"] != "connecting")
        served.ask("POST", "enable")
        yield served
    finally:
        served.end()


@pytest.fixture
def working(machine: Served) -> Iterator[Served]:
    """It does the same motion again and again."""
    over = threading.Event()

    def work() -> None:
        while not over.is_set():
            with contextlib.suppress(StageError):  # on a busy computer it may not have settled
                machine.ask("POST", "trajectory", yaml=SINE, wait=True)

    worker = threading.Thread(target=work)
    worker.start()
    yield machine
    over.set()
    worker.join()


def test_the_friction_of_the_machine_is_compensated_and_its_error_shrinks(working: Served) -> None:
    looks = watch_friction(working.stages[0], socket=working.socket, every=6.0)
    seen = list(itertools.takewhile(lambda look: "helped" not in look.words, itertools.islice(looks, 12)))
    assert 1 <= len(seen) < 12 and not any(look.ended for look in seen), seen
    assert working.ask("GET", "parameters")["axis"]["friction_scale"] == pytest.approx(1.25, rel=0.02)
    assert not list((working.folder / "state" / "recordings").rglob("*.h5"))
