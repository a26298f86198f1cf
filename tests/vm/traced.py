"""The virtual drive with a witness: where its axis truly is, every millisecond.

Run as ``python -m tests.vm.traced STAGE.yaml``.  `stagectl inject` reaches it as it does every virtual drive; besides,
``{"do": "trace", "file": ...}`` writes what was seen since the last time as rows of `FIELDS` and begins anew.
"""

from __future__ import annotations

import contextlib
import os
import sys
from array import array
from pathlib import Path
from typing import Any

from stagectl.config.stage_file import load_stage
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.drive import Canopen
from stagectl.drives.virtual.inject import InjectionSocket, obey, socket_path
from stagectl.realtime.scheduling import settle
from stagectl.service.virtual_drive import virtual_node

FIELDS = ("time", "position", "velocity", "powered")  # s, rad, rad/s, 1 or 0
_LOOK = 0.001  # s
_BLOCK = 4096  # numbers


class Enduring:
    """A transceiver of its own: that the controller's interface is down does not end the drive."""

    def __init__(self, wire: Canopen) -> None:
        self._bus = open_bus(wire.interface, wire.channel, wire.bitrate)

    def send(self, frame: bytes) -> None:
        with contextlib.suppress(OSError):
            self._bus.send(frame)

    def receive(self, timeout: float) -> bytes | None:
        try:
            return self._bus.receive(timeout)
        except OSError:
            return None

    def close(self) -> None:
        self._bus.close()


class Witness:
    """Rows of the axis' true motion."""

    def __init__(self, node: Any) -> None:
        self._node, self._next = node, 0.0
        # Block by block: to move all rows of a minute to a larger place would hold the drive up for a period.
        self._full: list[array[float]] = []
        self._rows = array("d")

    def look(self) -> None:
        now = self._node.now()
        if now >= self._next:
            axis = self._node.axis
            state = axis.plant.state
            self._rows.extend((now, state.position, state.velocity, float(axis.enabled)))
            self._next = now + _LOOK
            if len(self._rows) >= _BLOCK:
                self._full.append(self._rows)
                self._rows = array("d")

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        if request["do"] == "trace":
            with open(request["file"], "wb") as file:
                for rows in (*self._full, self._rows):
                    rows.tofile(file)
            self._full, self._rows = [], array("d")
            return {"words": "written"}
        begun = self._node.now()
        return {**obey(self._node.faults, begun, request), "begun": begun}


def main(path: str) -> None:
    setup = load_stage(Path(path))
    wire = setup.file.drive.wire
    assert isinstance(wire, Canopen)
    bus = Enduring(wire)
    door = InjectionSocket(socket_path(wire.interface, wire.channel, wire.node))
    node = virtual_node(setup, wire, bus, lambda line: print(line, flush=True))
    witness = Witness(node)
    with contextlib.suppress(OSError):  # below the loop, above all else: a drive has a processor of its own
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(setup.file.realtime.priority - 10))
    settle()
    print(f"virtual drive of {setup.file.name}, process {os.getpid()}", flush=True)

    def over() -> bool:
        witness.look()
        door.look(witness.answer)
        return False

    node.run(over)


if __name__ == "__main__":
    main(sys.argv[1])
