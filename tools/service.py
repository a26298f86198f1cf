"""Figures of the service on this machine: ``python tools/service.py kills [N] | queries``.

`kills`: signal 9 to real-time process, recorder, black box, service and virtual drive in turn, at random moments of a
motion; the drive must stop within its time-out, every file be readable, the service be back without power and say why.
`queries`: a thousand status queries a second beside the loop, in turns with none, and how late its cycles begin.
"""

import contextlib
import http.client
import json
import os
import random
import re
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from stagectl.recording.hdf5 import open_recording
from stagectl.units import StageError
from stagectl.web.client import RefusedError
from tests.conftest import SILENCE
from tests.service.serving import Served, served


class Victim(NamedTuple):
    """Who is killed, and what has to follow."""

    name: str
    module: str  # of the service's child
    said: str  # in the fault list
    goes_on: bool  # the motion does not need it


VICTIMS = (
    Victim("real-time process", "stagectl.realtime.axes", "process_died", False),
    Victim("recorder", "stagectl.recording.recorder", "recorder_died", True),
    Victim("black box", "stagectl.service.black_box", "blackbox_died", True),
    Victim("service", "", "service_died", False),
    Victim("drive", "", "feedback_lost", False),
)
BUSY = 2.5  # s: what a busy machine adds to a time-out and a ramp
LOOK = 0.005  # s
MOST = 300.0  # s that the service, or a drive, may take to be back: the machine is shared
RATE, CLIENTS = 1000.0, 4  # queries a second, and who asks
DRIVE = 10  # its real-time priority, below the loop's


def kills(count: int) -> None:
    source, stops = random.Random(7), list[float]()
    with tempfile.TemporaryDirectory() as folder, served(Path(folder)) as machine:
        for number in range(count):
            victim = VICTIMS[number % len(VICTIMS)]
            _moving(machine)
            time.sleep(source.uniform(0.0, 1.0))
            words, stop = _lost_drive(machine) if victim.name == "drive" else _killed(machine, victim)
            stops += [] if victim.goes_on else [stop]
            print(f"{number + 1}: {victim.name} killed; {words}", flush=True)
        machine.ask("POST", "disable")
        rows = [len(open_recording(path).samples) for path in sorted((machine.folder / "state").rglob("*.h5"))]
    print(f"{count} kills; {len(rows)} recordings and black boxes, all readable, {min(rows)} to {max(rows)} rows")
    print(
        f"from the signal to standstill, or to what says that the drive is lost: {min(stops):.2f} to {max(stops):.2f} s"
    )


def _moving(machine: Served) -> None:
    """The axis moves and is recorded, from whatever the last kill left."""
    if machine.axis()["state"] in ("fault", "offline"):
        machine.ask("POST", "faults/reset")
    with contextlib.suppress(RefusedError):  # it is being recorded still
        machine.ask("POST", "recordings", seconds=3600.0)
    machine.begin_moving()


def _killed(machine: Served, victim: Victim) -> tuple[str, float]:
    """Words, and the time (s) from the signal to standstill."""
    began = time.monotonic()
    earlier = machine.faults().count(victim.said) if victim.module else 0
    machine.kill(victim.module)
    if victim.goes_on:
        _until(lambda: machine.faults().count(victim.said) > earlier)
        assert machine.axis()["state"] == "moving", "the motion needed it"
        machine.ask("POST", "disable")
    stands = _stands(machine)
    stop = time.monotonic() - began
    assert victim.goes_on or stop < SILENCE + BUSY, f"stood after {stop:.1f} s"
    if victim.name == "service":
        machine.start()
    _until(lambda: machine.faults().count(victim.said) > earlier)
    machine.until(lambda axis: axis["state"] == "disabled", MOST)
    if victim.goes_on:
        return f"{victim.said}; the motion went on", stop
    return f"{stands} after {stop:.2f} s; {victim.said}, disabled, back after {time.monotonic() - began:.1f} s", stop


def _lost_drive(machine: Served) -> tuple[str, float]:
    """Words, and the time (s) from the signal until the axis is no longer said to move."""
    began = time.monotonic()
    machine.kill_drive()
    _until(lambda: machine.axis()["state"] != "moving")
    took = time.monotonic() - began
    assert took < SILENCE / 3.0 + BUSY, f"said to move for {took:.1f} s"  # the feedback's time-out, see `patient`
    machine.until(lambda axis: axis["state"] == "fault")
    assert machine.faults()[-1] == "feedback_lost"
    for verb in ("move", "enable"):
        with contextlib.suppress(RefusedError):
            machine.ask("POST", verb, **({"by": {"axis": "1 mm"}} if verb == "move" else {}))
            raise AssertionError(f"{verb} without a drive")
    machine.start_drive()
    assert machine.ask("POST", "faults/reset")["axes"][0]["state"] == "disabled"
    return (
        f"feedback_lost after {took:.2f} s (time-out {SILENCE / 3.0:g} s); no move is taken; a new one is found",
        took,
    )


def _until(true: Callable[[], bool]) -> None:
    """Wait for it; a service that is starting again answers nothing."""
    end = time.monotonic() + MOST
    while time.monotonic() < end:
        with contextlib.suppress(OSError, StageError):
            if true():
                return
        time.sleep(LOOK)
    raise AssertionError("the service did not say so")


def _stands(machine: Served) -> str:
    """What the drive said of its stop, whose time-out it must have kept."""
    said = [machine.drive_says()]
    while not said[-1].startswith("stands"):
        outage = re.search(r"for (\d+) ms", said[-1])
        assert outage is None or int(outage[1]) < 1e3 * (SILENCE + BUSY), said
        said.append(machine.drive_says())
    why = said[0].split(":")[0] if len(said) > 1 else "ordered"
    return f"the drive stopped ({why}) and {said[-1].strip()};"


def queries(rounds: int = 4, seconds: float = 5.0) -> None:
    late: dict[bool, list[int]] = {False: [], True: []}
    answered = []
    with tempfile.TemporaryDirectory() as folder, served(Path(folder)) as machine:
        _as_another_machine(machine)
        machine.ask("POST", "enable")
        for asked in [False, True] * rounds:
            before = machine.axis()
            done = _queried(machine, seconds, asked)
            after = machine.axis()
            late[asked].append(after["late_cycles"] - before["late_cycles"])
            answered += [done] if asked else []
            cycles, fault = after["cycles"] - before["cycles"], after["fault"] or "none"
            print(f"{done:.0f} queries a second; {late[asked][-1]} late of {cycles} cycles; fault: {fault}", flush=True)
        machine.ask("POST", "quick-stop")
    print(
        f"{min(answered):.0f} to {max(answered):.0f} queries a second; late cycles in {seconds:g} s, median and most: "
        f"{np.median(late[False]):.0f}, {max(late[False])} without, {np.median(late[True]):.0f}, {max(late[True])} with"
    )


def _as_another_machine(machine: Served) -> None:
    """A drive has a processor of its own: here the virtual one comes before all but the loop, as far as we may."""
    assert machine.drive is not None
    try:
        os.sched_setscheduler(machine.drive.pid, os.SCHED_FIFO, os.sched_param(DRIVE))
    except OSError as error:
        print(f"the virtual drive competes with the clients ({error.strerror}): late cycles are also its own")


def _queried(machine: Served, seconds: float, asked: bool) -> float:
    """Queries a second that the clients got answered, each on a connection that stays, together `RATE` at most."""
    counts, began = [0] * CLIENTS, time.monotonic()

    def client(k: int) -> None:
        link = http.client.HTTPConnection("localhost")
        link.sock = socket.socket(socket.AF_UNIX)
        link.sock.connect(str(machine.socket))
        while (now := time.monotonic() - began) < seconds:
            due = counts[k] * CLIENTS / RATE
            if due > now:
                time.sleep(due - now)
            link.request("GET", "/v1/status")
            assert json.loads(link.getresponse().read())["axes"]
            counts[k] += 1
        link.close()

    if not asked:
        time.sleep(seconds)
        return 0.0
    threads = [threading.Thread(target=client, args=(k,)) for k in range(CLIENTS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return sum(counts) / seconds


if __name__ == "__main__":
    if sys.argv[1:2] == ["queries"]:
        queries()
    else:
        kills(int(sys.argv[2]) if len(sys.argv) > 2 else 10)
