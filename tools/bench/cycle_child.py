"""The real-time side of the cycle's benchmarks: a process like the loop's own, without numba in memory.

Takes one pickled `Order` on standard input, answers with one line of JSON: what each cycle took (ns).
"""

from __future__ import annotations

import json
import math
import pickle
import sys
import time
from array import array
from typing import Any, NamedTuple

from stagectl.drives.canopen.network import load_eds
from stagectl.drives.canopen.pdo import CommandPdo, FeedbackPdo
from stagectl.drives.drive import Canopen, Fault
from stagectl.kernels import law
from stagectl.realtime import scheduling
from stagectl.realtime.loop import Cycle, Job, connect, setpoint
from stagectl.recording.ring import Ring

_ENABLED = 0x000F  # controlword
PARTS = ("decode", "law", "encode", "ring", "whole")


class Order(NamedTuple):
    """What to measure."""

    job: Job
    frames: list[bytes]  # TPDOs to decode, one a period; empty: the drive on the bus sends them


def compute(order: Order, paced: bool) -> dict[str, Any]:
    """Codec, law and ring; nothing else is inside the clock.  Unpaced, cycle follows cycle and caches stay warm."""
    job, clock = order.job, time.perf_counter_ns
    assert isinstance(job.wire, Canopen)
    od = load_eds(job.wire.eds, job.wire.node)
    command, answer = CommandPdo(job.wire, od), FeedbackPdo(job.wire, od)
    ring = Ring(job.ring, job.width, job.capacity)
    state, step, nan = law.AT_REST, job.stage.encoder.step, math.nan
    marks = [array("q") for _ in PARTS]
    currents = array("d")
    metronome = scheduling.Metronome(job.dt)
    late = 0
    for k, raw in enumerate(order.frames):
        asked = setpoint(job.setpoints, k, 0.0)  # as the loop does, before the wait
        lateness = metronome.wait() if paced else 0.0
        begin = clock()
        statusword, counts, measured = answer.decode(raw)
        position = counts * step
        decoded = clock()
        output, state = law.step(job.law, state, asked, position)
        computed = clock()
        command.encode(_ENABLED, output.current)
        encoded = clock()
        ring.write((k * job.dt, *asked, *output, position, nan, measured, lateness, 0, statusword, 0))
        end = clock()
        late += paced and metronome.missed() > 0
        currents.append(output.current)
        spent = (decoded - begin, computed - decoded, encoded - computed, end - encoded, end - begin)
        for mark, value in zip(marks, spent, strict=True):
            mark.append(value)
    found = {name: mark.tolist() for name, mark in zip(PARTS, marks, strict=True)}
    return {"spent": found, "late": late, "currents": currents.tolist()}


def bus(order: Order) -> dict[str, Any]:
    """The loop's own cycle against the drive on the bus: CPU time of this thread, all of it."""
    job, clock = order.job, time.thread_time_ns
    ring = Ring(job.ring, job.width, job.capacity)
    drive = connect(job)
    spent = array("q")
    fault = Fault.NONE
    try:
        refused = scheduling.prepare(job.priority, job.cpu)
        origin = drive.enable().position
        cycle = Cycle(job, drive, ring, origin)
        while cycle.row < cycle.rows:
            begin = clock()
            fault = cycle()
            spent.append(clock() - begin)
            if fault is not Fault.NONE:
                drive.quick_stop()
                break
    finally:
        drive.close()
    return {"spent": {"whole": spent.tolist()}, "refused": refused, "late": cycle.late, "fault": int(fault)}


def main() -> None:
    """Entry of the process."""
    order: Order = pickle.load(sys.stdin.buffer)
    if not order.frames:
        print(json.dumps(bus(order)))
        return
    refused = scheduling.prepare(order.job.priority, order.job.cpu)
    warm = compute(order, paced=False)["spent"]["whole"]
    print(json.dumps({**compute(order, paced=True), "refused": refused, "warm": warm}))


if __name__ == "__main__":
    main()
