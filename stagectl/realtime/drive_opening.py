"""The one place where the real-time process opens a drive, whatever its wire; it brings in what the wire needs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stagectl.drives.bus.frames import Bus
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.canopen.drive import CanopenDrive
from stagectl.drives.drive import Canopen, Drive, Odrive
from stagectl.drives.simulated import Plant, Simulated
from stagectl.realtime.axis_data import Orders
from stagectl.units import StageError

if TYPE_CHECKING:
    from stagectl.drives.bus.shared_bus import Ports


class Opening:
    """Opens drives; where several share a bus, each has a port of it."""

    def __init__(self, shared: bool) -> None:
        self._shared = shared
        self._ports: dict[tuple[str, str], Ports] = {}

    def drive(self, p: Orders) -> Drive:
        """The drive behind the wire of this axis.  Raises StageError or OSError where it is not there."""
        if p.wire is None:
            return Simulated(Plant(p.stage, p.simulation, p.ramp.dt))
        if isinstance(p.wire, Odrive):
            from stagectl.drives.odrive import open_odrive

            return open_odrive(p.wire, p.ramp.dt)
        bus = self._bus(p.wire)
        try:
            step, dt = p.stage.encoder.step, p.ramp.dt
            return CanopenDrive(p.wire, bus, step, dt, limits=p.limits, brake=p.brake)
        except StageError:
            bus.close()
            raise

    def _bus(self, wire: Canopen) -> Bus:
        if not self._shared:
            return open_bus(wire.interface, wire.channel, wire.bitrate)
        from stagectl.drives.bus.shared_bus import Ports

        where = (wire.interface, wire.channel)
        if where not in self._ports:
            self._ports[where] = Ports(lambda: open_bus(wire.interface, wire.channel, wire.bitrate))
        return self._ports[where].port(wire.node)
