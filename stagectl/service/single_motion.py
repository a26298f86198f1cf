"""One motion on a drive: start the loop and its recorder, watch them, tell how it went.

::

    this process -- job ------> loop process ====== CAN ====== drive (virtual: a process of its own)
         |                        | ring in shared memory
         +------ order -------> recorder process ---> recording.h5
         +------ order -------> companion, e.g. the live twin (twin/process.py): reads the ring, nothing else
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.config.stage_blocks import InProcess
from stagectl.config.stage_file import Setup
from stagectl.drives.drive import DriveError
from stagectl.kernels import law, rollout
from stagectl.plan import Plan
from stagectl.realtime.envelope import envelope
from stagectl.realtime.loop import Job
from stagectl.recording.metadata import portable
from stagectl.recording.recorder import Order
from stagectl.recording.ring import Ring
from stagectl.service.child_process import Child, Companion, beside, start
from stagectl.service.virtual_timeouts import patient, waits_for_sync

Progress = Callable[[int, int], None]  # (cycles done, cycles in all)


class Motion(NamedTuple):
    """What to run, and where to record it."""

    setup: Setup
    plan: Plan
    law: law.Law
    meta: dict[str, Any]
    recording: Path
    companion: Companion | None = None


class Ended(NamedTuple):
    """How the loop says it went."""

    cycles: int
    late: int
    fault: int
    words: str
    reason: str
    refused: list[str]  # what the kernel did not permit
    recorded: bool  # whether the recorder saw it to the end
    companion: int | None = None  # exit code of the companion; None: there was none


def move(motion: Motion, progress: Progress) -> Ended:
    """Run the motion to its end or its first fault.

    Raises DriveError where the drive cannot be reached or enabled, or the loop's process dies.
    """
    motion.recording.parent.mkdir(parents=True, exist_ok=True)
    ring = Ring.create(rollout.WIDTH)
    alive, held = os.pipe()
    with beside(motion.companion, ring, alive) as codes:
        ended = _move(motion, ring, (alive, held), progress)
    return ended._replace(companion=codes[0] if codes else None)


def _move(motion: Motion, ring: Ring, pipe: tuple[int, int], progress: Progress) -> Ended:
    alive, held = pipe
    with _started("recorder", (ring.descriptor, alive)) as recorder, _started("loop", (ring.descriptor, held)) as loop:
        os.close(held)
        return _watch(motion, loop, recorder, (ring, alive), progress)


def _watch(motion: Motion, loop: Child, recorder: Child, shared: tuple[Ring, int], progress: Progress) -> Ended:
    ring, alive = shared
    loop.send(_job(motion, ring))
    connected = _event(loop, "connected")
    meta = {**motion.meta, "drive": connected["drive"]}
    recorder.send(
        Order(ring.descriptor, ring.width, ring.capacity, alive, str(motion.recording), meta, rollout.COLUMNS)
    )
    if recorder.line() != "ready":
        raise DriveError(f"the recorder cannot write {motion.recording}: nothing has moved; see the message above")
    loop.say("go")
    moving = _event(loop, "moving")
    ended = _follow(loop, ring, len(motion.plan.setpoints), progress)
    recorded = recorder.wait() == 0
    facts = {name: ended[name] for name in ("cycles", "late", "fault", "words", "reason")}
    return Ended(**facts, refused=moving["refused"], recorded=recorded)


def _follow(loop: Child, ring: Ring, total: int, progress: Progress) -> dict[str, Any]:
    """Show progress from the ring until the loop says that it has ended; hand an interrupt on to it."""
    while True:
        try:
            if loop.readable(0.05):
                ended = _event(loop, "ended")
                progress(ended["cycles"], total)
                return ended
            progress(ring.written, total)
        except KeyboardInterrupt:  # the loop has had the same signal and stops the axis: hear it out
            loop.signal(signal.SIGINT)


def _job(motion: Motion, ring: Ring) -> Job:
    setup = patient(motion.setup)
    wire = setup.file.drive.wire
    return Job(
        law=motion.law,
        setpoints=motion.plan.setpoints.tobytes(),
        span=(float(motion.plan.setpoints[:, 0].min()), float(motion.plan.setpoints[:, 0].max())),
        dt=setup.dt,
        by_clock=not waits_for_sync(setup),
        wire=None if isinstance(wire, InProcess) else wire,
        stage=portable(setup.stage),
        simulation=setup.file.simulation,
        envelope=envelope(setup),
        priority=setup.file.realtime.priority,
        cpu=setup.file.realtime.cpu,
        ring=ring.descriptor,
        width=ring.width,
        capacity=ring.capacity,
        spin=setup.file.realtime.spin,
    )


def _event(process: Child, expected: str) -> dict[str, Any]:
    """The next event of the loop, which must be `expected`.

    Raises DriveError with the loop's reason otherwise.
    """
    line = process.line()
    if not line:
        raise DriveError("the loop's process died; the drive stops by itself within its heartbeat time-out")
    event: dict[str, Any] = json.loads(line)
    if event["event"] != expected:
        raise DriveError(event.get("reason", f"the loop said {event['event']} instead of {expected}"))
    return event


@contextlib.contextmanager
def _started(part: str, descriptors: tuple[int, ...]) -> Iterator[Child]:
    module = {"loop": "stagectl.realtime.loop", "recorder": "stagectl.recording.recorder"}[part]
    child = start(module, descriptors, "interpreted")  # no numba in their memory
    try:
        yield child
    finally:
        if part == "loop":
            child.terminate()  # it stops the axis and leaves; then the recorder ends by itself
        child.wait()
