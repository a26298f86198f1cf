"""Controller, drive and mechanics in one loop."""

import math
from typing import NamedTuple

import numpy as np

from stagectl_studies.machine.contact import LOAD, MEMORY, contact
from stagectl_studies.machine.controller import Loop, Rows, pid, saturated
from stagectl_studies.machine.drive import LoopState, current_step, limited, measured, reported, taken
from stagectl_studies.machine.jit import compiled
from stagectl_studies.machine.machine import MAXWELL, Floats, Machine, Motion
from stagectl_studies.machine.motion import derivative, midpoint
from stagectl_studies.machine.standstill import NOTHING, given_up, left_alone, remembered

SUBSTEPS = 20  # per control period of 0.5 ms: 40 kHz
LARGEST_ERROR = 3.0  # rad; beyond it the run is lost


class Noise(NamedTuple):
    """What differs between repeats, one value a row, all (n,)."""

    encoder: Floats  # rad
    current: Floats  # A, flows
    sensor: Floats  # A, only in the record
    late: Floats  # s of bus jitter


class Setting(NamedTuple):
    """Where a run begins and how finely it is integrated."""

    substeps: int = SUBSTEPS
    start: float = 0.0  # s, session clock of the first row
    remanent: Floats = np.zeros(MEMORY)  # contact at rest
    fine: bool = False  # keep the motion of each step


class Trace(NamedTuple):
    """A run: rows, all (n,), and the motion at each step where it was asked for: x, v, acceleration, current."""

    position: Floats  # rad, as measured
    command: Floats  # A, as computed, before the controller's limit
    current: Floats  # A, as reported
    true_position: Floats  # rad
    true_speed: Floats  # rad/s
    fine: Floats  # (n substeps, 4) or (0, 4)
    lost: bool


def arrivals(machine: Machine, noise: Noise, period: float, substeps: int) -> Floats:
    """Step at which each row's command acts; never before the one before it, and on a grid of 1/20 of a period."""
    late = np.floor((machine.drive.delay + noise.late) / (period / 20.0) + 0.5) / 20.0
    return np.floor(np.maximum.accumulate(np.arange(late.size) + late) * substeps + 0.5)


def simulated(p: Machine, loop: Loop, rows: Rows, noise: Noise, setting: Setting) -> Trace:
    """Closed loop from rest at the first reference sample.

    Row k: the encoder is read, the command is computed and sent; it acts `delay` later; the current of the same
    instant is reported (or a shifted one, for a record that is out of step).
    """
    n, m = rows.target.size, setting.substeps
    position, command, current, x, v = np.zeros((5, n))
    out = Trace(position, command, current, x, v, np.zeros((n * m if setting.fine else 0, 4)), False)
    work = Work(setting.remanent.copy(), np.zeros(MEMORY), np.zeros(n), arrivals(p, noise, loop.period, m))
    lost = run_loop(p, loop, rows, noise, work, (out, m, setting.start))
    return out._replace(lost=bool(lost))


class Work(NamedTuple):
    """Arrays the loop works in: contact's memory and its scratch, commands sent, steps at which they act."""

    memory: Floats
    scratch: Floats
    sent: Floats
    arrival: Floats


@compiled
def run_loop(p: Machine, loop: Loop, rows: Rows, noise: Noise, work: Work, into: tuple[Trace, int, float]) -> bool:
    """Fill the trace `into` = (trace, steps per row, session clock); returns whether the axis was lost."""
    out, m, begin = into
    n, h = rows.target.size, loop.period / m
    fine = out.fine.shape[0] > 0
    shift = math.floor(p.drive.reported_shift / h + 0.5)
    x0 = rows.reference[0]
    motion = Motion(x0, 0.0, x0, 0.0, x0, 0.0, 0.0, 0.0, 0.0, 0.0)
    friction = contact(p, work.memory, work.memory, (motion, motion, 0.0), 0.0, begin)
    electric = LoopState(0.0, 0.0, 0.0)
    state, held = (0.0, 0.0, 0.0), NOTHING
    target, acting, logged = 0.0, 0, 0
    for k in range(n):
        out.position[k] = measured(p.encoder, motion.x, noise.encoder[k])
        out.true_position[k], out.true_speed[k] = motion.x, motion.v
        error = rows.target[k] - out.position[k]
        change, held = given_up(loop.rest, held, rows.speed[k], rows.friction[k])
        seen = left_alone(loop.rest, error, rows.speed[k])
        before = state[0] + change
        feedback, state = pid(loop, seen, (before, state[1], state[2]))
        held = remembered(loop.rest, held, rows.speed[k], error, loop.kp * seen + state[0])
        out.command[k] = feedback + rows.feedforward[k] + rows.injection[k]
        given, integrator = saturated(loop, out.command[k], seen, state[0], before)
        state = (integrator, state[1], state[2])
        work.sent[k] = taken(p.drive, given, noise.current[k])
        if not abs(error) < LARGEST_ERROR:
            return True
        for s in range(m):
            step = k * m + s
            while acting <= k and work.arrival[acting] <= step:
                target = work.sent[acting]
                acting += 1
            while logged < n and logged * m + shift <= step:
                out.current[logged] = reported(p.drive, electric.current, noise.sensor[logged])
                logged += 1
            bounded = limited(p.drive, target, motion.v, electric.heat)
            middle = current_step(p.drive, electric, bounded, 0.5 * h)
            after = current_step(p.drive, middle, bounded, 0.5 * h)
            if fine:
                out.fine[step, 0], out.fine[step, 1], out.fine[step, 3] = motion.x, motion.v, electric.current
                out.fine[step, 2] = derivative(p, motion, electric.current, friction).v
            currents = (electric.current, middle.current, after.current)
            memory = (work.memory, work.scratch)
            motion, friction = midpoint(p, motion, memory, friction, currents, (begin + step * h, h))
            electric = after
    while logged < n:
        out.current[logged] = reported(p.drive, electric.current, noise.sensor[logged])
        logged += 1
    return False


def noise_of(machine: Machine, n: int, random: np.random.Generator) -> Noise:
    """Noise of one capture; jitter is gamma distributed, as bus delays are."""
    d, e = machine.drive, machine.encoder
    late = random.gamma(2.0, d.jitter / 2.0, n) if d.jitter > 0.0 else np.zeros(n)
    encoder, current, sensor = random.standard_normal((3, n))
    return Noise(encoder * e.noise, current * d.noise, sensor * d.sensor_noise, late)


def silent(n: int) -> Noise:
    """No noise."""
    return Noise(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n))


def ideal(machine: Machine) -> Machine:
    """The machine without noise and without rounding by encoder and current sensor; the bus rounds as it does."""
    return machine._replace(
        encoder=machine.encoder._replace(step=0.0, noise=0.0),
        drive=machine.drive._replace(noise=0.0, sensor_noise=0.0, reported_quantum=0.0),
    )


def remanent(machine: Machine, sign: float) -> Floats:
    """Contact at rest without torque after a move in direction `sign`: each element as the unloading left it."""
    out = np.zeros(MEMORY)
    law = machine.law
    if law.kind != MAXWELL or sign == 0.0:
        return out
    rate, weights = np.asarray(law.inverse_slip), np.asarray(law.weights)
    low, high = 0.0, 2.0 / float(rate.min())
    for _ in range(60):
        back = 0.5 * (low + high)
        z = np.maximum(1.0 - back * rate, -1.0)
        low, high = (back, high) if float(weights @ z) > 0.0 else (low, back)
    for part in (0, LOAD):
        out[part : part + rate.size] = sign * z
    return out
