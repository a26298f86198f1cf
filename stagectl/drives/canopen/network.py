"""The `canopen` library over one of our buses, without any thread.

The loop's process must have no other Python thread, so nothing here waits in the background.  Frames reach the library
when `pump` or `notify` is called; periodic frames are sent in `tick`.
"""

from __future__ import annotations

import configparser
import struct
from collections.abc import Iterable
from typing import Any

from stagectl.drives.bus.frames import EXTENDED, REMOTE, Bus, frame, parse
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.library import SdoClient, SdoCommunicationError, canopen
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import DriveError


class Periodic:
    """A frame that `Network.tick` repeats until stopped; what the library calls a periodic task."""

    def __init__(self, network: PumpedNetwork, identifier: int, data: bytes, period: float) -> None:
        self._owner, self.identifier, self.data, self.period = network.periodic, identifier, data, period
        self.due = network.clock.now() + period
        self._owner.append(self)

    def update(self, data: Iterable[int]) -> None:
        """Send other bytes from now on."""
        self.data = bytes(data)

    def stop(self) -> None:
        """Send it no more."""
        if self in self._owner:
            self._owner.remove(self)


class PumpedNetwork(canopen.Network):
    """A network of the library whose frames go by our bus."""

    def __init__(self, wire: Bus, clock: Clock = WALL) -> None:
        super().__init__()
        self.wire, self.clock = wire, clock
        self.malformed = 0  # frames that the library cannot read
        self.periodic: list[Periodic] = []

    def send_message(self, can_id: int, data: Iterable[int], remote: bool = False) -> None:
        """Send one frame now."""
        self.wire.send(frame(can_id | REMOTE * remote, bytes(data)))

    def send_periodic(self, can_id: int, data: Iterable[int], period: float, remote: bool = False) -> Any:
        """Send one frame now and then every `period` seconds, as long as `tick` is called."""
        self.send_message(can_id, data, remote)
        return Periodic(self, can_id, bytes(data), period)

    def tick(self, now: float) -> None:
        """Send what is due at `now` (monotonic clock, s)."""
        for task in self.periodic:
            if now >= task.due:
                self.wire.send(frame(task.identifier, task.data))
                task.due = max(task.due + task.period, now)

    def take(self, raw: bytes) -> None:
        """Hand a received frame to the library, except remote and extended frames."""
        identifier, data = parse(raw)
        if identifier & (REMOTE | EXTENDED):
            return
        try:
            self.notify(identifier, bytearray(data), self.clock.now())
        except struct.error:  # shorter than its protocol says
            self.malformed += 1

    def pump(self, timeout: float) -> bool:
        """Wait for one frame and hand it over; False after `timeout` seconds without one."""
        raw = self.wire.receive(timeout)
        if raw is None:
            return False
        self.take(raw)
        return True


_BEGINS, _ANSWERS = (1, 2), (2, 3, 4)  # top three bits of a request that begins a transfer; of what answers one


class PumpedSdo(SdoClient):
    """An SDO client that reads the bus itself while it waits for its answer."""

    _requested: bytes | None = None  # index and subindex of the transfer that begins

    def send_request(self, request: Any) -> None:
        """Send a request and keep the object that it names."""
        self._requested = bytes(request[1:4]) if request[0] >> 5 in _BEGINS else None
        super().send_request(request)  # type: ignore[no-untyped-call]

    def read_response(self) -> bytes:
        """The server's answer.  Raises SdoAbortedError or SdoCommunicationError."""
        network: Any = self.network
        deadline = network.clock.now() + self.RESPONSE_TIMEOUT
        while not self._has_answer():
            left = deadline - network.clock.now()
            if left <= 0.0:
                raise SdoCommunicationError("No SDO response received")
            network.pump(left)
        try:
            return bytes(super().read_response())  # type: ignore[no-untyped-call]
        except struct.error as error:  # an abort that is shorter than its code
            raise SdoCommunicationError("the SDO response is too short") from error

    def _has_answer(self) -> bool:
        """Whether the answer has arrived; late answers to an abandoned request are dropped."""
        waiting = self.responses.queue
        while (
            waiting
            and self._requested is not None
            and waiting[0][0] >> 5 in _ANSWERS
            and waiting[0][1:4] != self._requested
        ):
            waiting.popleft()
        return bool(waiting)

    def abort(self, abort_code: int = 0x0800_0000) -> None:
        """Abort the transfer at the server; the caller raises its own error."""
        self.send_request(b"\x80\0\0\0" + abort_code.to_bytes(4, "little"))


class PumpedNode(canopen.RemoteNode):
    """A remote node with pumped SDO clients, in a network of its own."""

    def __init__(self, node: int, od: canopen.ObjectDictionary, bus: Bus, clock: Clock = WALL) -> None:
        super().__init__(node, od)
        PumpedNetwork(bus, clock)[node] = self

    def add_sdo(self, rx_cobid: int, tx_cobid: int) -> PumpedSdo:
        """Add an SDO channel; the library calls this in its constructor."""
        client = PumpedSdo(rx_cobid, tx_cobid, self.object_dictionary)  # type: ignore[no-untyped-call]
        self.sdo_channels.append(client)
        return client


def check_profile(device_type: int, node: int) -> None:
    """Raises DriveError where `device_type` (0x1000) of `node` is not that of a CiA 402 drive."""
    if device_type & 0xFFFF != cia402.PROFILE:
        raise DriveError(
            f"node {node}: device type 0x1000 = 0x{device_type:08X} is profile {device_type & 0xFFFF}; must be"
            f" {cia402.PROFILE} (a CiA 402 drive); check 'node: {node}' in the stage file",
            node=node,
            object_key=cia402.DEVICE_TYPE << 8,
            value=device_type,
        )


def load_eds(path: str, node: int) -> canopen.ObjectDictionary:
    """Object dictionary of `node` from an EDS or DCF file.  Raises DriveError naming the file."""
    try:
        return canopen.import_od(path, node)
    except OSError as error:
        raise DriveError(
            f"eds = {path}: {error.strerror}; name the file that came with the drive", place=path
        ) from error
    except (configparser.Error, ValueError, KeyError) as error:
        raise DriveError(f"eds = {path}: not an EDS or DCF file that can be read ({error})", place=path) from error
