"""The service's real-time process for an hour: ``python tools/soak.py [SECONDS] [--wall]``.

The process is the service's own (`stagectl.realtime.axes`), an axis at 2 kHz that goes to and fro on one sine after the
other, with the stage model as its drive and a recorder that writes each row to disk.  Its periods follow each other as
fast as they are done (simulated time), or with ``--wall`` by the clock.  It says how the memory of the process grows
after the first tenth, whether a row was lost, and how soon and how large the process is with a CANopen drive.

Simulated time waits for the recorder: it does not go on while the ring holds more than `UNREAD` rows that the recorder
has not written.  Rows are then lost by an error alone, not by a busy machine.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stagectl.recording.ring import Ring

os.environ["STAGECTL_KERNELS"] = "interpreted"
ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

GROWTH, LARGEST, SOONEST = 1024, 80 * 1024, 0.5  # KiB, KiB, s: what is admitted
YARDSTICK = "import asyncio, http.client, unittest, xml.dom.minidom"  # a start of like kind: files, then objects
YARD = 0.08  # s of processor time that it takes on the machine that `SOONEST` was chosen for
SINE = "{type: sine, amplitude: 2 mm, frequency: 1 Hz, periods: 8}"
LOOP, RECORDER = "-loop", "-recorder"  # what this program is to be, in place of the service's side
STARTS = 3  # the machine is shared: the best of so many
UNREAD = 1 << 13  # rows that simulated time may be ahead of the recorder: 16 of its blocks, a quarter of the ring
KEPT = 7  # place among the ring's counts, which the ring itself does not use: rows that the recorder has written


def loop() -> None:
    """Be the real-time process, with a clock whose waits take no time but for the recorder."""
    import pickle

    from stagectl.drives.bus.virtual_time import Timeline
    from stagectl.realtime import axes
    from stagectl.recording.ring import Ring

    post = pickle.load(sys.stdin.buffer)
    ring = Ring(*post.axes[0].ring)

    class Waiting(Timeline):
        """Simulated time that goes on while the ring has room."""

        def sleep(self, seconds: float) -> None:
            while unread(ring) > UNREAD:
                time.sleep(0.001)
            super().sleep(seconds)

    axes.serve(post, Waiting())
    os._exit(0)


def recorder() -> None:
    """Be the recorder, which notes in the ring how far it is: it asks for rows when it has written those before."""
    from stagectl.recording import recorder as service
    from stagectl.recording import ring

    class Noting(ring.Ring):
        """A ring that its reader marks."""

        def read(self, start: int, most: int) -> tuple[int, bytes]:
            self._counts[KEPT] = start
            return super().read(start, most)

    service.Ring = Noting  # type: ignore[attr-defined]
    service.main()


def unread(ring: Ring) -> int:
    """Rows of the ring that the recorder has not reported as written."""
    return ring.written - ring._counts[KEPT]


def resident(pid: int) -> int:
    """Memory of a process (KiB)."""
    text = Path(f"/proc/{pid}/status").read_text()
    return int(text.split("VmRSS:")[1].split()[0])


class Soak:
    """The service's side: processes, orders, and what is seen of them."""

    def __init__(self, folder: Path, wall: bool) -> None:
        import subprocess

        from stagectl.config.stage_blocks import InProcess
        from stagectl.config.stage_file import load_stage
        from stagectl.realtime.axes import Post
        from stagectl.recording.recorder import Order
        from stagectl.service.axis_controller import COLUMNS, AxisController
        from stagectl.service.child_process import Child, start
        from stagectl.service.planning import Upload, laid_out

        setup = load_stage(ROOT / "config" / "ball-screw.yaml")
        file = setup.file._replace(
            drive=setup.file.drive._replace(wire=InProcess()), simulation=setup.file.simulation._replace(substeps=1)
        )
        self.axis = axis = AxisController("axis", setup._replace(file=file))
        self.path = folder / "soak.h5"
        alive, held = os.pipe()
        shared = (axis.ring.descriptor, axis.board.descriptor, held)

        def ours(role: str, *descriptors: int) -> Child:
            words = [sys.executable, __file__, role]
            return Child(subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, pass_fds=descriptors))

        self.loop = start("stagectl.realtime.axes", shared, "interpreted") if wall else ours(LOOP, *shared)
        os.close(held)
        self.loop.send(Post((axis.orders(),), setup.dt, 0, None, True))
        self.recorder = ours(RECORDER, axis.ring.descriptor, alive)
        meta: dict[str, Any] = {"name": "soak", "created": "", "axis": {"kind": "rotary"}}
        self.recorder.send(Order(axis.ring.place, alive, str(self.path), meta, COLUMNS))
        assert self.recorder.line() == "ready" and self.loop.line()
        self.motion = laid_out(axis.task("sine", Upload(SINE, {})))

    def run(self, seconds: float) -> list[tuple[float, int]]:
        """Go to and fro for so long (s, the axis' own time); time and memory (KiB) of the process meanwhile."""
        from stagectl.realtime.shared_memory import Order
        from stagectl.realtime.states import Event, State

        axis, seen, shown = self.axis, list[tuple[float, int]](), time.monotonic()
        axis.board.order(Order(Event.ENABLE))
        while (now := axis.status.cycles * axis.setup.dt) < seconds:
            status = axis.status
            assert status.fault == 0.0, axis.board.words
            assert self.loop.ended is None and self.recorder.ended is None  # time would wait for ever
            if status.state == State.STANDING:
                axis.board.order(axis.start(self.motion, 1))
                while axis.status.motions == status.motions:
                    time.sleep(0.001)
            axis.fill()
            if not seen or now - seen[-1][0] >= seconds / 200.0:
                seen.append((now, resident(self.loop.pid)))
            if time.monotonic() - shown > 30.0:
                shown = time.monotonic()
                print(f"  {now:.0f} s of {seconds:.0f} s, {seen[-1][1]} KiB", flush=True)
            time.sleep(0.005)
        seen.append((now, resident(self.loop.pid)))  # a short one may be over before a second look
        return seen

    def end(self) -> tuple[int, int, int]:
        """Rows written by the loop, kept by the recorder, and lost."""
        import h5py

        self.loop.terminate()
        assert self.loop.wait(60.0) == 0
        assert self.recorder.wait(600.0) == 0
        with h5py.File(self.path, "r") as file:
            return self.axis.ring.written, file["samples"].shape[0], int(file.attrs["lost_rows"])


def worked(pid: int) -> float:
    """Processor time of a process (s)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def started() -> tuple[float, float, int]:
    """With a CANopen drive that is there, to its configuration: time (s), processor time of it (s), and then KiB."""
    from stagectl.realtime.axes import Post
    from stagectl.service.child_process import start
    from stagectl.service.machine import machine
    from tests.service.serving import Served

    with tempfile.TemporaryDirectory() as folder:
        drive = Served(Path(folder))
        try:
            drive.start_drive()
            axis = machine([str(drive.stage)], str(Path(folder) / "bus"))["axis"]
            post = Post((axis.orders(),), axis.setup.dt, 0, None, True)
            began = time.monotonic()
            loop = start("stagectl.realtime.axes", (axis.ring.descriptor, axis.board.descriptor), "interpreted")
            loop.send(post)
            assert loop.line()
            sample = time.monotonic() - began, worked(loop.pid), resident(loop.pid)
            loop.terminate()
            assert loop.wait(60.0) == 0
            return sample
        finally:
            drive.end()


def slowness() -> float:
    """How many times more processor time a start takes here and now than where `SOONEST` was chosen; at least 1.

    Processor time is no property of a program alone: it grows where other programs use the same cores and caches.
    """
    import resource
    import subprocess

    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-S", "-c", YARDSTICK], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return max(1.0, (after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime) / YARD)


def main() -> None:
    words = [word for word in sys.argv[1:] if not word.startswith("-")]
    seconds, wall = float(words[0]) if words else 3600.0, "--wall" in sys.argv
    starts = [(started(), slowness()) for _ in range(STARTS)]
    (soon, busy, large), slow = min(starts, key=lambda start: start[0][1] / start[1])
    print(
        f"start to configured drive, best of {STARTS}: {soon:.2f} s, {busy:.2f} s of it processor time "
        f"(admitted {SOONEST} on a machine {slow:.2f} times slower), {large} KiB (admitted {LARGEST})",
        flush=True,
    )
    with tempfile.TemporaryDirectory() as folder:
        began, soak = time.monotonic(), Soak(Path(folder), wall)
        seen = soak.run(seconds)
        written, kept, lost = soak.end()
    settled = [memory for when, memory in seen if when >= 0.1 * seconds]
    growth = max(settled) - settled[0]
    print(
        f"{seconds:.0f} s at 2 kHz in {time.monotonic() - began:.0f} s, {'by the clock' if wall else 'simulated time'}"
    )
    print(f"memory {settled[0]} KiB after a tenth, at most {growth} KiB more (admitted {GROWTH})")
    print(f"{written} rows, {kept} recorded, {lost} lost (admitted 0)")
    raise SystemExit(growth > GROWTH or lost > 0 or kept != written or large > LARGEST or busy > SOONEST * slow)


if __name__ == "__main__":
    {LOOP: loop, RECORDER: recorder}.get(sys.argv[-1], main)()
