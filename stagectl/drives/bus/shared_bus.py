"""One bus for several drives: each has a port for the frames of its node; one port sends SYNC for all.

::

    bus --+-- port of node 5   sends SYNC; takes 0x185, 0x085, 0x585, 0x705
          +-- port of node 6   its SYNC is left out: it was sent already; takes 0x186, ...

A frame for another port waits in that port's queue, so that no answer is waited for twice.
"""

from __future__ import annotations

import collections
import struct
import time
from collections.abc import Callable

from stagectl.drives.bus.frames import SYNC, TPDO, Bus
from stagectl.drives.limits import PORT_QUEUE

_HEAD = struct.Struct("<I")


class Ports:
    """The bus behind all ports; open as long as one of them is."""

    def __init__(self, opened: Callable[[], Bus]) -> None:
        self._opened = opened
        self._bus: Bus | None = None
        self._ports: dict[int, Port] = {}

    def port(self, node: int) -> Port:
        """A way onto the bus for the master of `node`."""
        if self._bus is None:
            self._bus = self._opened()
        self._ports[node] = Port(self, node)
        return self._ports[node]

    def send(self, node: int, frame: bytes) -> None:
        """One frame of the port of `node`; SYNC goes out once for all.

        Our heartbeat does not: another drive may want it sooner than the first, which may not even be watching it.
        """
        assert self._bus is not None
        if _HEAD.unpack_from(frame)[0] == SYNC:
            if not self.leads(node):
                return
            for port in self._ports.values():
                port.renew()
        self._bus.send(frame)

    def leads(self, node: int) -> bool:
        """Whether SYNC goes out by the port of `node`."""
        return node == next(iter(self._ports))

    def receive(self, node: int, timeout: float) -> bytes | None:
        """Next frame for the port of `node`, or of no port's node."""
        assert self._bus is not None
        deadline = time.monotonic() + timeout
        while True:
            raw = self._bus.receive(max(deadline - time.monotonic(), 0.0))
            if raw is None:
                return None
            node_id = _HEAD.unpack_from(raw)[0] & 0x7F
            if node_id == node or node_id not in self._ports:
                return raw
            self._ports[node_id].waiting.append(raw)

    def leave(self, port: Port) -> None:
        """A port closes; the last one closes the bus."""
        if self._ports.get(port.node) is port:
            del self._ports[port.node]
        if not self._ports and self._bus is not None:
            self._bus.close()
            self._bus = None


class Port:
    """The protocol `Bus` for one drive among several."""

    def __init__(self, ports: Ports, node: int) -> None:
        self._ports, self.node = ports, node
        self.waiting: collections.deque[bytes] = collections.deque(maxlen=PORT_QUEUE)

    def send(self, frame: bytes) -> None:
        """Queue one frame."""
        self._ports.send(self.node, frame)

    def receive(self, timeout: float) -> bytes | None:
        """Next frame of this drive.

        A call without `timeout` clears old frames.  Only the port that sends SYNC returns frames: the answers that
        wait at the other ports belong to that SYNC.
        """
        if timeout <= 0.0 and not self._ports.leads(self.node):
            return None
        if self.waiting:
            return self.waiting.popleft()
        return self._ports.receive(self.node, timeout)

    def renew(self) -> None:
        """Drop an answer to an earlier SYNC: a new one is sent."""
        stale = TPDO + self.node
        self.waiting = collections.deque(
            (raw for raw in self.waiting if _HEAD.unpack_from(raw)[0] != stale), PORT_QUEUE
        )

    def close(self) -> None:
        """Close this port; the others stay open."""
        self._ports.leave(self)
