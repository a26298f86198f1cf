"""The one place where the real-time process opens a drive, whatever its wire; it brings in what the wire needs."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

from stagectl.drives.bus.frames import Bus
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.bus.other_masters import ChannelLock, listen, lock_path
from stagectl.drives.drive import Canopen, Drive, Odrive
from stagectl.drives.simulated import Plant, Simulated
from stagectl.realtime.axis_data import Orders
from stagectl.realtime.scheduling import PARENT
from stagectl.units import StageError

if TYPE_CHECKING:
    from stagectl.drives.bus.shared_bus import Ports


class Opening:
    """Opens drives as the one master of their channels; where several share a bus, each has a port of it."""

    def __init__(self, shared: bool) -> None:
        self._shared = shared
        self._ports: dict[tuple[str, str], Ports] = {}
        self._locks: dict[Path, ChannelLock] = {}

    def drive(self, p: Orders) -> Drive:
        """The drive behind the wire of this axis.

        Raises OtherMasterError where another program controls its channel, and StageError or OSError where the drive is
        not there.
        """
        if p.wire is None:
            return Simulated(Plant(p.stage, p.simulation, p.ramp.dt))
        self._lock(p.wire, p.name)
        if isinstance(p.wire, Odrive):
            from stagectl.drives.odrive import open_odrive

            return open_odrive(p.wire, p.ramp.dt)
        from stagectl.drives.canopen.drive import CanopenDrive  # with the library, which a simulation need not load
        from stagectl.drives.canopen.object_rules import Wishes

        bus = self._bus(p.wire)
        try:
            return CanopenDrive(Wishes(p.wire, p.stage.encoder.step, p.ramp.dt, p.limits, p.homing), bus, p.brake)
        except (StageError, OSError):  # else its port would stay the one that sends SYNC for all
            bus.close()
            raise

    def close(self) -> None:
        """Leave the channels to others; all drives must be closed."""
        for lock in self._locks.values():
            lock.release()
        self._locks.clear()

    def _lock(self, wire: Canopen | Odrive, name: str) -> None:
        """Take the channel, once: it stays ours between two connections, too."""
        path = lock_path(wire)
        if path not in self._locks:
            self._locks[path] = ChannelLock(wire, name, int(os.environ.get(PARENT, "0")) or None)

    def _bus(self, wire: Canopen) -> Bus:
        if not self._shared:
            return _joined(wire)
        from stagectl.drives.bus.shared_bus import Ports

        where = (wire.interface, wire.channel)
        if where not in self._ports:
            self._ports[where] = Ports(lambda: _joined(wire))
        return self._ports[where].port(wire.node)


def _joined(wire: Canopen) -> Bus:
    """The bus, on which no other master was heard."""
    bus = open_bus(wire.interface, wire.channel, wire.bitrate)
    try:
        listen(wire, bus)
    except (StageError, OSError):
        bus.close()
        raise
    return bus
