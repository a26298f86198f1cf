"""The real-time side of the cycle's benchmarks: a process like the loop's own, without numba in memory.

Takes one pickled `Order` on standard input, answers with one line of JSON: what each cycle took (ns).
"""

import json
import math
import pickle
import sys
import time
from array import array
from typing import Any, NamedTuple

from stagectl.drives.canopen.network import load_eds
from stagectl.drives.canopen.pdo import CommandPdo, FeedbackPdo
from stagectl.drives.drive import Canopen
from stagectl.kernels import law
from stagectl.realtime import scheduling
from stagectl.realtime import shared_memory as orders
from stagectl.realtime.axes import Loop, Post
from stagectl.realtime.setpoint_sources import Rows
from stagectl.realtime.single_axis import SingleAxis
from stagectl.realtime.states import Event, State
from stagectl.recording.ring import Ring

_ENABLED = 0x000F  # controlword
PARTS = ("decode", "law", "encode", "ring", "whole")


class Order(NamedTuple):
    """What to measure."""

    post: Post
    move: orders.Order  # its rows are on the board
    frames: list[bytes]  # TPDOs to decode, one a period; empty: the drive on the bus sends them


def compute(order: Order, paced: bool) -> dict[str, Any]:
    """Codec, law and ring; nothing else is inside the clock.  Unpaced, cycle follows cycle and caches stay warm."""
    (job,), clock = order.post.axes, time.perf_counter_ns
    assert isinstance(job.wire, Canopen)
    od = load_eds(job.wire.eds, job.wire.node)
    command, answer = CommandPdo(job.wire, od), FeedbackPdo(job.wire, od)
    ring, dt = Ring(*job.ring), order.post.dt
    source = Rows(orders.Board(job.board), int(order.move.numbers[0]), len(order.frames), 0.0)
    state, step, nan = law.AT_REST, job.stage.encoder.step, math.nan
    marks = [array("q") for _ in PARTS]
    currents = array("d")
    metronome = scheduling.Metronome(dt)
    late = 0
    for k, raw in enumerate(order.frames):
        lateness = metronome.wait() if paced else 0.0
        begin = clock()
        statusword, counts, measured = answer.decode(raw)
        position = counts * step
        decoded = clock()
        asked = source.next(1)
        assert asked is not None
        output, state = law.step(job.law, state, asked, position)
        computed = clock()
        command.encode(_ENABLED, output.current)
        encoded = clock()
        ring.write((k * dt, *asked, *output, position, nan, measured, lateness, 0, statusword, 0))
        end = clock()
        source.prepare()  # as the axis does, after its row
        late += paced and metronome.missed() > 0
        currents.append(output.current)
        spent = (decoded - begin, computed - decoded, encoded - computed, end - encoded, end - begin)
        for mark, value in zip(marks, spent, strict=True):
            mark.append(value)
    found = {name: mark.tolist() for name, mark in zip(PARTS, marks, strict=True)}
    return {"spent": found, "late": late, "currents": currents.tolist()}


def bus(order: Order) -> dict[str, Any]:
    """The periods of the motion against the drive on the bus: CPU time of this thread, all of it."""
    post, clock, spent = order.post, time.thread_time_ns, array("q")
    loop, board = Loop(post), orders.Board(post.axes[0].board)
    (axis,) = loop.axes
    assert isinstance(axis, SingleAxis)
    try:
        loop.connect()
        refused = scheduling.prepare(post.priority, post.cpu)
        board.order(orders.Order(Event.ENABLE))
        board.order(order.move)
        loop.begin()
        while not axis.over:
            moving, begin = axis.state is State.MOVING, clock()
            loop.period()
            if moving:
                spent.append(clock() - begin)
    finally:
        axis.leave()
    return {"spent": {"whole": spent.tolist()}, "refused": refused, "late": axis.late_rows, "fault": int(axis.fault)}


def main() -> None:
    """Entry of the process."""
    order: Order = pickle.load(sys.stdin.buffer)
    if not order.frames:
        print(json.dumps(bus(order)))
        return
    refused = scheduling.prepare(order.post.priority, order.post.cpu)
    warm = compute(order, paced=False)["spent"]["whole"]
    print(json.dumps({**compute(order, paced=True), "refused": refused, "warm": warm}))


if __name__ == "__main__":
    main()
