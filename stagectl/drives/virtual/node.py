"""The virtual drive: a real CANopen node (CiA 301, CiA 402) on a real bus, with the stage model inside.

What happens at each SYNC, which makes the delay of the loop exactly one period (nd = 1)::

    SYNC k          plant runs to t_k under what acted since SYNC k-1
                    position, statusword, current are latched -> TPDO
                    the RPDO that came since SYNC k-1 acts from now on

The clock of the plant is ``sync`` (each SYNC is one period, however late it comes: runs repeat to the
count) or ``wall`` (real time).  A drive that stops by itself needs no SYNC: then both follow the wall clock.
"""

import struct
from collections.abc import Callable, Iterable
from typing import Any, Literal

from stagectl.drives.brake import NO_BRAKE, Brake
from stagectl.drives.bus.faulty_bus import FaultyBus
from stagectl.drives.bus.frames import HEARTBEAT, Bus
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.library import canopen
from stagectl.drives.canopen.network import PumpedNetwork, load_eds
from stagectl.drives.clock import WALL, Clock, SkewedClock
from stagectl.drives.drive import Canopen, DriveError
from stagectl.drives.limits import CLOCK_SLIP, CLOCK_TICK, LOOK_FRAMES, SYNC_PATIENCE
from stagectl.drives.simulated import Plant
from stagectl.drives.virtual import pdo_mapping
from stagectl.drives.virtual.fault_actions import DriveParts, FaultSchedule, PeriodicActions
from stagectl.drives.virtual.object_dictionary import Objects
from stagectl.drives.virtual.power_stage import PowerStage, StopReport
from stagectl.drives.virtual.supervision import Watchdog

_SDO_LENGTH = 8  # bytes; a server does not look at others


class VirtualNode:
    """A drive on a bus; one thread, `run`."""

    def __init__(  # noqa: PLR0913 - a whole machine is assembled here
        self,
        settings: Canopen,
        plant: Plant,
        bus: Bus,
        clock: Literal["sync", "wall"],
        quick_stop_gain: float,
        report: Callable[[str], None],
        *,
        distance: Callable[[float], str] = str,
        time: Clock = WALL,
        faults: Iterable[Any] = (),
        brake: Brake = NO_BRAKE,
        mark: float = 0.0,
    ) -> None:
        """Build the node from `settings.eds` around `plant`, whose own delay line must hold nd - 1 periods.

        `quick_stop_gain` (A s/rad | A s/m) is that of the drive's own stop; `report` takes one line in plain
        words, with distances as `distance` writes them; `faults` are of `stagectl.drives.faults`; its reference
        mark is `mark` (rad | m) from where it was powered on.  Raises DriveError.
        """
        if plant.p.encoder.step <= 0.0:
            raise DriveError(
                "encoder.step = 0; must lie in (0, 1]: a CANopen drive counts; give the encoder a step",
                place="encoder.step",
                value=0.0,
            )
        self._clock = SkewedClock(time)
        self.now = self._clock.now  # the drive's own time (s)
        self._settings, self._dt, self._report = settings, plant.dt, report
        self._bus = FaultyBus(bus, self._clock.now, plant.simulation.seed)
        self._wall, self._distance = clock == "wall", distance
        self._network = PumpedNetwork(self._bus, self._clock)
        self._node: canopen.LocalNode = canopen.LocalNode(settings.node, load_eds(settings.eds, settings.node))
        self._network[settings.node] = self._node
        self.axis = PowerStage(plant, quick_stop_gain, self._stopped, brake, mark)
        self.objects = Objects(settings, self._node, self.axis)
        self._heartbeat = Watchdog(cia402.HEARTBEAT_LOST, "no heartbeat from the controller")
        self._command = Watchdog(cia402.RPDO_LOST, "no cyclic command (RPDO) from the controller")
        self._pending: dict[bytes, tuple[pdo_mapping.Rpdo, bytes]] = {}
        self._syncs = 0
        self._plant_time = self._synced = self._looked = self._clock.now()
        parts = self._bus, self.axis, self.objects, self._clock, self.trip, self._reboot, PeriodicActions()
        self.faults = FaultSchedule(DriveParts(*parts), report)
        self.faults.standing(faults)
        self._configure()

    def run(self, until: Callable[[], bool]) -> None:
        """Boot, then serve the bus until `until` returns True."""
        self.boot()
        while not until():
            self.turn()

    def turn(self) -> None:
        """Take one frame, if there is one within a millisecond, and look at the clocks when it is time."""
        raw = self._bus.receive(CLOCK_TICK)
        if raw is not None:
            self._take(raw)
        if self._clock.now() - self._looked >= CLOCK_TICK:
            self._look()

    def trip(self, code: int) -> None:
        """An error inside the drive: emergency `code`, fault reaction, Fault."""
        self.objects.error(code, cia402.GENERIC_ERROR)
        self._report(f"fault 0x{code:04X} ({cia402.emergency(code)}): {self._reaction(cia402.FAULT_REACTION)}")
        self.axis.trip()

    @property
    def operational(self) -> bool:
        """Whether the network management lets PDOs through."""
        return bool(self._node.nmt.state == "OPERATIONAL")

    def boot(self) -> None:
        """As after power-on: the boot-up message, then pre-operational."""
        self._node.nmt.state = "INITIALISING"  # sends the boot-up message
        self._node.nmt.state = "PRE-OPERATIONAL"
        self._plant_time = self._looked = self._clock.now()
        self._configure()

    def _reboot(self) -> None:
        """Boot with the defaults of the object dictionary, the machine staying where it is."""
        self._heartbeat.disarm()
        self.objects.restore(self._settings)
        self.boot()

    def _configure(self) -> None:
        """Compile what the object dictionary says; again whenever it was written."""
        objects, od = self.objects, self._node.object_dictionary
        objects.changed = False
        self.axis.options, self.axis.homing.options = objects.options(), objects.homing()
        self._rpdos = {pdo.head: pdo for pdo in pdo_mapping.received(objects.number, od)}
        sent = pdo_mapping.sent(objects.number, od)
        self._tpdos = [(pdo, [objects.reader(key) for key in pdo.objects]) for pdo in sent]
        self._sync_head = struct.pack("<I", objects.number(cia402.SYNC_COB_ID) & 0x7FF)
        consumed = objects.number(cia402.CONSUMER_HEARTBEAT, 1)
        self._partner_head = struct.pack("<I", HEARTBEAT + (consumed >> 16 & 0x7F))
        self._heartbeat.timeout = (consumed & 0xFFFF) * 1e-3
        self._command.timeout = max((pdo.deadline for pdo in self._rpdos.values()), default=0.0)

    def _take(self, raw: bytes) -> None:
        head = raw[:4]
        if head == self._sync_head:
            self._sync()
        elif head in self._rpdos:
            self._receive(self._rpdos[head], raw)
        elif head == self._partner_head:
            self._hear(self._heartbeat)
        elif head == b"\0\0\0\0":
            self._manage(raw)
        elif self._node.nmt.state != "STOPPED" and raw[4] == _SDO_LENGTH:
            self._network.take(raw)
            if self.objects.changed:
                self._configure()

    def _sync(self) -> None:
        if not self.operational:
            return
        now = self._clock.now()
        if self._wall:
            self._catch_up(now)
        else:
            self.axis.advance(self._dt)
            self._plant_time = now
        self.axis.plant.latch()
        self._synced = now
        self._syncs += 1
        for pdo, readers in self._tpdos:
            if self._syncs % pdo.every == 0:
                self._bus.send(pdo.layout.pack(*pdo.head, *[read() for read in readers]))
        for received, raw in self._pending.values():
            self._obey(received, raw)
        self._pending.clear()
        self.axis.latch()

    def _receive(self, pdo: pdo_mapping.Rpdo, raw: bytes) -> None:
        if not self.operational:
            return
        if raw[4] < pdo.length:
            if self.objects.error_code != cia402.PDO_LENGTH:  # once, not at every cycle
                self.objects.error(cia402.PDO_LENGTH, cia402.COMMUNICATION_ERROR)
            return
        if self.axis.state is cia402.DriveState.OPERATION_ENABLED:
            self._hear(self._command)
        if pdo.synchronous:
            self._pending[pdo.head] = (pdo, raw)
        else:
            self._obey(pdo, raw)
            self.axis.latch()

    def _obey(self, pdo: pdo_mapping.Rpdo, raw: bytes) -> None:
        for key, value in zip(pdo.objects, pdo.layout.unpack_from(raw), strict=True):
            setter = self.objects.setters.get(key)  # none for the dummies of CiA 301
            if setter is not None:
                setter(value)

    def _manage(self, raw: bytes) -> None:
        """A command of the network management."""
        before = self.operational
        self._network.take(raw)
        if before and not self.operational:
            self._pending.clear()
            self._command.disarm()
            if self.axis.connection_lost():
                self._report(f"taken out of operation: {self._reaction(cia402.ABORT_CONNECTION)}")
        if self._node.nmt.state == "INITIALISING":
            self._heartbeat.disarm()
            communication_only = raw[8] == cia402.NMT_RESETS["communication"]
            self.objects.restore(self._settings, communication_only)
            if not communication_only:
                self.axis.restart()
                self.faults.renew()
            self.boot()
        self._configure()

    def _look(self) -> None:
        """What depends on time and not on a frame."""
        for _ in range(LOOK_FRAMES):
            raw = self._bus.receive(0.0)
            if raw is None:
                break
            self._take(raw)
        now = self._looked = self._clock.now()
        self.faults.look(now)
        if self.objects.changed:
            self._configure()
        self._network.tick(now)
        if self.axis.state is not cia402.DriveState.OPERATION_ENABLED:
            self._command.disarm()
        for partner in (self._heartbeat, self._command):
            if (silence := partner.check(now)) is not None:
                self._partner_lost(partner, silence)
        self._follow(now)

    def _follow(self, now: float) -> None:
        """Let the plant follow the clock where no SYNC moves it."""
        if self._wall or (self.axis.stopping and now - self._synced > SYNC_PATIENCE):
            self._catch_up(now)
        elif not self.axis.stopping:
            self._plant_time = now

    def _catch_up(self, now: float) -> None:
        """Let the plant run to `now`, in periods and what is left of one."""
        slipped = now - self._plant_time - CLOCK_SLIP
        if slipped > 0.0:
            self._report(f"the plant's clock slipped by {slipped:.1f} s: this machine is too busy")
            self._plant_time = now - CLOCK_SLIP
        for _ in range(int((now - self._plant_time) / self._dt)):
            self.axis.advance(self._dt)
            self._plant_time += self._dt
        if self._wall and now > self._plant_time:
            self.axis.advance(now - self._plant_time)
            self._plant_time = now

    def _partner_lost(self, lost: Watchdog, silence: float) -> None:
        self.objects.error(lost.code, cia402.COMMUNICATION_ERROR)
        if self.axis.state is not cia402.DriveState.OPERATION_ENABLED:
            return  # nothing to stop; after an orderly end nothing to report
        reaction = self._reaction(cia402.ABORT_CONNECTION)
        self._report(f"{lost.what} for {silence * 1e3:.0f} ms (time-out {lost.timeout * 1e3:.0f} ms): {reaction}")
        self.axis.connection_lost()

    def _hear(self, partner: Watchdog) -> None:
        if not partner.alive(self._clock.now()):
            return
        if not (self.axis.faulty or self._heartbeat.tripped or self._command.tripped):
            self.objects.error_over()

    def _reaction(self, index: int) -> str:
        return cia402.option(index, self.objects.number(index))

    def _stopped(self, stop: StopReport) -> None:
        what = "stands" if stop.stands else "still MOVES, power cut,"
        self._report(f"{what} after {stop.duration * 1e3:.0f} ms and {self._distance(stop.distance)}")
