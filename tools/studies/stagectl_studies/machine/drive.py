"""Encoder, bus and current loop."""

import math
from typing import NamedTuple

from stagectl_studies.machine.jit import compiled
from stagectl_studies.machine.machine import Drive, Encoder


class LoopState(NamedTuple):
    """Current loop: current, its rate (second order only), heat of the fold-back."""

    current: float  # A
    rate: float  # A/s
    heat: float  # A^2 s


@compiled
def encoder_error(e: Encoder, x: float) -> float:
    """Measured minus true position, before noise and rounding, rad."""
    error = 0.0
    if e.eccentricity != 0.0:
        error += e.eccentricity * math.sin(x + e.eccentricity_phase)
        error += e.eccentricity_second * math.sin(2.0 * x + e.eccentricity_second_phase)
    if e.interpolation != 0.0:
        angle = e.periods * x
        error += e.interpolation * math.sin(angle + e.interpolation_phase)
        error += e.interpolation_second * math.sin(2.0 * angle + e.interpolation_second_phase)
    return error


@compiled
def measured(e: Encoder, x: float, noise: float) -> float:
    """Encoder reading, rad; written with 12 decimals as the record holds it."""
    y = x + encoder_error(e, x) + noise
    if e.step > 0.0:
        y = math.floor(y / e.step + 0.5) * e.step
        return math.floor(y * 1e12 + 0.5) * 1e-12
    return y


@compiled
def taken(d: Drive, command: float, noise: float) -> float:
    """Set point of the current loop for a command, A: rounded as the bus carries it, with the drive's offset."""
    if d.quantum > 0.0:
        command = math.floor(command / d.quantum + 0.5) * d.quantum
    return command + d.offset + noise


@compiled
def limited(d: Drive, target: float, v: float, heat: float) -> float:
    """Set point within current limit (folded back with heat) and bus voltage: |R i + Ke v| <= U."""
    if d.limit < 1e8:
        bound = d.limit - (d.limit - d.fold_limit) * min(max(heat / d.fold_heat, 0.0), 1.0)
        target = min(max(target, -bound), bound)
    if d.voltage < 1e8:
        high = (d.voltage - d.back_emf * v) / d.resistance
        low = (-d.voltage - d.back_emf * v) / d.resistance
        target = min(max(target, low), high)
    return target


@compiled
def current_step(d: Drive, s: LoopState, target: float, h: float) -> LoopState:
    """Current after `h` seconds of a constant set point, exactly."""
    heat = s.heat
    if d.limit < 1e8:
        heat = max(heat + (s.current * s.current - d.fold_limit * d.fold_limit) * h, 0.0)
    gap = s.current - target
    if d.loop_damping <= 0.0:
        if d.lag <= 0.0:
            return LoopState(target, 0.0, heat)
        return LoopState(target + gap * math.exp(-h / d.lag), 0.0, heat)
    w, zeta = d.loop_frequency, d.loop_damping
    wd = w * math.sqrt(1.0 - zeta * zeta)
    decay, c, sn = math.exp(-zeta * w * h), math.cos(wd * h), math.sin(wd * h)
    lead = (s.rate + zeta * w * gap) / wd
    after = decay * (gap * c + lead * sn)
    rate = decay * (s.rate * c - (zeta * w * s.rate + w * w * gap) / wd * sn)
    return LoopState(target + after, rate, heat)


@compiled
def reported(d: Drive, current: float, noise: float) -> float:
    """Current as the drive reports it, A."""
    y = current * d.reported_gain + d.reported_offset + noise
    if d.reported_quantum > 0.0:
        y = math.floor(y / d.reported_quantum + 0.5) * d.reported_quantum
    return y
