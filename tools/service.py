"""Figures of the service on this machine: ``python tools/service.py kills [N] | queries``.

`kills`: signal 9 to real-time process, black box and service in turn, at random moments of a motion; the drive must
stop, every recording be readable, the service be back without power and say why.  `queries`: a thousand status queries
a second beside the loop, in turns with none, and how late its cycles begin.
"""

from __future__ import annotations

import random
import re
import sys
import tempfile
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from stagectl.recording.hdf5 import open_recording
from tests.daemon.serving import SILENCE, Served, served

VICTIMS = {"stagectl.daemon.axes": "process_died", "stagectl.daemon.blackbox": "blackbox_died", "": "service_died"}
STOP = SILENCE + 2.5  # s: the drive's time-out, its ramp, and what a busy machine adds


def kills(count: int) -> None:
    source, stops = random.Random(7), []
    with tempfile.TemporaryDirectory() as folder, served(Path(folder)) as machine:
        for number in range(count):
            victim, said = list(VICTIMS.items())[number % len(VICTIMS)]
            if machine.axis()["state"] in ("fault", "offline"):
                machine.ask("POST", "faults/reset")
            machine.begin_moving()
            time.sleep(source.uniform(0.0, 1.0))
            began = time.monotonic()
            machine.kill(victim)
            if not victim:
                machine.start()
            machine.until(lambda axis, said=said: axis["state"] == "disabled" or said == "blackbox_died")
            while said not in machine.faults():
                time.sleep(0.05)
            took = time.monotonic() - began
            if said == "blackbox_died":
                machine.ask("POST", "disable")
            stops.append(_stands(machine, said))
            print(f"{number + 1}: {victim or 'the service'} killed; {said}, back after {took:.1f} s; {stops[-1]}")
        boxes = machine.boxes()
        rows = [len(open_recording(path).samples) for path in boxes]
    print(
        f"{count} kills; {len(boxes)} black boxes, all readable, {min(rows, default=0)} to {max(rows, default=0)} rows"
    )


def _stands(machine: Served, said: str) -> str:
    """What the drive said of its stop."""
    line = machine.drive_says()
    while not line.startswith("stands"):
        found = re.search(r"for (\d+) ms", line)
        assert found is None or int(found[1]) < 1e3 * STOP, line
        line = machine.drive_says()
    return f"the drive {line.strip()}" + (" by its own time-out" if said == "process_died" else "")


def queries(rounds: int = 4, seconds: float = 5.0) -> None:
    late: dict[bool, list[int]] = {False: [], True: []}
    answered = []
    with tempfile.TemporaryDirectory() as folder, served(Path(folder)) as machine:
        machine.ask("POST", "enable")
        for asked in [False, True] * rounds:
            before = machine.axis()
            done = _queried(machine, seconds, asked)
            after = machine.axis()
            late[asked].append(after["late_cycles"] - before["late_cycles"])
            answered += [done] if asked else []
            cycles, fault = after["cycles"] - before["cycles"], after["fault"] or "none"
            print(f"{done:.0f} queries a second; {late[asked][-1]} late of {cycles} cycles; fault: {fault}")
        machine.ask("POST", "quick-stop")
    print(
        f"{min(answered):.0f} to {max(answered):.0f} queries a second; late cycles in {seconds:g} s, median and most: "
        f"{np.median(late[False]):.0f}, {max(late[False])} without, {np.median(late[True]):.0f}, {max(late[True])} with"
    )


def _queried(machine: Served, seconds: float, asked: bool) -> float:
    """Queries a second that four clients got through."""
    counts, end = [0] * 4, time.monotonic() + seconds

    def client(k: int) -> None:
        while time.monotonic() < end:
            machine.axis()
            counts[k] += 1

    if not asked:
        time.sleep(seconds)
        return 0.0
    threads = [threading.Thread(target=client, args=(k,)) for k in range(len(counts))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return sum(counts) / seconds


if __name__ == "__main__":
    if sys.argv[1:2] == ["queries"]:
        queries()
    else:
        kills(int(sys.argv[2]) if len(sys.argv) > 2 else 9)
