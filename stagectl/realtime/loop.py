"""The loop: a process of its own, interpreted kernels, no other Python thread.

Run as ``python -m stagectl.realtime.loop``; one pickled `Job` comes on standard input, events go out as JSON
lines on standard output, before and after the motion only.  During it the ring is the only way out.
"""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import signal
import struct
import sys
from typing import Any, NamedTuple

from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.canopen.drive import CanopenDrive
from stagectl.drives.drive import Canopen, Drive, DriveError, Fault, Odrive, Power
from stagectl.drives.odrive import open_odrive
from stagectl.drives.simulated import Plant, Simulated, Simulation
from stagectl.kernels import law, stage
from stagectl.realtime import safety, scheduling
from stagectl.realtime.stops import STOPS, Category
from stagectl.recording.ring import Ring
from stagectl.units import StageError

_SETPOINT = struct.Struct(f"<{len(law.Setpoint._fields)}d")


class Job(NamedTuple):
    """All that one motion needs, designed and checked beforehand."""

    law: law.Law
    setpoints: bytes  # (n, 8) float64, fields of law.Setpoint, relative to where the axis stands
    span: tuple[float, float]  # rad | m, lowest and highest of their positions
    dt: float  # s
    by_clock: bool  # a missed period is a missed row; False where the plant waits for our SYNC
    wire: Canopen | Odrive | None  # None: the stage model in this process
    stage: stage.Stage
    simulation: Simulation
    envelope: safety.Envelope
    priority: int
    cpu: int | None
    ring: int  # descriptor
    width: int
    capacity: int
    spin: float = 0.0  # s, see `realtime.Metronome`


class Tally(NamedTuple):
    """How the motion went."""

    cycles: int
    late: int
    fault: Fault


def connect(job: Job) -> Drive:
    """The drive behind the job's wire."""
    if job.wire is None:
        return Simulated(Plant(job.stage, job.simulation, job.dt))
    if isinstance(job.wire, Odrive):
        return open_odrive(job.wire, job.dt)
    bus = open_bus(job.wire.interface, job.wire.channel, job.wire.bitrate)
    return CanopenDrive(job.wire, bus, job.stage.encoder.step, job.dt)


def setpoint(table: bytes, row: int, origin: float) -> law.Setpoint:
    """A row of the table, moved to where the axis stands (rad | m)."""
    reference, target, *known = _SETPOINT.unpack_from(table, row * _SETPOINT.size)
    return law.Setpoint(reference + origin, target + origin, *known)


class Cycle:
    """The state of the running loop; `__call__` is one period."""

    def __init__(self, job: Job, drive: Drive, ring: Ring, origin: float) -> None:
        self.job, self.drive, self.ring, self.origin = job, drive, ring, origin
        self.state = law.AT_REST
        self.watch = safety.FRESH
        self.current = 0.0  # A, of the last period: what acts now
        self.rows = len(job.setpoints) // _SETPOINT.size
        self.row, self.passed = 0, 1  # row of the references, and how many it is past the last one
        self.cycles, self.late, self.late_in_a_row = 0, 0, 0
        self.metronome = scheduling.Metronome(job.dt, spin=job.spin)

    def __call__(self) -> Fault:
        """Wait, sample, compute, apply, record; the reason to stop, if there is one."""
        job = self.job
        row, overslept = self.row, 0
        asked = setpoint(job.setpoints, row, self.origin)  # before the wait: it is not part of the reaction
        lateness = self.metronome.wait()
        if lateness >= job.dt and job.by_clock:
            overslept = self.metronome.missed()
            row = self._skip(overslept)
            asked = setpoint(job.setpoints, row, self.origin)
        sampled = self.drive.sample()
        output, self.state = law.step(job.law, self.state, asked, sampled.position)
        now = safety.Seen(sampled, asked.reference, output.error, self.current, self.passed * job.dt)
        fault, self.watch = safety.judge(job.envelope, self.watch, now)
        self.current = output.current if fault is Fault.NONE else 0.0
        self.drive.apply(self.current)
        missed = self.metronome.missed()
        late = overslept + missed > 0
        seen = (sampled.position, _NAN, sampled.current, lateness, late, sampled.statusword, fault)
        self.ring.write((row * job.dt, *asked, *output, *seen))
        self.row, self.passed = row + 1, 1
        if missed and job.by_clock:
            self._skip(missed)
        return self._count(late) or fault

    def _skip(self, missed: int) -> int:
        """Leave out the rows of periods that were missed, as the axis did not wait either; the row to go on with."""
        self.row += missed
        self.passed += missed
        return min(self.row, self.rows - 1)

    def _count(self, late: bool) -> Fault:
        self.cycles += 1
        self.late += late
        self.late_in_a_row = self.late_in_a_row + 1 if late else 0
        return Fault.LATE if self.late_in_a_row >= self.job.envelope.late_limit else Fault.NONE


_NAN = float("nan")


def run(job: Job, drive: Drive, ring: Ring, origin: float, stopped: list[int]) -> Tally:
    """The motion, from first row to last or to the first fault."""
    cycle = Cycle(job, drive, ring, origin)
    fault = Fault.NONE
    while cycle.row < cycle.rows and fault is Fault.NONE:
        fault = Fault.OPERATOR if stopped else cycle()
    if fault is not Fault.NONE:
        stop(drive, fault)
    return Tally(cycle.cycles, cycle.late, fault)


def stop(drive: Drive, fault: Fault) -> None:
    """As `stops` says; the motion is over, so that what is held under power after category 2 is not held here."""
    if STOPS[fault].category is Category.COAST:
        drive.ask(Power.OFF)
        drive.apply(0.0)
        drive.sample()  # it acts with the next SYNC
    else:
        drive.quick_stop()


def _fits(job: Job, origin: float) -> None:
    low, high = (origin + end for end in job.span)
    if low < job.envelope.low or high > job.envelope.high:
        raise DriveError(
            f"the axis stands at {origin:.6g}, from where the motion goes to [{low:.6g}, {high:.6g}]; limits.travel is "
            f"[{job.envelope.low:.6g}, {job.envelope.high:.6g}] in axis units: move it back, then run again"
        )


def _say(event: str, **facts: Any) -> None:
    with contextlib.suppress(BrokenPipeError):  # nobody listens any more: the axis is stopped all the same
        print(json.dumps({"event": event, **facts}), flush=True)


def serve(job: Job) -> None:
    """Connect, enable, move, disable; every step is an event.

    Raises DriveError where the drive does not follow, or the motion would leave the travel from where it stands.
    """
    ring = Ring(job.ring, job.width, job.capacity)
    stopped: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: stopped.append(number))
    signal.signal(signal.SIGTERM, lambda number, _: stopped.append(number))
    scheduling.follow_parent()
    drive = connect(job)
    try:
        _say("connected", drive=drive.describe())
        if sys.stdin.readline().strip() != "go":  # the recorder must be ready, with the drive's identity in its file
            return
        refused = scheduling.prepare(job.priority, job.cpu)
        origin = drive.enable().position
        _fits(job, origin)
        _say("moving", refused=refused, origin=origin)
        tally = run(job, drive, ring, origin, stopped)
        reason = drive.explain() if Fault.NONE < tally.fault < Fault.FOLLOWING_ERROR else ""
        ring.close()
        _say("ended", **tally._asdict(), words=safety.words(tally.fault), reason=reason)
    finally:
        drive.close()


def main() -> None:
    """Entry of the process; exit 2 with the reason as an event where it could not be done."""
    job: Job = pickle.load(sys.stdin.buffer)
    try:
        serve(job)
    except StageError as error:
        _say("failed", reason=str(error))
        os._exit(2)


if __name__ == "__main__":
    main()
