"""Hostile clients, each a process of its own that goes on until it is ended.

Run as ``python -m tests.attacks.attackers KIND FOLDER PORT``.  They use what a stranger, a reader or a careless owner
has: a port, the reading token, the control socket.
"""

from __future__ import annotations

import contextlib
import http.client
import itertools
import json
import os
import resource
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from stagectl.runtime_folder import short_name
from stagectl.web.client import _UnixConnection
from tests.conftest import ROOT

IDLE, SLOW, EXPORTS, VIEWERS = 1100, 64, 40, 8
BODY = 200_000_000  # bytes
READY = "attacking"
PAUSE = 0.02  # s between two rounds: an attack must not be starved of the processor by itself
CHANNELS = ["reference", "target", "feedforward", "friction", "velocity", "learned", "error", "proportional"]
CHANNELS += ["integral", "derivative", "command", "current", "measured", "measured_current", "lateness", "late"]


class Target:
    """A service, as its attackers know it."""

    def __init__(self, folder: Path, port: int) -> None:
        self.folder, self.port, self.socket = folder, port, folder / "control.sock"
        self.reading = {"Authorization": f"Bearer {(folder / 'state' / 'token').read_text().strip()}"}

    def connected(self) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.port), timeout=5.0)

    def files(self) -> list[str]:
        link = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30.0)
        link.request("GET", "/v1/recordings", headers=self.reading)
        listed = json.loads(link.getresponse().read())
        link.close()
        return [
            f"/v1/recordings/{recording['kind']}/{recording['axis']}/{recording['file']}"
            for recording in listed
            if recording["bytes"]
        ]


def idle(target: Target) -> Iterator[None]:
    """Connections that say nothing; those that are thrown out come again."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(4096, most), most))
    held: list[socket.socket] = []
    while True:
        with contextlib.suppress(OSError):
            held.append(target.connected())
        if len(held) > IDLE:
            held.pop(0).close()
        if len(held) % 50 == 0:
            yield


def slow_headers(target: Target) -> Iterator[None]:
    """A letter now and then, of a header that never ends."""
    held: list[socket.socket] = []
    for letter in itertools.cycle(b"GET / HTTP/1.1\r\nHost: x\r\nX-Slow: aaaaaaaaaaaaaaaa"):
        while len(held) < SLOW:
            with contextlib.suppress(OSError):
                held.append(target.connected())
        for link in list(held):
            try:
                link.send(bytes([letter]))
            except OSError:
                held.remove(link)
        yield


def exports(target: Target) -> Iterator[None]:
    """Forty exports that nobody fetches."""
    places: list[str] = []
    while not places:
        with contextlib.suppress(OSError, http.client.HTTPException):  # readers may have taken all seats
            places = target.files()
    while True:
        asked = []
        for place, _ in zip(itertools.cycle(places), range(EXPORTS), strict=False):
            with contextlib.suppress(OSError):
                link = http.client.HTTPConnection("127.0.0.1", target.port, timeout=5.0)
                link.request("GET", f"{place}?to=mcap", headers=target.reading)
                asked.append(link)
        yield
        for link in asked:
            link.close()


def body(target: Target) -> Iterator[None]:
    """A body of 200 MB: announced, then without a length; as an owner, as a reader and as a stranger."""
    part = b"x" * (1 << 16)
    heads = [f"Content-Length: {BODY}\r\n\r\n".encode(), b"Transfer-Encoding: chunked\r\n\r\n"]
    while True:
        for head, home in itertools.product(heads, (True, False)):
            with contextlib.suppress(OSError):
                link = socket.socket(socket.AF_UNIX) if home else target.connected()
                if home:
                    with short_name(target.socket) as name:
                        link.connect(name)
                link.settimeout(1.0)
                link.sendall(b"POST /v1/trajectory HTTP/1.1\r\nHost: localhost\r\n" + head)
                for _ in range(BODY // len(part)):
                    link.sendall(b"%x\r\n%b\r\n" % (len(part), part) if b"chunked" in head else part)
                link.close()
            yield


def long_trajectories(target: Target) -> Iterator[None]:
    """Two hours, which is refused, and a quarter of an hour, which takes its time; the client does not wait."""
    for periods in itertools.cycle((7200, 900)):
        with contextlib.suppress(OSError):
            link = _UnixConnection(target.socket, 0.5)
            yaml = f"{{type: sine, amplitude: 1 mm, frequency: 1 Hz, periods: {periods}}}"
            link.request("POST", "/v1/trajectory", json.dumps({"yaml": yaml}), {"Content-Type": "application/json"})
            with contextlib.suppress(TimeoutError):
                link.getresponse().read()
            link.close()
        yield


def viewers(target: Target) -> Iterator[None]:
    """Eight readers that want all channels as finely as possible, again and again."""
    token = target.reading["Authorization"].split()[1]
    for _ in range(VIEWERS):
        threading.Thread(target=_greedy, args=(target.port, token), daemon=True).start()
    while True:
        yield


def _greedy(port: int, token: str) -> None:
    from websockets.sync.client import connect

    fine = {"channels": CHANNELS, "points": 100_000}
    while True:
        with contextlib.suppress(Exception), connect(f"ws://127.0.0.1:{port}/v1/live", compression=None) as link:
            link.send(json.dumps({"key": token}))
            for number in itertools.count():
                link.send(json.dumps({"strip": {**fine, "span": 3600.0}}))
                link.send(json.dumps({"scope": {**fine, "span": 9.0, "mode": "auto"}}))
                link.send(json.dumps({"closer": {"start": -9.0, "end": 9.0, "points": 100_000, "number": number}}))
                with contextlib.suppress(TimeoutError):
                    while True:
                        link.recv(timeout=0.001)
        time.sleep(PAUSE)


KINDS: dict[str, Callable[[Target], Iterator[None]]] = {
    "idle": idle,
    "slow_headers": slow_headers,
    "exports": exports,
    "body": body,
    "long_trajectories": long_trajectories,
    "viewers": viewers,
}


FULL_DISK, _BALLAST = "full_disk", "ballast"  # an attack, and its file beside the service's own
SMALL = 1 << 30  # bytes; a larger disk is not the service's alone, and is not filled


def full_disk(target: Target) -> Iterator[None]:
    """The service's disk has no room: what becomes free is taken at once."""
    folder = target.folder / "state"
    whole = os.statvfs(folder)
    assert whole.f_blocks * whole.f_frsize < SMALL, f"{folder} is on a large disk"
    with (folder / _BALLAST).open("ab", buffering=0) as ballast:
        while True:
            for part in (b"x" * (1 << 16), b"x"):
                with contextlib.suppress(OSError):
                    while ballast.write(part):
                        pass
            yield


@contextlib.contextmanager
def attacked(folder: Path, port: int, *kinds: str) -> Iterator[None]:
    """These attacks go on meanwhile."""
    words = [sys.executable, "-m", "tests.attacks.attackers"]
    started = [
        subprocess.Popen([*words, kind, str(folder), str(port)], cwd=ROOT, stdout=subprocess.PIPE, text=True)
        for kind in kinds
    ]
    try:
        for attacker in started:
            assert attacker.stdout is not None
            assert attacker.stdout.readline().strip() == READY
        yield
    finally:
        for attacker in started:
            attacker.kill()
            attacker.communicate()
        (folder / "state" / _BALLAST).unlink(missing_ok=True)


def main() -> None:
    kind, folder, port = sys.argv[1:]
    rounds = {**KINDS, FULL_DISK: full_disk}[kind](Target(Path(folder), int(port)))
    next(rounds)
    print(READY, flush=True)
    for _ in rounds:
        time.sleep(PAUSE)


if __name__ == "__main__":
    main()
