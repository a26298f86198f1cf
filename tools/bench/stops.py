"""How soon a stop is answered and carried out while a service is attacked: ``python tools/bench/stops.py [COUNT]``.

A service on a virtual drive is attacked in turn and by all attackers at once (`tests.attacks.attackers`) while its axis
moves; run by root, its disk is full, too.  Each stop goes over the stop path, as `stagectl stop` gives it.  Counted:
answers within `LIMIT` that say that the loop has taken the stop, and axes that then stand within their distance.
Figures of a machine that does something else say little: the attackers alone want more than one core.
"""

import contextlib
import itertools
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[2]))

from stagectl.service.stop_link import QUICK_STOP, STATUS, STOP, StopLink, beside
from tests.attacks.attackers import FULL_DISK, KINDS, attacked
from tests.service.serving import Served, free_port, served

LIMIT = 0.05  # s
SPEED, WAY = 5e-3, 2e-3  # m/s of the motion, and m within which it must stand: four times what its ramp needs
COUNT = 200
DISK = "64m"  # of the service's state, where it is to be filled


class Stop(NamedTuple):
    """One stop."""

    attack: str
    answer: float  # s
    heeded: bool  # by then
    way: float  # m, from the answer to the stand


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COUNT
    port = free_port()
    kinds = (*KINDS, FULL_DISK) if os.geteuid() == 0 else tuple(KINDS)
    groups = [*((kind,) for kind in kinds), kinds]
    stops: list[Stop] = []
    with (
        tempfile.TemporaryDirectory() as folder,
        _small_disk(Path(folder) / "state", FULL_DISK in kinds),
        served(Path(folder), "--tcp", f"127.0.0.1:{port}") as machine,
    ):
        machine.ask("POST", "recordings", name="prey", before=0.0, seconds=2.0)  # something to export
        for group in groups:
            share = [place % len(groups) == groups.index(group) for place in range(count)].count(True)
            with attacked(machine.folder, port, *group):
                stops += [_stopped(machine, "+".join(group), number) for number in range(share)]
            print(_line(stops, "+".join(group)), flush=True)
    good = sum(stop.heeded and stop.answer <= LIMIT and stop.way <= WAY for stop in stops)
    print(f"{good} of {len(stops)} answered within {LIMIT * 1e3:g} ms and stood within {WAY * 1e3:g} mm")
    sys.exit(good < len(stops))


@contextlib.contextmanager
def _small_disk(folder: Path, wanted: bool) -> Iterator[None]:
    """A disk of the service's own that can be filled; root alone can make one."""
    folder.mkdir(mode=0o700)
    if not wanted:
        print("without root the disk is not filled", flush=True)
        yield
        return
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK},mode=700", "tmpfs", folder], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", folder], check=True)


def _stopped(machine: Served, attack: str, number: int) -> Stop:
    link = StopLink(beside(machine.socket))
    _set_out(machine, link)
    began = time.monotonic()
    answer = link.ask(QUICK_STOP if number % 4 == 3 else STOP, "", 10.0)
    taken = time.monotonic() - began
    first = last = answer["axes"][0]
    while last["state"] not in ("standing", "disabled"):
        last = link.ask(STATUS, "", 10.0)["axes"][0]
        time.sleep(0.001)
    link.close()
    return Stop(attack, taken, answer["heeded"], abs(last["position"] - first["position"]))


def _set_out(machine: Served, link: StopLink) -> None:
    """Begin a motion, over the control socket and under attack as well."""
    place = link.ask("status", "", 10.0)["axes"][0]["position"]
    machine.ask("POST", "enable")
    to = {"axis": "20 mm" if place < 0.01 else "0 mm"}
    machine.ask("POST", "move", to=to, speed=f"{SPEED * 1e3:g} mm/s", wait=False)
    for _ in itertools.takewhile(lambda state: state != "moving", _states(link)):
        time.sleep(0.002)
    time.sleep(0.1)


def _states(link: StopLink) -> Iterator[str]:
    while True:
        yield link.ask("status", "", 10.0)["axes"][0]["state"]


def _line(stops: list[Stop], attack: str) -> str:
    own = [stop for stop in stops if stop.attack == attack]
    slowest, farthest = max(stop.answer for stop in own), max(stop.way for stop in own)
    middle = sorted(stop.answer for stop in own)[len(own) // 2]
    times = f"answer {middle * 1e3:.1f} ms (slowest {slowest * 1e3:.1f})"
    return f"{attack}: {len(own)} stops, {times}, way {farthest * 1e3:.3f} mm"


if __name__ == "__main__":
    main()
