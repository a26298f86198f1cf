"""Effects of a drive apart from its current loop: dead time, limits of heat and voltage, and the reported current."""

from __future__ import annotations

import math
from typing import NamedTuple

from stagectl.kernels import effects
from stagectl.kernels.constants import EQUAL_POLES, FIRST_ORDER, FOLDBACK_BEGINS
from stagectl.kernels.jit import kernel
from stagectl.kernels.plant import Drive, Line


class Loop(NamedTuple):
    """What a time makes of the current's error (A) and of its rate (A/s) under a constant command, exactly."""

    error: tuple[float, float]  # later error, of error and rate
    rate: tuple[float, float]  # later rate
    mean: tuple[float, float]  # mean error on the way


@kernel
def loop(p: Drive, time: float) -> Loop:
    """The current loop over `time` (s): ``1 / (1 + T s + (T s / 2 zeta)^2)``, whose lag T is that of a first order."""
    none = (0.0, 0.0)
    if p.current_lag == 0.0:
        return Loop(none, none, none)
    if p.current_damping >= FIRST_ORDER:
        decay, mean = effects.decayed(time / p.current_lag)
        return Loop((decay, 0.0), none, (mean, 0.0))
    stiffness = (2.0 * p.current_damping / p.current_lag) ** 2
    damping = 0.5 * stiffness * p.current_lag
    even, odd = _second_order(damping, stiffness, time)
    error, rate = (even + damping * odd, odd), (-stiffness * odd, even - damping * odd)
    over = 1.0 / (stiffness * time)
    by_error = over * (2.0 * damping * (1.0 - error[0]) - rate[0])
    by_rate = over * (1.0 - rate[1] - 2.0 * damping * odd)
    return Loop(error, rate, (by_error, by_rate))


@kernel
def _second_order(damping: float, stiffness: float, time: float) -> tuple[float, float]:
    """``exp(-a t) (cos w t, sin w t / w)`` of ``x'' + 2 a x' + k x = 0``, with w^2 = k - a^2 of either sign."""
    square = stiffness - damping * damping
    turn = math.sqrt(abs(square))
    if turn * time < EQUAL_POLES:
        decay = math.exp(-damping * time)
        return decay, decay * time
    if square > 0.0:
        decay = math.exp(-damping * time)
        return decay * math.cos(turn * time), decay * math.sin(turn * time) / turn
    slow, fast = math.exp((turn - damping) * time), math.exp(-(turn + damping) * time)
    return 0.5 * (slow + fast), 0.5 * (slow - fast) / turn


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
        and p.current_damping >= FIRST_ORDER
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
def called_for(p: Drive, current: float) -> float:
    """The command (A) that calls for a `current` (A): see `amplified`; none calls for less than the directed offset."""
    if current == 0.0:
        return 0.0
    left = max(abs(current) - p.directed_offset, 0.0)
    return math.copysign(left / (1.0 + p.gain + math.copysign(p.gain_asymmetry, p.gain_asymmetry * current)), current)


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
def replaced(drive: Drive, commands: Line, dt: float) -> tuple[float, float]:
    """Command (A) that another one replaced in the last period of `dt` (s), and when in it, in s."""
    whole = int(drive.dead_time / dt)
    return commands[min(drive.delay_samples + whole + 1, 7)], drive.dead_time - whole * dt


@kernel
def reported(drive: Drive, ends: tuple[float, float], asked: tuple[float, float], dt: float) -> float:
    """Current (A) that the drive reports; `ends` are the currents at the begin and the end of the last period `dt` (s).

    In between it went on towards what was `asked` of it = (A, until when in s), from then on towards the next command,
    with the current loop's lag; straight where the drive has none.
    """
    p, lag = drive.telemetry, drive.current_lag
    before, current = ends
    if p.late > 0.0:
        old, at = asked
        left = min(p.late, dt)
        time = dt - left
        passed = min(time, at)
        if passed > 0.0:
            before = old + (before - old) * math.exp(-passed / lag) if lag > 0.0 else old
        if time >= at:
            current += _still_to_come(left / (dt - at), lag / (dt - at)) * (before - current)
        else:
            current = before
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
