"""The share of one effect: what is missing where a machine without it is led along the true motion.

torque    J (a_without - a_true) of the motor side, under the true current
current   true current minus that of a drive without the effect, under the true command
reported, position, command   the same for record, encoder and controller
"""

import numpy as np

from stagectl_studies.machine.contact import MEMORY, contact
from stagectl_studies.machine.controller import Loop, Rows, pid
from stagectl_studies.machine.drive import LoopState, current_step, encoder_error, limited, taken
from stagectl_studies.machine.effects import Rig
from stagectl_studies.machine.jit import compiled
from stagectl_studies.machine.machine import Encoder, Floats, Machine, Motion
from stagectl_studies.machine.motion import derivative, shifted, swing
from stagectl_studies.machine.plant import Noise, Setting, Trace, arrivals, silent


@compiled
def imposed(m: Motion, x: float, v: float) -> Motion:
    """Motion with the motor where it is said to be."""
    return Motion(
        x, v, m.load, m.load_speed, m.second, m.second_speed, m.base, m.base_speed, m.base_second, m.base_second_speed
    )


@compiled
def lead(p: Machine, fine: Floats, memory: tuple[Floats, Floats], clock: tuple[float, float], out: Floats) -> None:
    """Missing torque at each row, along the fine motion (x, v, acceleration, current); `clock` (session time, step)."""
    (mem, scratch), (begin, h) = memory, clock
    every = fine.shape[0] // out.size
    x0 = fine[0, 0]
    m = Motion(x0, 0.0, x0, 0.0, x0, 0.0, 0.0, 0.0, 0.0, 0.0)
    friction = contact(p, mem, mem, (m, m, 0.0), 0.0, begin)
    kt = p.motor.force_constant
    for k in range(fine.shape[0] - 1):
        t = begin + k * h
        rate = derivative(p, m, fine[k, 3], friction)
        if k % every == 0:
            out[k // every] = swing(p, m.x)[0] * (rate.v - fine[k, 2])
        x, v, current = fine[k + 1, 0], fine[k + 1, 1], fine[k + 1, 3]
        middle = 0.5 * (fine[k, 3] + current)
        half = imposed(shifted(m, rate, 0.5 * h), 0.5 * (m.x + x) + 0.125 * h * (m.v - v), 0.5 * (m.v + v))
        inner = contact(p, mem, scratch, (m, half, 0.5 * h), kt * middle, t + 0.5 * h)
        end = imposed(shifted(m, derivative(p, half, middle, inner), h), x, v)
        friction = contact(p, mem, mem, (m, end, h), kt * current, t + h)
        m = end


@compiled
def drive_along(p: Machine, rows: tuple[Floats, Floats, Floats], period: float, out: Floats) -> None:
    """Current at each row of a drive under `rows` = (commands, speeds, rows at which they act)."""
    command, speed, arrival = rows
    s = LoopState(0.0, 0.0, 0.0)
    target, acting = 0.0, 0
    for k in range(out.size):
        out[k] = s.current
        for step in range(20):
            while acting <= k and arrival[acting] <= 20 * k + step:
                target = taken(p.drive, command[acting], 0.0)
                acting += 1
            s = current_step(p.drive, s, limited(p.drive, target, speed[k], s.heat), period / 20.0)


@compiled
def encoder_along(e: Encoder, x: Floats, out: Floats) -> None:
    """Encoder error at each row."""
    for k in range(x.size):
        out[k] = encoder_error(e, x[k])


@compiled
def feedback_along(loop: Loop, error: Floats, out: Floats) -> None:
    """Feedback current at each row."""
    state = (0.0, 0.0, 0.0)
    for k in range(error.size):
        out[k], state = pid(loop, error[k], state)


def torque_share(without: Rig, trace: Trace, setting: Setting) -> Floats:
    """Torque of an effect at each row, N m."""
    out = np.zeros(trace.position.size)
    memory = (setting.remanent.copy(), np.zeros(MEMORY))
    lead(without.machine, trace.fine, memory, (setting.start, without.loop.period / setting.substeps), out)
    return out


def current_share(rig: Rig, without: Rig, trace: Trace, noise: Noise) -> Floats:
    """Current of an effect at each row, A."""
    both, calm = np.zeros((2, trace.position.size)), silent(trace.position.size)
    for machine, out in zip((rig, without), both, strict=True):
        late = arrivals(machine.machine, noise if machine.machine.drive.jitter > 0.0 else calm, machine.loop.period, 20)
        drive_along(machine.machine, (trace.command, trace.true_speed, late), machine.loop.period, out)
    return np.asarray(both[0] - both[1])


def reported_share(rig: Rig, without: Rig, trace: Trace, setting: Setting) -> Floats:
    """Reported minus true current, less the same without the effect, A."""
    m, n = setting.substeps, trace.position.size
    h = rig.loop.period / m

    def seen(shown_by: Rig) -> Floats:
        d = shown_by.machine.drive
        at = np.clip(np.arange(n) * m + round(d.reported_shift / h), 0, n * m - 1)
        return np.asarray(trace.fine[at, 3] * d.reported_gain + d.reported_offset + d.offset)

    return np.asarray(seen(rig) - seen(without))


def position_share(rig: Rig, without: Rig, trace: Trace) -> Floats:
    """Encoder error of an effect at each row, rad."""
    both = np.zeros((2, trace.position.size))
    encoder_along(rig.machine.encoder, trace.true_position, both[0])
    encoder_along(without.machine.encoder, trace.true_position, both[1])
    return np.asarray(both[0] - both[1])


def command_share(rig: Rig, without: Rig, trace: Trace, rows: Rows) -> Floats:
    """Current that the deployed controller asks for beyond the documented one, A."""
    both, error = np.zeros((2, trace.position.size)), rows.target - trace.position
    feedback_along(rig.loop, error, both[0])
    feedback_along(without.loop, error, both[1])
    return np.asarray(both[0] - both[1])
