"""A foreign CANopen drive as a process: ``python -m tests.zoo.node VARIANT --channel DIR --diary FILE``."""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import signal
import struct
import tempfile
import time
from pathlib import Path
from types import FrameType

import can
import canopen

from tests.zoo.diary import Writer
from tests.zoo.display import OPERATIONAL, PRE_OPERATIONAL
from tests.zoo.drive import Drive
from tests.zoo.memory import Memory
from tests.zoo.objects import write_eds
from tests.zoo.variants import SYNC_PRODUCER, VARIANTS, Variant, named

TICK = 0.002  # s between looks at the monitors
PRIORITY = 60  # of SCHED_FIFO, where this user may have it: a drive is never late
STOPPED = 4
PERIOD = 0.005  # s of a SYNC that the drive makes itself
_ABORT = 0x80  # first byte of an SDO abort
_NMT_STATES = {1: OPERATIONAL, 2: STOPPED, 128: PRE_OPERATIONAL}


class Line(canopen.Network):
    """The stock network; SDO responses of a variant may come late, or not at all."""

    def __init__(self, bus: can.BusABC, variant: Variant, node: int) -> None:
        """On an open bus, without a thread of its own."""
        super().__init__(bus)
        self._variant, self._sdo = variant, 0x580 + node
        self._late: list[tuple[float, int, bytes]] = []
        self.responses, self.busy = 0, False

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Send, or keep for later."""
        if can_id == self._sdo:
            self.responses += 1
            if self._variant.mute_aborts and data[0] == _ABORT:
                return
            if self._variant.drops_every and self.responses % self._variant.drops_every == 0:
                return
            if delay := max(self._variant.sdo_delay, self.busy * self._variant.sdo_delay_operational):
                self._late.append((time.monotonic() + delay, can_id, bytes(data)))
                return
        super().send_message(can_id, data, remote)

    def send_late(self, now: float) -> None:
        """What is due by now."""
        due, self._late = [row for row in self._late if row[0] <= now], [row for row in self._late if row[0] > now]
        for _, can_id, data in due:
            super().send_message(can_id, data)


class Node:
    """The drive on its bus."""

    def __init__(self, variant: Variant, node: int, channel: str, diary: Writer) -> None:
        """Join the bus; the boot-up message comes with `run`."""
        self.variant, self.id, self.note = variant, node, diary.note
        self._bus = can.Bus(interface="stagectl", channel=channel)
        self._line = Line(self._bus, variant, node)
        with tempfile.TemporaryDirectory() as folder:
            eds = write_eds(Path(folder) / "zoo.eds", variant, node)
            self._memory = Memory(node, str(eds), variant, diary.note)
        self._memory.associate_network(self._line)
        self.drive = Drive(variant, self._memory, self._line.send_message, diary.note)
        self._wakes, self._resets_at = 0.0, float("inf")  # times: boot-up message, end of the time after a reset
        self._beat, self._jitter, self._made = 0.0, random.Random(0), 0.0
        self._rebooted, self._requests = False, 0
        self.over = False

    def run(self) -> None:
        """Until `over`."""
        self.note("start", variant=self.variant.summary, node=self.id)
        self._wakes = time.monotonic() + (self.variant.boot_time if self.variant.starts_dead else 0.0)
        while not self.over:
            message = self._bus.recv(TICK)
            while message is not None:
                self._hear(message, time.monotonic())
                message = self._bus.recv(0.0)
            self._tick(time.monotonic())

    @property
    def _asleep(self) -> bool:
        return self._wakes > 0.0

    def _tick(self, now: float) -> None:
        self.drive.tick(now)
        self._line.send_late(now)
        if self.drive.wants_boot or now >= self._resets_at:
            self._boot(now, "by itself" if self.drive.wants_boot else "NMT")
        if self._asleep and now >= self._wakes:
            self._wakes = 0.0
            self.note("boot")
            if not self.variant.boots_in_silence:
                self._line.send_message(0x700 + self.id, b"\0")
        self._produce(now)
        if not self._asleep and self._sync & SYNC_PRODUCER and now - self._made >= PERIOD:
            self._made = now
            self._line.send_message(self._sync & 0x7FF, b"")

    @property
    def _sync(self) -> int:
        return self._memory.number(0x100500)

    def _produce(self, now: float) -> None:
        """The heartbeat of 0x1017."""
        period = self._memory.number(0x101700) / 1000.0
        period *= 1.0 + self.variant.heartbeat_jitter * self._jitter.uniform(-1.0, 1.0) if period else 0.0
        if not self._asleep and period and now - self._beat >= period:
            self._beat = now
            self._line.send_message(0x700 + self.id, bytes([self.drive.nmt]))

    def _boot(self, now: float, why: str) -> None:
        self.note("nmt", state="initialising", why=why)
        self.drive.boot()
        self._resets_at, self._wakes = float("inf"), now + self.variant.boot_time

    def _hear(self, message: can.Message, now: float) -> None:
        if self._asleep:
            return
        number, data = message.arbitration_id, bytes(message.data)
        self.drive.now = now
        if message.is_remote_frame:
            if number == 0x700 + self.id:
                self._line.send_message(number, self.drive.monitors.guarded(self.drive.nmt, now))
        elif number == self._sync & 0x7FF:
            self._hear_sync(data, now)
        elif number == 0 and len(data) == 2 and data[1] in (0, self.id):
            self._nmt(data[0], now)
        elif number == 0x600 + self.id:
            self._sdo(number, data, now)
        elif 0x700 < number < 0x780 and data:
            self.drive.monitors.heartbeat(number - 0x700, now)
        else:
            self.drive.process_data(number, data)

    def _hear_sync(self, data: bytes, now: float) -> None:
        """CiA 301, 7.2.5: with a counter exactly where 0x1019 is set."""
        counted = 0x101900 in self._memory and self._memory.number(0x101900) > 1
        if len(data) != counted:
            self.drive.emergency(0x8240)
            return
        self.drive.tick(now)
        self.drive.sync()

    def _nmt(self, command: int, now: float) -> None:
        if command in (129, 130):
            self._resets_at = now + self.variant.reset_delay
        elif command in _NMT_STATES:
            self.note("nmt", state=_NMT_STATES[command], requests=self._requests)
            self.drive.nmt_state(_NMT_STATES[command])

    def _sdo(self, number: int, data: bytes, now: float) -> None:
        if self.drive.nmt == STOPPED:
            return
        self.drive.show()
        self._line.busy = self.drive.nmt == OPERATIONAL
        with contextlib.suppress(struct.error):  # a frame that is too short
            self._line.notify(number, bytearray(data), now)
        self._requests += 1
        if self.variant.reboot_after and not self._rebooted and self._requests >= self.variant.reboot_after:
            self._rebooted = True
            self._boot(now, f"after {self._requests} SDO requests")


def in_time() -> None:
    """Run before ordinary processes, where this user may."""
    with contextlib.suppress(PermissionError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))


def _words() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="tests.zoo.node", description=__doc__)
    parser.add_argument("variant", help="one of " + ", ".join(VARIANTS) + "; or without:KEY")
    parser.add_argument("--channel", required=True, help="folder of the embedded bus")
    parser.add_argument("--diary", type=Path, default=Path(os.devnull), help="JSON lines")
    parser.add_argument("--node", type=int, default=5)
    parser.add_argument("--reboot-after", type=int, default=0, help="SDO requests, then it boots by itself")
    return parser.parse_args()


def main() -> None:
    """The process."""
    words = _words()
    variant = named(words.variant)
    if words.reboot_after:
        variant = variant.changed(reboot_after=words.reboot_after)
    node = Node(variant, variant.answers_as or words.node, words.channel, Writer(words.diary))

    def end(number: int, frame: FrameType | None) -> None:
        node.over = True

    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGINT, end)
    in_time()
    node.run()
    node._bus.shutdown()


if __name__ == "__main__":
    main()
