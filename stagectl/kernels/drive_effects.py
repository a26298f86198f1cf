"""Effects of a drive apart from its current loop: dead time, limits of heat and voltage, and the reported current."""

from __future__ import annotations

import math

from stagectl.kernels.constants import FOLDBACK_BEGINS
from stagectl.kernels.jit import kernel
from stagectl.kernels.plant import Drive, Line


@kernel
def neutral(p: Drive) -> bool:
    """Whether nothing here acts on the motor current."""
    return (
        p.dead_time == 0.0
        and p.jitter == 0.0
        and p.offset == 0.0
        and p.gain == 0.0
        and p.gain_asymmetry == 0.0
        and p.directed_offset == 0.0
        and p.continuous_current == math.inf
        and p.voltage_limit == math.inf
    )


@kernel
def acting(delay: tuple[int, float], commands: Line, begun: Line, now: float, since: float) -> tuple[float, float]:
    """Command (A) that acts at `now` (s), and when it was begun; `delay` is (nd, dead time in s).

    The command of nd periods ago acts from the dead time after the start of this period on.  A dead time that changes
    never calls an older command back: what acted, begun at `since`, goes on acting.
    """
    samples, dead = delay
    m = 0
    while samples + m < 7 and begun[m] + dead > now and begun[m] > since:
        m += 1
    return commands[samples + m], begun[m]


@kernel
def meant(
    delay: tuple[int, float], commands: Line, begun: Line, span: tuple[float, float], since: float
) -> tuple[float, float]:
    """Mean command (A) over `span` = (from, to) in s, and when the last one began: a switch counts by its share."""
    start, end = span
    before, old = acting(delay, commands, begun, start, since)
    after, new = acting(delay, commands, begun, end, old)
    if new == old:
        return before, old
    share = min(max((end - (new + delay[1])) / (end - start), 0.0), 1.0)
    return before + share * (after - before), new


@kernel
def folded(p: Drive, heat: float) -> float:
    """Largest current (A) at this `heat` (A^2): the peak, and from 80 % of the heat on down to the continuous one.

    The heat that the peak current brings in `foldback_time` is ``current_limit^2 - continuous_current^2``.
    """
    most = p.current_limit * p.current_limit - p.continuous_current * p.continuous_current
    if heat <= FOLDBACK_BEGINS * most or most <= 0.0 or most == math.inf:
        return min(p.current_limit, p.continuous_current) if most <= 0.0 else p.current_limit
    share = min((heat / most - FOLDBACK_BEGINS) / (1.0 - FOLDBACK_BEGINS), 1.0)
    return p.current_limit - share * (p.current_limit - p.continuous_current)


@kernel
def heated(p: Drive, heat: float, current: float, dt: float) -> float:
    """I2t of the drive, ``dheat/dt = (i^2 - I_c^2) / foldback_time``, never below 0 (A^2)."""
    if p.continuous_current == math.inf:
        return 0.0
    more = current * current - p.continuous_current * p.continuous_current
    return max(heat + more * dt / p.foldback_time, 0.0)


@kernel
def amplified(p: Drive, command: float) -> float:
    """Current (A) that a `command` (A) calls for: ``(1 + g + a sgn c) c + o sgn c``; the command when neutral."""
    if (p.gain == 0.0 and p.gain_asymmetry == 0.0 and p.directed_offset == 0.0) or command == 0.0:
        return command
    return (
        command * (1.0 + p.gain)
        + abs(command) * p.gain_asymmetry
        + math.copysign(p.directed_offset, p.directed_offset * command)
    )


@kernel
def limited(p: Drive, command: float, limit: float, velocity: float) -> float:
    """Current (A) of a `command` within +-`limit`, plus the offset, within the voltage: ``|R i + K_e v| <= U``."""
    target = amplified(p, command)
    target = min(max(target, -limit), limit) + p.offset
    if p.voltage_limit == math.inf:
        return target
    turning = p.back_emf * velocity
    return min(max(target, (-p.voltage_limit - turning) / p.resistance), (p.voltage_limit - turning) / p.resistance)


@kernel
def reported(drive: Drive, current: float, before: float, dt: float) -> float:
    """Current (A) that the drive reports; `before` is that of a period `dt` ago.

    Between the two it approached its command with the current loop's lag; straight where the drive has none.
    """
    p = drive.telemetry
    if p.late > 0.0:
        current += _still_to_come(min(p.late / dt, 1.0), drive.current_lag / dt) * (before - current)
    if p.gain == 0.0 and p.offset == 0.0:
        return current
    return current * (1.0 + p.gain) + p.offset


@kernel
def _still_to_come(late: float, lag: float) -> float:
    """Share of a period's change that had not come yet `late` before its end, with a `lag`; both in periods."""
    if lag == 0.0:
        return late
    left = math.exp(-1.0 / lag)
    return (math.exp(-(1.0 - late) / lag) - left) / (1.0 - left)
