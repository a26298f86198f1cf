"""The steps of an acceptance, each with what it found.

Without power: who the drive is, and what protects the axis when its controller is lost.  Under power: polarity, current
limit, and that the axis stands whatever becomes of its controller.
"""

import math
from typing import Any

import numpy as np

from stagectl.drives.bus.frames import MASTER
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.network import check_profile
from stagectl.drives.canopen.presets import for_vendor
from stagectl.drives.canopen.probe import against_eds
from stagectl.drives.canopen.probe import identity as reported_identity
from stagectl.drives.drive import Fault
from stagectl.service.virtual_timeouts import waits_for_sync
from stagectl.workflows.acceptance import limits
from stagectl.workflows.acceptance.drive_reader import lost_controller_bound, quick_stop_bound, read_protection
from stagectl.workflows.acceptance.traces import CURRENT, FLOWING, Mark
from stagectl.workflows.acceptance.trial import Push, Seen, connected, ramp
from stagectl.workflows.acceptance.workbench import Found, StepError, Workbench, passed

_LIMITS = (Fault.TRAVEL, Fault.BRAKING)


def polarity(bench: Workbench) -> Found:
    """Positive current moves towards positive positions, negative towards negative; the drive measures its sign."""
    facts: dict[str, Any] = {}
    for direction in (1, -1):
        seen, moved = _nudged(bench, direction)
        facts["positive" if direction > 0 else "negative"] = {"current": seen.current, "moved": bench.table(moved)}
        if moved * direction < 0.0:
            raise StepError(
                f"{seen.current:+.3g} A moved the axis by {bench.words(moved)}: the polarity is reversed. Change it in"
                " ONE place: the drive's polarity object, or two motor phases",
                facts, bench.table(abs(moved)), bench.table(bench.narrow),
            )  # fmt: skip
        if seen.flowing * direction < 0.0:
            raise StepError(
                f"{seen.current:+.3g} A flows as {seen.flowing:+.3g} A by the drive's own measurement", facts
            )
        bench.moving_current = max(bench.moving_current, abs(seen.current))
    return passed(f"the axis moves the right way both ways, from {bench.moving_current:.3g} A on", **facts)


def current_limit(bench: Workbench) -> Found:
    """More current than a limit is asked for: law and drive keep to the limit, and the drive gives it."""
    limit, dt = bench.moving_current, bench.setup.dt
    here = bench.ready()
    asked, periods = limits.CLIP_FACTOR * limit, round(limits.CLIP_TIME / dt)
    rise, held = ramp(asked, limits.CLIP_TIME, dt)[:periods], np.full(max(2, periods), asked)
    push = Push(np.concatenate([rise, held, np.zeros(2)]), limit, here - bench.window, here + bench.window)
    with bench.pushed(push, here, Mark(limit=limit)) as trial:
        trial.until(lambda now: False, 2.0 * limits.CLIP_TIME)
        rows = trial.rows(len(push.currents))
        ended = trial.end()
    commanded, flowing = float(np.max(np.abs(rows[:, CURRENT]))), rows[:, FLOWING]
    if np.isnan(flowing).any():
        raise StepError("the drive reports no measured current (drive.wire.current_object): its limit cannot be tried")
    largest, usual = float(np.max(np.abs(flowing))), float(np.median(np.abs(flowing[len(flowing) // 2 : -2])))
    facts = {"asked": asked, "limit": limit, "commanded": commanded, "largest": largest, "usual": usual}
    slack = limits.COUNTS * bench.wire.current_scale
    if commanded > limit or largest > limits.OVERSHOOT * limit + slack or usual < limits.DELIVERED * limit - slack:
        raise StepError(
            f"with a limit of {limit:.3g} A, {commanded:.3g} A were commanded, {largest:.3g} A flowed at most, and"
            f" {usual:.3g} A usually; {ended.words}".rstrip("; "), facts
        )  # fmt: skip
    return passed(f"{asked:.3g} A asked for, limit {limit:.3g} A, at most {largest:.3g} A flowed", **facts)


def killed(bench: Workbench) -> Found:
    """Kill -9 of the real-time process in motion: the drive stops the axis by itself."""
    with bench.creeping(1, bench.window) as (trial, _):
        seen = bench.at_speed(trial, 1)
        trial.kill()
        return _lost(bench, trial.seen() or seen, "kill -9")  # seen in the last period that it lived


def silent(bench: Workbench) -> Found:
    """The process stays and sends nothing (SIGSTOP): no SYNC, no command, no heartbeat."""
    with bench.creeping(-1, bench.window) as (trial, _):
        seen = bench.at_speed(trial, -1)
        trial.freeze()
        try:
            return _lost(bench, trial.seen() or seen, "the last message")
        finally:
            trial.kill()  # it must not wake up and go on


def quick_stop(bench: Workbench) -> Found:
    """The stop that the loop asks of the drive."""
    with bench.creeping(1, bench.window) as (trial, _):
        seen = bench.at_speed(trial, 1)
        bench.left("the order to stop", seen)
        ended = trial.stop()
        last = trial.seen() or seen
    bound = quick_stop_bound(bench.setup, last.speed, last.current)
    if ended.fault is not Fault.NONE:
        raise StepError(f"the quick stop ended as a fault: {ended.words}", {"fault": ended.fault.name})
    return bench.judged(ended.stop_distance, bound, speed=bench.table(last.speed))


def travel_limits(bench: Workbench) -> Found:
    """The loop stops the axis at limits of the travel that are set next to it, at both ends."""
    farthest, bound = 0.0, math.inf
    facts: dict[str, Any] = {}
    for direction in (1, -1):
        with bench.creeping(direction, bench.narrow) as (trial, here):
            bench.mark = Mark("high" if direction > 0 else "low", origin=here + direction * bench.narrow)
            trial.until(lambda now: False, limits.RAMP_TIME)
            last, ended = trial.seen(), trial.end()
        if ended.fault not in _LIMITS or last is None:
            raise StepError(f"the loop did not stop the axis at its limit: {ended.words or 'no fault'}", facts)
        with bench.reading() as drive:
            beyond = max(0.0, direction * (drive.position() - here) - bench.narrow)
        farthest, bound = max(farthest, beyond), min(bound, quick_stop_bound(bench.setup, last.speed, last.current))
        facts["high" if direction > 0 else "low"] = {"beyond": bench.table(beyond), "fault": ended.fault.name}
    return bench.judged(farthest, bound, **facts)


def _lost(bench: Workbench, seen: Seen, event: str) -> Found:
    """The stop of an axis whose controller an `event` has lost, against its bound; which of them proves nothing.

    The bound is never more than the room that a person keeps free.
    """
    bench.left(event, seen)
    bound = min(lost_controller_bound(bench.setup, bench.protection, seen.speed, seen.current), bench.window)
    stop = bench.stopped(seen, bench.protection.timeout, bound)
    facts = {"time": stop.time, "speed": bench.table(seen.speed), "state": stop.state.words}
    found = bench.judged(stop.distance, bound, **facts)
    nothing = "; this proves nothing: the time of this virtual drive stands still while the bus is silent"
    return found._replace(words=found.words + nothing) if waits_for_sync(bench.setup) else found


def _nudged(bench: Workbench, direction: int) -> tuple[Seen, float]:
    """The axis as it begins to move, either way, and by how much (rad | m); it is stopped at once."""
    least = limits.POLARITY_COUNTS * bench.step
    with bench.creeping(direction, max(bench.narrow, 4.0 * least)) as (trial, here):
        bench.mark = Mark("positive" if direction > 0 else "negative", least=direction * least)
        seen = trial.until(lambda now: abs(now.position - here) >= least, limits.RAMP_TIME)
        if seen is None:
            ended = trial.end()
            reason = ended.words or f"{direction * bench.current:+.3g} A do not move the axis"
            raise StepError(f"{reason}; is a brake closed, or the axis blocked? A larger --current may move it")
        trial.stop()
    return seen, seen.position - here


_STOPPING = (1, 2, 3)  # options of 0x6007: fault, power off, quick stop
_MILLI = 1e-3


def identity(bench: Workbench) -> Found:
    """The drive is the one that EDS and stage file are for.  Nothing is written."""
    with bench.reading(beside_a_loop=False) as drive:
        check_profile(drive.number(cia402.DEVICE_TYPE) or 0, bench.wire.node)
        bench.drive = {name: shown for name, shown in reported_identity(drive.read, cia402.TEXTS).items() if shown}
        preset = for_vendor(drive.number(cia402.IDENTITY, 1))
        doubts = against_eds(bench.wire, drive.read, preset)
        rated = drive.number(cia402.RATED_CURRENT)
        bench.start = drive.position()
    stated = bench.wire.rated_current
    if rated is not None and round(stated / _MILLI) != rated:
        doubts.append(f"rated_current = {stated:g} A, but the drive reports {rated * _MILLI:g} A (0x6075)")
    if doubts:
        raise StepError("; ".join(doubts), bench.drive)
    known = ", ".join(f"{name} {value}" for name, value in bench.drive.items())
    return passed(known or "the drive reports no identity", **bench.drive)


def protection(bench: Workbench) -> Found:
    """Set up as for a run, without power; then supervisors and reaction are read back on another connection."""
    description = connected(bench.setup)
    with bench.reading(beside_a_loop=False) as drive:
        held = bench.protection = read_protection(drive, MASTER)
    facts: dict[str, Any] = {
        **{name: f"{time:g} s" for name, time in held.supervisors.items()},
        "0x6007": held.reaction,
    }
    facts |= {"set-up": description}
    if not held.supervisors:
        raise StepError(
            "no supervisor is on in the drive (0x1016, 0x1400:05, 0x100C): it does not notice a dead controller", facts
        )
    if held.reaction not in _STOPPING:
        reported = "absent" if held.reaction is None else held.reaction
        raise StepError(f"0x6007 (abort connection) is {reported}; must be 1, 2 or 3: nothing stops the axis", facts)
    watching = ", ".join(f"{name} {time * 1e3:.0f} ms" for name, time in held.supervisors.items())
    return passed(f"{watching}; then: {cia402.option(cia402.ABORT_CONNECTION, held.reaction)}", **facts)
