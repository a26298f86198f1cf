"""A jog lasts as long as the sign that its key is held, and keeps to the limits."""

from __future__ import annotations

import itertools
import os
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import pytest

from stagectl.service.limits import DEAD_MAN, HELD
from stagectl.web.client import RefusedError
from tests.service.serving import Served, served

FAST = "100 mm/s"
PRESSES = itertools.count(1)


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("jog")) as service:
        yield service


@pytest.fixture(autouse=True)
def ready(machine: Served) -> None:
    """Each test begins with an axis that stands under power at 0."""
    machine.until(lambda axis: axis["state"] != "connecting")
    machine.ask("POST", "stop")
    if machine.axis()["state"] != "standing":
        machine.ask("POST", "enable")
    if abs(machine.heard()["reference"]) > 1e-9:
        machine.ask("POST", "move", to={"axis": "0 mm"}, speed="100 mm/s")


def held(machine: Served, far: Callable[[float], bool], speed: str = "5 mm/s") -> int:
    """Hold a key, as a page does, which waits for no answer, until the reference (m) is `far` enough.  The press.

    A sign that a busy computer sends too late ends the press, as it should: press again.
    """
    for press in itertools.islice(PRESSES, 50):
        with ThreadPoolExecutor() as page:
            signs: list[Future[Any]] = []
            look = page.submit(machine.axis)
            while not any(sign.done() and sign.exception() for sign in signs):
                signs.append(page.submit(machine.ask, "POST", "jog", press=press, speed=speed))
                if look.done():
                    reference = look.result()["reference"]  # None where the loop is silent, on a busy computer
                    if reference is not None and far(reference):
                        return press
                    look = page.submit(machine.axis)
                time.sleep(0.05)
        standing(machine)
    raise AssertionError(machine.axis())


def standing(machine: Served) -> dict[str, Any]:
    return machine.until(lambda axis: axis["state"] == "standing")


@pytest.mark.parametrize(("speed", "sense"), [("5 mm/s", 1.0), ("-5 mm/s", -1.0)])
def test_it_moves_while_it_is_held_and_stops_without_a_sign(machine: Served, speed: str, sense: float) -> None:
    """Nobody says that the key was released: the service brakes by itself."""
    held(machine, lambda place: place * sense > 2e-3, speed)
    began = time.monotonic()
    axis = standing(machine)
    assert time.monotonic() - began < HELD + 1.0  # the machine is shared
    assert axis["fault"] == "" and 2e-3 < axis["position"] * sense < 20e-3


def test_a_service_that_stands_still_does_not_jog_on(machine: Served) -> None:
    """Who would have to brake is frozen, alive: the loop has no more rows than the key was held for."""
    assert machine.process is not None
    held(machine, lambda place: place > 1e-3)
    began = float(machine.heard()["reference"])
    os.kill(machine.process.pid, signal.SIGSTOP)
    time.sleep(4.0)
    os.kill(machine.process.pid, signal.SIGCONT)
    axis = standing(machine)
    assert axis["reference"] - began < 5e-3 * (DEAD_MAN + 1.0)  # the machine is shared
    assert axis["fault"] == "starved"


def test_a_late_sign_of_a_press_that_has_ended_moves_nothing(machine: Served) -> None:
    press = held(machine, lambda place: place > 0.1e-3)
    machine.ask("POST", "stop")
    place = standing(machine)["reference"]
    time.sleep(0.05)
    with pytest.raises(RefusedError, match="has ended"):
        machine.ask("POST", "jog", press=press, speed="5 mm/s")
    time.sleep(2.0 * HELD)
    assert machine.heard()["reference"] == place
    held(machine, lambda now: now > place + 0.1e-3)  # another press begins at once


def test_it_ends_before_the_end_of_the_travel(machine: Served) -> None:
    """At full speed into the limit: no fault, and from there the other way only."""
    held(machine, lambda place: place > 49e-3, FAST)

    def at_the_end() -> bool:
        axis = standing(machine)
        assert axis["fault"] == "" and 0.0 < 50e-3 - axis["position"] < 1e-3
        time.sleep(HELD + 0.1)
        try:
            machine.ask("POST", "jog", press=next(PRESSES), speed=FAST)
        except RefusedError as error:
            return "limits.travel" in str(error)
        return False  # on a busy computer the press was over before the end

    assert any(at_the_end() for _ in range(20))
    with pytest.raises(RefusedError, match="take a lower speed"):
        machine.ask("POST", "jog", press=next(PRESSES), speed="-2 m/s")
    with pytest.raises(RefusedError, match="0"):
        machine.ask("POST", "jog", press=next(PRESSES), speed="0 mm/s")


def test_it_does_not_end_the_motion_of_somebody_else(machine: Served) -> None:
    """A press that is refused, as the axis moves, stops nothing when its time is over."""
    machine.ask("POST", "trajectory", yaml="{type: sine, amplitude: 1 mm, frequency: 1 Hz, periods: 60}", wait=False)
    with pytest.raises(RefusedError, match="move is not possible"):
        machine.ask("POST", "jog", press=next(PRESSES), speed="5 mm/s")
    time.sleep(2.0 * HELD)
    assert machine.heard()["state"] == "moving"
    machine.ask("POST", "stop")


def test_a_second_key_is_refused_while_one_is_held(machine: Served) -> None:
    """On a busy computer the first press may be over before the second is asked for: again, then."""

    def refused() -> bool:
        begun = float(machine.heard()["reference"])
        held(machine, lambda place: place > begun + 0.1e-3)
        try:
            machine.ask("POST", "jog", press=next(PRESSES), speed="-5 mm/s")
        except RefusedError as error:
            return "another key" in str(error)
        finally:
            standing(machine)
        return False

    assert any(refused() for _ in range(10))
