"""Processes as they really run: what a command takes to start; the loop's and the recorder's memory, CPU and file."""

import json
import os
import pickle
import resource
import select
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

from measure import Row, Wanted, scaled
from scene import STAGE, posted, scene, shared, trajectory

from stagectl.kernels import rollout
from stagectl.realtime import shared_memory as orders
from stagectl.realtime.states import Event
from stagectl.recording.metadata import describe
from stagectl.recording.recorder import Order
from stagectl.recording.ring import Ring
from stagectl.service.single_motion import laid_on

_MOTION = "sine-1.6hz"
_SIMULATE = ("-m", "stagectl", "simulate", str(STAGE), str(STAGE.parent / "trajectories" / f"{_MOTION}.yaml"))
# What is typed, its arguments, the most CPU that it may take (s), and whether the machine is a new one.
_STARTS = (
    ("import stagectl", ("-c", "import stagectl"), 0.15, False),
    ("stagectl --help", ("-m", "stagectl", "--help"), 0.25, False),
    ("stagectl status", ("-m", "stagectl", "status"), 0.3, False),
    ("stagectl simulate", (*_SIMULATE, "--json", "-"), 1.5, False),
    ("stagectl simulate, the first on a new machine", (*_SIMULATE, "--json", "-"), 8.0, True),
)


class Facts(NamedTuple):
    """One run."""

    start: float  # s, from spawn until connected to the drive
    memory: float  # MiB, peak of the loop
    recorder: float  # s of CPU per s of data
    recorder_memory: float  # MiB
    row: float  # bytes of the file per row


def rows(channel: str, folder: Path, rounds: int) -> list[Row]:
    """All of it, in so many runs; the drive must be on the bus `channel`."""
    runs = [_run(channel, folder / f"bench-{number}.h5") for number in range(rounds)]
    live = "daemon.axes and recording.recorder as `stagectl run` starts them, on the embedded bus at 2 kHz"
    hour = 2000.0 * 3600.0 / 2**20
    lines = (
        ("loop process: spawn to connected", [r.start for r in runs], "s", "SDO set-up of the drive included"),
        ("loop process: peak memory", [r.memory for r in runs], "MiB", "VmHWM with all memory locked"),
        ("recorder: CPU per second of data", [1e3 * r.recorder for r in runs], "ms", "its process clock"),
        ("recorder: peak memory", [r.recorder_memory for r in runs], "MiB", "VmHWM"),
        ("recording per hour at 2 kHz", [hour * r.row for r in runs], "MiB", f"{rollout.WIDTH} float64 columns"),
    )
    return [Row(what, scaled(values, 1.0), unit, None, f"{live}; {remark}") for what, values, unit, remark in lines]


def starts(rounds: int) -> list[Row]:
    """What a command takes, from its start to its end; each in turn."""
    with tempfile.TemporaryDirectory(prefix="stagectl-") as folder:
        taken = [[_start(start, Path(folder) / str(number)) for start in _STARTS] for number in range(rounds + 1)][1:]
    method = "a process, all its threads and children; the first round reads the disk and is left out; no service runs"
    return [
        Row(what, scaled(list(values), 1.0), "s", Wanted(most, False), method)
        for (what, _, most, _), values in zip(_STARTS, zip(*taken, strict=True), strict=True)
    ]


def _start(start: tuple[str, tuple[str, ...], float, bool], folder: Path) -> float:
    """CPU time (s); a new machine has neither compiled kernels nor compiled modules."""
    _, arguments, _, fresh = start
    folder.mkdir(exist_ok=True)
    new = {"XDG_CACHE_HOME": str(folder), "PYTHONPYCACHEPREFIX": str(folder)} if fresh else {}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], cwd=folder, env={**os.environ, **new}, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _run(channel: str, path: Path) -> Facts:
    alive, held = os.pipe()
    one = scene(_MOTION)
    memory = shared(one)
    ring, board = memory
    begin = time.perf_counter()
    loop = _spawn("stagectl.realtime.axes", (ring.descriptor, board.descriptor, held))
    os.close(held)
    _send(loop, posted(one, channel, memory))
    connected = _event(loop)
    start = time.perf_counter() - begin
    recorder = _spawn("stagectl.recording.recorder", (ring.descriptor, alive))
    motion = trajectory(_MOTION)
    about = describe(one.setup, one.plan, one.controller, motion.name, motion.read_text(encoding="utf-8"))
    meta = {**about, "drive": connected["drive"]}
    _send(recorder, Order(ring.place, alive, str(path), meta, rollout.COLUMNS))
    assert recorder.stdout is not None
    assert loop.stdin is not None
    recorder.stdout.readline()
    board.order(orders.Order(Event.ENABLE))
    board.order(laid_on(board, one.plan.setpoints))
    loop.stdin.write(b"go\n")
    loop.stdin.flush()
    cpu, loop_memory, recorder_memory = _watch(loop, recorder, ring)
    loop.communicate()
    recorder.communicate()
    os.close(alive)
    return Facts(start, loop_memory, cpu, recorder_memory, path.stat().st_size / ring.written)


def _watch(loop: subprocess.Popen[bytes], recorder: subprocess.Popen[bytes], ring: Ring) -> tuple[float, float, float]:
    """CPU of the recorder per second of data between two looks, and the peaks of both memories (MiB)."""
    looks: list[tuple[int, float]] = []
    memory = recorder_memory = 0.0
    assert loop.stdout is not None
    while not select.select([loop.stdout], [], [], 0.1)[0]:
        looks.append((ring.written, _cpu(recorder.pid)))
        memory, recorder_memory = _peak(loop.pid), _peak(recorder.pid)
    # The first look is left out: the recorder has only just started, and touches its memory for the first time.
    (first, before), (last, after) = looks[1], looks[-1]
    return (after - before) / ((last - first) / 2000.0), memory, recorder_memory


def _cpu(pid: int) -> float:
    """CPU time (s) of another process, by its clock: ``CPUCLOCK_SCHED`` of linux/posix-timers.h."""
    return time.clock_gettime(~pid << 3 | 2)


def _peak(pid: int) -> float:
    """Largest resident memory (MiB) since its start; `ru_maxrss` would count the parent's."""
    for line in Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmHWM"):
            return float(line.split()[1]) / 1024.0
    raise SystemExit(f"bench: process {pid} has ended before its memory was read")


def _spawn(module: str, descriptors: tuple[int, ...]) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "STAGECTL_KERNELS": "interpreted"}
    command = [sys.executable, "-m", module]
    return subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        pass_fds=descriptors,
        env=environment,
        cwd=STAGE.parents[1],
    )


def _send(process: subprocess.Popen[bytes], order: object) -> None:
    assert process.stdin is not None
    pickle.dump(order, process.stdin)
    process.stdin.flush()


def _event(process: subprocess.Popen[bytes]) -> dict[str, Any]:
    assert process.stdout is not None
    event: dict[str, Any] = json.loads(process.stdout.readline() or b'{"event": "died"}')
    if event["event"] in ("failed", "died"):
        raise SystemExit(f"bench: the loop's process {event['event']}: {event.get('reason', 'see above')}")
    return event
