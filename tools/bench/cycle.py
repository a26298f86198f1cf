"""What one cycle costs: its computation, paced at 2 kHz, and all of it over the embedded bus."""

import json
import os
import pickle
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from cycle_child import PARTS, Order
from measure import Row, Wanted, spread
from scene import Scene, posted, scene, shared
from simulator import run

from stagectl.drives.drive import Canopen
from stagectl.realtime.axes import Post
from stagectl.service.single_motion import Shared, laid_on

_TPDO = struct.Struct("<IB3xHihx")  # the head, then statusword, position, current of the virtual drive's EDS
_STATUSWORD = 0x0627


def rows(channel: str, rounds: int) -> list[Row]:
    """Both measurements, in turn; the drive must be on the bus `channel`."""
    one = scene("sine-1.6hz")
    memory = shared(one)
    post, move = posted(one, channel, memory), laid_on(memory.board, one.plan.setpoints)
    frames, currents = _frames(one, post)
    computed, cycled = [], []
    for _ in range(rounds):
        computed.append(_child(Order(post, move, frames), memory))
        cycled.append(_child(Order(post, move, []), memory))
    _check(computed, currents, cycled)
    return [*_compute_rows(computed), *_bus_rows(cycled)]


def _frames(one: Scene, post: Post) -> tuple[list[bytes], list[float]]:
    """The drive's answers in a simulated run, and the currents that the law must find from them."""
    wire, samples = post.axes[0].wire, run(one)
    assert isinstance(wire, Canopen)
    counts = np.rint(samples["measured"] / one.setup.stage.encoder.step).astype(int).tolist()
    currents = np.rint(samples["measured_current"] / wire.current_scale).astype(int).tolist()
    head = 0x180 + wire.node
    frames = [_TPDO.pack(head, 8, _STATUSWORD, place, flow) for place, flow in zip(counts, currents, strict=True)]
    return frames, samples["current"].tolist()


def _child(order: Order, memory: Shared) -> dict[str, Any]:
    command = [sys.executable, str(Path(__file__).with_name("cycle_child.py"))]
    environment = {**os.environ, "STAGECTL_KERNELS": "interpreted"}
    done = subprocess.run(
        command,
        input=pickle.dumps(order),
        stdout=subprocess.PIPE,
        env=environment,
        pass_fds=(memory.ring.descriptor, memory.board.descriptor),
        check=True,
    )
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def _check(computed: list[dict[str, Any]], currents: list[float], cycled: list[dict[str, Any]]) -> None:
    """A benchmark of something else would be worthless: the paced law must find the simulated run's currents."""
    if any(found["currents"] != currents for found in computed):
        raise SystemExit("bench: the paced law does not find the simulator's currents: nothing was measured")
    if any(found["fault"] for found in cycled):
        raise SystemExit(f"bench: the loop stopped with fault {[found['fault'] for found in cycled]} on the bus")


def _warm(runs: list[dict[str, Any]]) -> list[float]:
    return [1e-3 * float(np.median(found["warm"])) for found in runs]


def _quantile(runs: list[dict[str, Any]], part: str, share: float) -> list[float]:
    """A quantile (us) of each run."""
    return [1e-3 * float(np.quantile(found["spent"][part], share)) for found in runs]


def _compute_rows(runs: list[dict[str, Any]]) -> list[Row]:
    method = (
        "decode TPDO, law.step (feedforward and friction are laid out beforehand), encode RPDO, write a row of the "
        "ring; elapsed time, interpreted, "
        f"own process, paced at 2 kHz by the loop's metronome; {_permitted(runs)}; currents equal the simulator's"
    )
    parts = [
        Row(f"  of it: {part}, p50", spread(_quantile(runs, part, 0.5)), "us", None, "the same run")
        for part in PARTS[:-1]
    ]
    return [
        Row("compute of a cycle, p50", spread(_quantile(runs, "whole", 0.5)), "us", Wanted(10.0, False), method),
        Row("compute of a cycle, p99.9", spread(_quantile(runs, "whole", 0.999)), "us", Wanted(60.0, False), method),
        *parts,
        Row(
            "  the same, back to back, p50",
            spread(_warm(runs)),
            "us",
            None,
            "unpaced: what cold caches and other load add",
        ),
    ]


def _bus_rows(runs: list[dict[str, Any]]) -> list[Row]:
    method = (
        "a period of the real-time process (wait, sample, law, judge, apply, ring, board) against the virtual drive in "
        "its own process, embedded "
        f"bus, 2 kHz; thread CPU time; {_permitted(runs)}; late cycles {[found['late'] for found in runs]}"
    )
    return [
        Row(
            "thread CPU of a cycle over the bus, p50",
            spread(_quantile(runs, "whole", 0.5)),
            "us",
            Wanted(100.0, False),
            method,
        ),
        Row("thread CPU of a cycle over the bus, p99.9", spread(_quantile(runs, "whole", 0.999)), "us", None, method),
    ]


def _permitted(runs: list[dict[str, Any]]) -> str:
    refused = runs[0]["refused"]
    return "not real time: " + "; ".join(refused) if refused else "SCHED_FIFO, memory locked"
