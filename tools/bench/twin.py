"""What the live twin costs, and that it costs the loop nothing: cycles with and without it, in turn."""

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cycle
import numpy as np
from cycle_child import Order
from measure import Row, Wanted, scaled, spread, times_faster
from scene import Scene, posted, scene, shared

from stagectl.recording.ring import Ring
from stagectl.service.child_process import Child, start
from stagectl.service.single_motion import laid_on
from stagectl.simulation import simulate
from stagectl.twin.live_model import step, twin_of
from stagectl.twin.record import live_file
from stagectl.twin.start import companion
from stagectl.twin.thresholds import BLOCK

_MOTION = "sine-0.8hz"
_SHARE = 10.0  # % of a core


class Beside(NamedTuple):
    """One run of the loop's cycle on the bus."""

    spent: dict[str, Any]  # as cycle_child tells it
    seen: dict[str, Any] | None  # the twin's last words


def rows(channel: str, folder: Path, rounds: int) -> list[Row]:
    """All of it; the drive must be on the bus `channel`."""
    one = scene(_MOTION)
    alone, strange, watched = [], [], []
    for number in range(rounds):
        with _stranger():
            strange.append(_run(one, channel, None))
        watched.append(_run(one, channel, folder / f"twin-{number}.h5"))
        alone.append(_run(one, channel, None))
    return [*_own(one, 2 * rounds), *_live(watched), *_loop(alone, strange, watched)]


@contextlib.contextmanager
def _stranger() -> Iterator[None]:
    """A process that computes as much as the twin, and knows nothing of the ring."""
    busy = "import time\nwhile True:\n e = time.thread_time() + 0.0125\n while time.thread_time() < e: pass\n"
    process = subprocess.Popen([sys.executable, "-c", f"import os\nos.nice(5)\n{busy} time.sleep(0.2375)"])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def _own(one: Scene, rounds: int) -> list[Row]:
    """CPU of the twin's arithmetic over a simulated run, blocks as they come live."""
    samples = simulate(one.setup, one.plan, one.controller.law)
    table = samples.view(np.float64).reshape(len(samples), -1)
    p, size, found = twin_of(one.controller.law, one.setup.stage, one.setup.dt), round(BLOCK / one.setup.dt), []
    for _ in range(rounds + 1):
        begin, x = time.thread_time(), None
        for start_row in range(0, len(table), size):
            _, x = step(p, x, table[start_row : start_row + size])
        found.append((time.thread_time() - begin) / one.duration)
    method = f"gap.twin.step, {len(p.models)} tied models at {p.substeps} substeps, thread CPU over data, compiled"
    return [Row("twin: its arithmetic", scaled(found[1:], 100.0), "% core", None, method)]  # the first one compiles


def _live(runs: list[Beside]) -> list[Row]:
    seen = [run.seen for run in runs if run.seen is not None]
    method = "gap.twin_process beside the loop's Cycle on the embedded bus at 2 kHz; its own thread clock over data"
    lost = [float(found["skipped_rows"]) for found in seen]
    return [
        Row(
            "twin: share of a core",
            spread([100.0 * found["cpu_share"] for found in seen]),
            "%",
            Wanted(_SHARE, False),
            method,
        ),
        Row("twin: rows skipped", spread(lost), f"of {seen[0]['rows']}", None, "the same runs"),
    ]


def _loop(alone: list[Beside], strange: list[Beside], watched: list[Beside]) -> list[Row]:
    """Quantiles of the cycle's thread CPU, and their ratios, round by round."""
    method = (
        "thread CPU of the loop's cycle over the embedded bus: alone, with the twin, and with a stranger of the same "
        "load that does not know the ring, in turn: what the twin adds to the stranger is what reading costs the loop"
    )
    found = []
    for name, share in (("p50", 0.5), ("p99.9", 0.999)):
        costs = [_quantiles(runs, share) for runs in (alone, strange, watched)]
        for what, values in zip(("alone", "with a stranger", "with the twin"), costs, strict=True):
            found.append(Row(f"cycle {what}, {name}", spread(values), "us", None, method))
        for what, base in (("alone", costs[0]), ("stranger", costs[1])):
            found.append(Row(f"  twin over {what}, {name}", times_faster(base, costs[2]), "x", None, method))
    return found


def _quantiles(runs: list[Beside], share: float) -> list[float]:
    return [1e-3 * float(np.quantile(run.spent["spent"]["whole"], share)) for run in runs]


def _run(one: Scene, channel: str, recording: Path | None) -> Beside:
    memory = shared(one)
    ring, board = memory
    alive, held = os.pipe()
    child = None if recording is None else _started(one, ring, alive, recording)
    move = laid_on(board, one.plan.setpoints)
    spent = cycle._child(Order(posted(one, channel, memory), move, []), memory)
    if spent["fault"]:
        raise SystemExit(f"bench: the loop stopped with fault {spent['fault']} on the bus")
    ring.close()
    os.close(held)
    if child is not None and child.wait(60.0) != 0:
        raise SystemExit("bench: the twin died")
    os.close(alive)
    seen = None if recording is None else json.loads(live_file(recording).read_text(encoding="utf-8"))
    return Beside(spent, seen)


def _started(one: Scene, ring: Ring, alive: int, recording: Path) -> Child:
    order = companion(one.setup, one.controller.law, recording).order(ring, alive)
    child = start("stagectl.twin.process", (ring.descriptor, alive), "compiled")
    child.send(order)
    child.line()
    return child
