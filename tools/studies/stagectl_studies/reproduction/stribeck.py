"""The ball-screw paper's friction over velocity (section III, Fig. 3a), on a stage that has a Stribeck effect.

The paper takes the effect to matter at ultra-low speed only, and stage A is built without it.  Here the same stage has
one; it runs at constant speeds down to ultra-low ones, and the paper's equation is fitted to the mean torques::

    T_fric = {D |w| + T_c + (T_s - T_c) exp(-alpha |w|)} sgn(w)
"""

from typing import NamedTuple

import numpy as np
from scipy import optimize

from stagectl.compensation.legs import Array
from stagectl.identification.constant_speed import SpeedSpan, constant_spans
from stagectl.kernels.friction import Stribeck
from stagectl.trajectories import Sequence, Trapezoid
from stagectl_studies.reproduction import chosen
from stagectl_studies.reproduction.bench import Bench, captured, carried_out


class StribeckCurve(NamedTuple):
    """The paper's equation."""

    viscous: float  # D, N m s/rad
    coulomb: float  # T_c, N m
    static: float  # T_s, N m
    decay: float  # alpha, s/rad


class StribeckExamination(NamedTuple):
    """Mean torques at constant speeds, and the equation fitted to them."""

    spans: list[SpeedSpan]
    fitted: StribeckCurve
    truth: StribeckCurve


def examined(bench: Bench) -> StribeckExamination:
    """The stage of `bench` with a Stribeck effect, at the speeds of `chosen.STRIBECK_SPEEDS`."""
    stage = bench.machine.stage
    effect = Stribeck(chosen.STRIBECK_RISE, chosen.STRIBECK_VELOCITY)
    machine = bench.machine._replace(stage=stage._replace(friction=stage.friction._replace(stribeck=effect)))
    run = carried_out(bench._replace(machine=machine), _motion(), "constant speeds")
    spans = [span for capture in captured(run) for span in constant_spans(capture, bench.believed.file)]
    coulomb = float(sum(stage.friction.operators.weight))
    static = coulomb * (1.0 + chosen.STRIBECK_RISE)
    truth = StribeckCurve(stage.mechanics.viscous, coulomb, static, 1.0 / chosen.STRIBECK_VELOCITY)
    return StribeckExamination(spans, _fitted(spans), truth)


def torque(p: StribeckCurve, speed: Array) -> Array:
    """Friction (n,) N m at speeds (n,) rad/s."""
    size = np.abs(speed)
    rise = (p.static - p.coulomb) * np.exp(-p.decay * size)
    return np.asarray(np.sign(speed) * (p.viscous * size + p.coulomb + rise), dtype=np.float64)


def _motion() -> Sequence:
    """There and back at each speed (mm/s), slowest first."""
    moves = []
    for speed in chosen.STRIBECK_SPEEDS:
        distance = min(1e-3 * speed * chosen.STRIBECK_SPAN, chosen.STRIBECK_STROKE)
        moves.append(Trapezoid(distance, 1e-3 * speed, chosen.STRIBECK_RAMP, chosen.STRIBECK_REST))
    return Sequence(tuple(moves))


def _fitted(spans: list[SpeedSpan]) -> StribeckCurve:
    speed = np.array([span.speed for span in spans])
    force = np.array([span.force for span in spans])
    guess = (force[-2] / speed[-2], float(np.min(np.abs(force))), float(np.abs(force[0])), 1.0)
    values, _ = optimize.curve_fit(lambda w, *p: torque(StribeckCurve(*p), w), speed, force, guess)
    return StribeckCurve(*map(float, values))
