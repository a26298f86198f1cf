"""A small stage, a bus in a folder of the test, and a virtual drive in a thread."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stagectl.drives.bus.embedded import Embedded
from stagectl.drives.bus.frames import frame
from stagectl.drives.bus.virtual_time import End, Timeline, Wire
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.canopen.power_states import Standstill
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import Canopen, Drive, DriveError, Fault, Feedback, Power, Simulation
from stagectl.drives.limits import ENABLE_TIME
from stagectl.drives.simulated import Plant
from stagectl.drives.virtual.node import VirtualNode
from stagectl.kernels import friction, stage

EDS = Path(__file__).parents[2] / "config" / "drives" / "stagectl-virtual.eds"
STEP = 1e-8  # m a count
DT = 0.001  # s
GAIN = 20.0  # A s/m: 100/s with 10 kg and 50 N/A
SYNC = frame(0x080)


def linear_stage() -> stage.Stage:
    """A light stage without the delay that the bus itself makes."""
    return stage.Stage(
        stage.Drive(0.0, 0, 20.0, 0.0),
        stage.Motor(50.0),
        stage.Mechanics(10.0, 5.0, 0.0),
        stage.Friction(friction.bundle([5.0], [1e-5]), friction.Stribeck(0.0, 1.0, 1.0)),
        stage.Encoder(STEP, 0),
    )


def canopen_settings(channel: str, **changes: Any) -> Canopen:
    """Settings of the virtual drive with the fine command, and time-outs that a busy machine keeps."""
    settings = Canopen(
        eds=str(EDS),
        node=5,
        rated_current=10.0,
        command_scale=1e-5,
        current_scale=0.01,
        quick_stop_deceleration=2.0,
        interface="embedded",
        channel=channel,
        rpdo=(0x604000, 0x207100),
        command_object=0x207100,
        heartbeat=0.02,
        heartbeat_timeout=10.0,
        rpdo_timeout=10.0,
        feedback_timeout=5.0,
    )
    return settings._replace(**changes)


def enabled(drive: Drive, time: Clock = WALL) -> Feedback:
    """Power, period by period, as the real-time process brings it; the first feedback under it."""
    drive.ask(Power.ON)
    deadline = time.now() + ENABLE_TIME
    while time.now() < deadline:
        now = drive.sample()
        if now.fault is Fault.NONE:
            return now
        drive.apply(0.0)
        time.sleep(DT)
    raise DriveError(drive.explain())


def stopped(drive: Drive, time: Clock = WALL, patience: float = 10.0) -> Feedback:
    """A stop by the drive's own ramp, until the axis stands and the drive has left operation, or `patience` (s)."""
    drive.ask(Power.QUICK_STOP)
    deadline, still = time.now() + patience, Standstill(2.0 * STEP)
    while time.now() < deadline:
        drive.apply(0.0)
        now = drive.sample()
        over = cia402.state(now.statusword) not in (DriveState.OPERATION_ENABLED, DriveState.FAULT_REACTION_ACTIVE)
        if now.fault is Fault.BUS or (still.stands(now.position) and over):
            break
        time.sleep(DT)
    return now


def _counts(way: float) -> str:
    return f"{way / STEP:.0f} encoder counts"


class Workbench:
    """Builds drives and buses of one test and clears them away."""

    def __init__(self, folder: Path, stack: contextlib.ExitStack) -> None:
        self.channel, self._stack = str(folder), stack
        self.reports: list[str] = []
        self.time = Timeline()
        self.ours, self._theirs = Wire(self.time, 1e6).ends

    def settings(self, **changes: Any) -> Canopen:
        return canopen_settings(self.channel, **changes)

    def bus(self) -> Embedded:
        bus = Embedded(self.channel)
        self._stack.callback(bus.close)
        return bus

    def node(
        self, bus: Any = None, clock: Any = "sync", time: Clock = WALL, mark: float = 0.0, **changes: Any
    ) -> VirtualNode:
        """A virtual drive, not running yet."""
        plant = Plant(linear_stage(), Simulation(substeps=4), DT)
        bus = bus or self.bus()
        wire = self.settings(**changes)
        report = self.reports.append
        return VirtualNode(wire, plant, bus, clock, GAIN, report, distance=_counts, time=time, mark=mark)

    def timed(self, clock: Any = "sync", mark: float = 0.0) -> tuple[VirtualNode, End, Timeline]:
        """A virtual drive that has booted, our end of its bus, and the time that both go by, which nobody waits for."""
        return self.booted(clock, mark), self.ours, self.time

    def booted(self, clock: Any = "sync", mark: float = 0.0, **changes: Any) -> VirtualNode:
        """A virtual drive at the other end of `ours`, in virtual time, until `stop`."""
        node = self.node(self._theirs, clock, self.time, mark, **changes)
        going, self.stop = [True], lambda: going.clear()

        def turn() -> None:
            if going:
                node.turn()

        self._theirs.wakes = turn
        node.boot()
        self.time.every(0.001, turn)
        return node

    def running(self, clock: Any = "sync", **changes: Any) -> VirtualNode:
        """A virtual drive in a thread, until the end of the test; it goes by the machine's clock."""
        node = self.node(clock=clock, **changes)
        self.stop = self._thread(node.run)
        return node

    def _thread(self, run: Callable[[Callable[[], bool]], None]) -> Callable[[], None]:
        over = threading.Event()
        thread = threading.Thread(target=run, args=(over.is_set,), daemon=True)

        def stop() -> None:
            over.set()
            thread.join(5.0)

        thread.start()
        self._stack.callback(stop)
        return stop


class Script:
    """A bus that plays frames to a node and keeps what it sends; steps that are callables are called."""

    def __init__(self) -> None:
        self.steps: list[bytes | Callable[[], Any]] = []
        self.sent: list[bytes] = []

    def send(self, raw: bytes) -> None:
        self.sent.append(raw)

    def receive(self, timeout: float) -> bytes | None:
        while self.steps:
            step = self.steps.pop(0)
            if isinstance(step, bytes):
                return step
            step()
        return None

    def close(self) -> None:
        """Nothing is open."""

    def done(self) -> bool:
        return not self.steps
