"""Can this computer run the stage?  One line a check, green or red; each red one with the command that fixes it."""

import contextlib
import json
import math
import os
import resource
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from stagectl.config.stage_blocks import Retention
from stagectl.config.stage_file import Setup
from stagectl.config.time_outs import axis_limits
from stagectl.drives.bus.frames import Bus
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.bus.other_masters import OtherMasterError, alone
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.network import PumpedNode, load_eds
from stagectl.drives.canopen.object_access import ObjectAccess
from stagectl.drives.canopen.protection import NOT_OFFERED, outlook
from stagectl.drives.cycle_time import bus_load
from stagectl.drives.drive import Canopen, DriveError
from stagectl.service import virtual_drive
from stagectl.service.recordings import DAY, GIB, in_words, kept
from stagectl.service.virtual_timeouts import waits_for_sync

_WAKES = 200  # of the wake-up check
_PERIOD = 1e-3  # s
_DISK = 1 << 30  # bytes that a month of black boxes and recordings may need
_SYS = Path("/sys/devices/system/cpu")


class Check(NamedTuple):
    """The result of one check."""

    name: str
    good: bool
    words: str
    fix: str = ""  # the command, where it is not good


def examine(setup: Setup, folder: Path, served: bool) -> Iterator[Check]:
    """All checks, one after the other; `served`: a service runs and uses the bus."""
    yield _scheduling(setup.file.realtime.priority)
    yield _memory()
    yield _throttling()
    yield _kernel()
    yield _governor()
    yield _isolation(setup.file.realtime.cpu)
    yield _sleep()
    yield _disk(folder)
    yield _recordings(setup.file.recordings, folder)
    wire = setup.file.drive.wire
    if isinstance(wire, Canopen):
        yield _interface(wire)
        yield _load(setup, wire)
        yield from _drive(setup, wire, served)


def _scheduling(priority: int) -> Check:
    """Try it in a child process: only this shows a cgroup without real-time budget, or a seccomp filter."""
    if priority == 0:
        words = "realtime.priority = 0: ordinary scheduling"
        return Check("real-time class", False, words, "set realtime.priority: 80")
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:  # only the measurement: the child never returns into the parent's code
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
            os.write(writing, json.dumps(_wakes()).encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        answer = pipe.read()
    os.waitpid(child, 0)
    if not answer:
        fix = "LimitRTPRIO=90 in the unit (`stagectl service install` does it), or `ulimit -r 90`"
        return Check("real-time class", False, f"SCHED_FIFO {priority} is not permitted", fix)
    p50, p99, worst = (1e6 * value for value in json.loads(answer))
    late = f"{p50:.0f} (median), {p99:.0f} (99 %), {worst:.0f} (most) µs late"
    return Check("real-time class", True, f"SCHED_FIFO {priority}; it wakes {late}")


def _wakes() -> tuple[float, float, float]:
    late, due = [], time.monotonic()
    for _ in range(_WAKES):
        due += _PERIOD
        time.sleep(max(due - time.monotonic(), 0.0))
        late.append(time.monotonic() - due)
    late.sort()
    return late[_WAKES // 2], late[_WAKES * 99 // 100], late[-1]


def _memory() -> Check:
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    good = limit == resource.RLIM_INFINITY or limit >= 128 << 20 or os.geteuid() == 0
    amount = "unlimited" if limit == resource.RLIM_INFINITY else f"{limit >> 10} KiB"
    return Check("locked memory", good, f"{amount} may be locked", "LimitMEMLOCK=infinity, or `ulimit -l unlimited`")


def _throttling() -> Check:
    share = _text(Path("/proc/sys/kernel/sched_rt_runtime_us"))
    good = share == "-1" or int(share or 950000) >= 900000
    words = f"sched_rt_runtime_us = {share or 'unknown'} of 1000000"
    return Check("real-time share", good, words, "sysctl kernel.sched_rt_runtime_us=950000")


def _kernel() -> Check:
    good = _text(Path("/sys/kernel/realtime")) == "1"
    words = f"{os.uname().release}, {'PREEMPT_RT' if good else 'no PREEMPT_RT: the kernel itself causes late cycles'}"
    return Check("kernel", good, words, "apt install linux-image-rt-amd64, then boot it")


def _governor() -> Check:
    governors = {_text(path) for path in _SYS.glob("cpu[0-9]*/cpufreq/scaling_governor")}
    words = ", ".join(sorted(governors)) or "no frequency scaling"
    return Check("governor", governors <= {"performance"}, words, "cpupower frequency-set -g performance")


def _isolation(cpu: int | None) -> Check:
    isolated = _text(_SYS / "isolated")
    if cpu is None:
        words = "realtime.cpu is not set: the loop may run anywhere"
        return Check("CPU", False, words, "set realtime.cpu: 1, boot with isolcpus=1")
    good = str(cpu) in _listed(isolated)
    return Check("CPU", good, f"CPU {cpu}; isolated: {isolated or 'none'}", f"boot with isolcpus={cpu} nohz_full={cpu}")


def _listed(text: str) -> set[str]:
    """The numbers of a list such as ``1-3,7``."""
    numbers: set[str] = set()
    for part in filter(None, text.split(",")):
        first, _, last = part.partition("-")
        numbers |= {str(number) for number in range(int(first), int(last or first) + 1)}
    return numbers


def _sleep() -> Check:
    path = "/dev/cpu_dma_latency"
    good = os.access(path, os.W_OK)
    words = "deep sleep can be prevented" if good else f"{path} is not writable: the CPU may enter deep sleep"
    return Check("CPU sleep", good, words, "`stagectl service install` (a udev rule), or chgrp the device")


def _disk(folder: Path) -> Check:
    there = _existing(folder)
    free = shutil.disk_usage(there).free
    good = free >= _DISK and os.access(there, os.W_OK)
    words = f"{free / GIB:.1f} GiB free for {folder}"
    return Check("disk", good, words, "free some space, or choose another folder with --state")


def _recordings(p: Retention, folder: Path) -> Check:
    """What there is, and whether what may come has room."""
    files, there = kept(folder), _existing(folder)
    size, free = sum(file.bytes for file in files) / GIB, shutil.disk_usage(there).free / GIB
    age = f", the oldest {(time.time() - files[-1].time) / DAY:.0f} days old" if files else ""
    words = f"{len(files)} file{'s' * (len(files) != 1)}, {size:.1f} GiB{age}; {in_words(p)}"
    if p == Retention():
        return Check("recordings", True, f"{words}: set recordings.keep_days or recordings.keep_gib to change that")
    fits = p.keep_gib <= size + free or p.keep_gib == math.inf
    return Check("recordings", fits, words, f"set recordings.keep_gib below {size + free:.1f}, which is what fits here")


def _existing(folder: Path) -> Path:
    return next(path for path in (folder, *folder.absolute().parents) if path.exists())


def _interface(wire: Canopen) -> Check:
    if wire.interface != "socketcan":
        return Check("bus", True, f"{wire.interface} {wire.channel}: no kernel interface to check")
    up = f"ip link set {wire.channel} up type can bitrate {wire.bitrate:.0f} restart-ms 100"
    ended = subprocess.run(
        ["ip", "-details", "-json", "link", "show", wire.channel], capture_output=True, text=True, check=False
    )
    if ended.returncode != 0:
        return Check("bus", False, f"there is no interface {wire.channel}", f"modprobe can_raw; {up}")
    about = json.loads(ended.stdout)[0]
    data = about.get("linkinfo", {}).get("info_data", {})
    state, rate = data.get("state", "vcan"), data.get("bittiming", {}).get("bitrate", wire.bitrate)
    good = "UP" in about.get("flags", []) and state in ("ERROR-ACTIVE", "vcan") and rate == wire.bitrate
    return Check("bus", good, f"{wire.channel}: {state}, {rate:.0f} bit/s", f"ip link set {wire.channel} down; {up}")


def _load(setup: Setup, wire: Canopen) -> Check:
    share = bus_load(1.0 / setup.dt, wire.bitrate)
    good = share <= wire.bus_load_limit
    words = f"{100 * share:.0f} % from the cycle; at most {100 * wire.bus_load_limit:.0f} %"
    return Check("bus load", good, words, "set a longer control.period")


def _drive(setup: Setup, wire: Canopen, served: bool) -> Iterator[Check]:
    """The stop settings of the drive; read only, and skipped while a service uses the bus."""
    if served:
        yield Check("drive", True, "not checked: a service uses the bus; see `stagectl status`")
        return
    try:
        joined = open_bus(wire.interface, wire.channel, wire.bitrate)
        with contextlib.closing(joined), alone(wire, joined, setup.file.name):
            yield from _read(setup, wire, joined)
    except OtherMasterError as error:
        yield Check("drive", True, f"not checked: {error}")
    except DriveError as error:
        yield Check("drive", False, str(error), "see the line above")


def _read(setup: Setup, wire: Canopen, joined: Bus) -> Iterator[Check]:
    if not virtual_drive.answers(wire):
        words = f"node {wire.node} does not answer"
        if wire.interface == "embedded":
            yield Check("drive", True, f"{words} on the embedded bus: `stagectl run` and `serve` start a virtual one")
        else:
            yield Check("drive", False, words, "switch the drive on; check node id, bit rate and termination")
        return
    access = ObjectAccess(wire, PumpedNode(wire.node, load_eds(wire.eds, wire.node), joined))
    yield from _options(access)
    yield _protection(setup, wire, access)


def _options(drive: ObjectAccess) -> Iterator[Check]:
    for index, (name, _) in cia402.OPTIONS.items():
        try:
            code = drive.offered(index)
        except DriveError as error:
            yield Check(name, False, str(error), "check that the EDS belongs to this drive")
            continue
        words = NOT_OFFERED if code is None else cia402.option(index, code)
        lost = index == cia402.ABORT_CONNECTION and code in (0, None)
        yield Check(name, not lost, words, f"write 3 (quick stop) to 0x{index:04X} and store it in the drive")


def _protection(setup: Setup, wire: Canopen, drive: ObjectAccess) -> Check:
    """What would stop the axis if this computer died."""
    try:
        protection = outlook(wire, drive.offered, axis_limits(setup.file, waits_for_sync(setup)))
    except DriveError as error:
        return Check("protection", False, str(error), "check that the EDS belongs to this drive")
    fix = f"`stagectl drive probe {setup.path}`; see drive.wire.accept in the manual for what may be accepted"
    return Check("protection", protection.good, protection.words, fix)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8").strip()
    except OSError:
        return ""
