"""From the stage and the control settings to the law that runs: gains, margins, and the refusal of unsafe loops."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Set
from typing import NamedTuple

from stagectl.design.constants import SHARES
from stagectl.design.control import (
    CascadeControl,
    Control,
    DesignError,
    Feedback,
    Layer,
    Settings,
    cascaded,
    designed_feedback,
    gains,
    observer_bandwidth,
    slower,
    speed,
)
from stagectl.design.margins import (
    Margins,
    Rational,
    compensator,
    limit_cycle_frequency,
    margins,
    plant,
    settles,
    sticking_speed,
    with_observer,
)
from stagectl.kernels import feedback, feedforward, friction_bristle, law, observer, stage, unloading
from stagectl.problem import Problem, ProblemKind


class Controller(NamedTuple):
    """What runs: the law period by period, and what is computed from the trajectory beforehand."""

    law: law.Law
    feedforward: feedforward.Feedforward

    def without(self, layers: Set[str]) -> Controller:
        """The same with these `layers` switched off."""
        ahead = self.feedforward
        ahead = ahead._replace(
            with_ptc=ahead.with_ptc and "ptc" not in layers,
            with_friction=ahead.with_friction and "friction" not in layers,
            with_effects=ahead.with_effects and "effects" not in layers,
        )
        watching = observer.ABSENT if "observer" in layers else self.law.observer
        return Controller(self.law._replace(observer=watching), ahead)


def design(p: stage.Stage, control: Settings) -> Controller:
    """The controller for this stage, with the layers of ``control.layers``.

    Raises DesignError where the phase margin is below ``control.margin``.
    """
    designed = designed_feedback(p, control)
    reached = margins(p, designed, control.period)
    if not _accepted(reached, control):
        raise _refusal(p, control, reached)
    layers = control.layers
    watching = designed_observer(p, control, designed) if "observer" in layers else observer.ABSENT
    anticipation = feedforward.Feedforward(
        feedforward.held(p.mechanics, p.motor.force_constant, control.period),
        p.friction.operators,
        p.motor.force_constant,
        "ptc" in layers,
        "friction" in layers,
        control.friction_scale,
        "effects" in layers,
    )
    running = law_of(designed, control.period, p.drive.current_limit)
    band = control.standstill_band * p.encoder.step
    friction = stage.scaled_friction(p.friction, control.friction_scale)
    held = _unloading(p._replace(friction=friction), control.period)
    return Controller(running._replace(observer=watching, standstill_band=band, unloading=held), anticipation)


def _unloading(p: stage.Stage, dt: float) -> unloading.Unloading:
    """How the feedback gives up what it took at rest."""
    constant, bristle = p.motor.force_constant, p.friction.bristle
    springs = stage.stiffness(p.friction._replace(bristle=friction_bristle.NEUTRAL)) / constant
    sliding, creeps = 2.0 * stage.sliding(p.friction) / constant, bristle.coulomb / constant
    along = dt * springs * (sliding / (sliding - 2.0 * creeps)) if springs > 0.0 else 0.0
    bending = 2.0 * dt * bristle.stiffness / constant
    if bristle.coulomb == 0.0:
        bending, creeps = along, 0.5 * sliding
    return unloading.Unloading(dt * springs, along, sliding, bending, creeps, bristle.exponent, springs, p.encoder.step)


def designed_observer(p: stage.Stage, control: Settings, designed: Feedback) -> observer.Observer:
    """The disturbance observer that `control` demands, together with this feedback.

    Raises DesignError where the two together fall below ``control.margin``, or the delay is too long to observe.
    """
    bandwidth, dt = observer_bandwidth(control), control.period
    watching = _observer(p, control)
    reached = margins(p, designed, dt, watching)
    if _accepted(reached, control):
        return watching
    alone = math.degrees(margins(p, designed, dt).phase)
    reason = f"{_reached(reached, control)}; without the observer it is {alone:.1f} deg"
    problem = Problem(reason, ProblemKind.LOOP, "control.observer_bandwidth", f"{bandwidth:g} Hz", "Hz")
    slower_one = _slower_observer(p, control, designed)
    remedy, advised = "switch the layer observer off, or take a lower bandwidth for the feedback", None
    if slower_one is not None:
        phase, advised = math.degrees(slower_one.phase), slower_one.bandwidth
        remedy = f"take {advised:.3g} Hz ({phase:.1f} deg), or switch the layer observer off"
    raise DesignError(problem._replace(remedy=remedy), phase=reached.phase, advised=advised)


def limit_cycle_warning(p: stage.Stage, control: Settings) -> str:
    """A warning where the loop would oscillate on an axis that friction holds; empty where it comes to rest.

    Raises DesignError where its gains cannot be realised.
    """
    frequency = limit_cycle_frequency(p, *loop_parts(p, control))
    if frequency is None:
        return ""
    return (
        f"at standstill, where friction acts as a spring, the loop oscillates at {frequency:.3g} Hz, about as wide as "
        f"the friction's shortest slip: {_calmer(p, control)} or a shorter period, or let `stagectl tune` find the "
        f"fastest loop that comes to rest"
    )


def _calmer(p: stage.Stage, control: Settings) -> str:
    name, _, unit = speed(control)
    for share in SHARES:
        lower = slower(control, share)
        with contextlib.suppress(DesignError):
            if limit_cycle_frequency(p, *loop_parts(p, lower)) is None:
                return f"take {name} = {speed(lower)[1]:.3g} {unit}"
    return "take less delay"


def loop_parts(p: stage.Stage, control: Settings) -> tuple[Feedback, float, observer.Observer]:
    """Feedback, period (s) and observer of a control, whatever its margin.

    Raises DesignError where they cannot be realised.
    """
    designed = designed_feedback(p, control)
    return designed, control.period, _observer(p, control) if "observer" in control.layers else observer.ABSENT


def law_of(designed: Feedback, dt: float, current_limit: float) -> law.Law:
    """The law with this feedback, at the period `dt` (s)."""
    if isinstance(designed, feedback.Gains):
        return law.Law(feedback.discretised(designed, dt), current_limit)
    return law.Law(feedback.ABSENT, current_limit, designed, True)


class _Advice(NamedTuple):
    """A slower loop that is accepted."""

    share: float  # of the refused bandwidth
    bandwidth: float  # Hz
    phase: float  # rad, its margin


def _observer(p: stage.Stage, control: Settings) -> observer.Observer:
    try:
        return observer.designed(p, control.period, observer_bandwidth(control))
    except observer.DelayError as error:
        reason = f"holds observer: {error}"
        raise DesignError(Problem(reason, ProblemKind.LOOP, "control.layers")) from error


def _slower_observer(p: stage.Stage, control: Settings, designed: Feedback) -> _Advice | None:
    for share in SHARES:
        lower = share * observer_bandwidth(control)
        reached = margins(p, designed, control.period, observer.designed(p, control.period, lower))
        if _accepted(reached, control):
            return _Advice(share, lower, reached.phase)
    return None


def _slower_feedback(p: stage.Stage, control: Settings) -> _Advice | None:
    with contextlib.suppress(DesignError):
        for share in SHARES:
            lower = slower(control, share)
            reached = margins(p, designed_feedback(p, lower), control.period)
            if _accepted(reached, control):
                return _Advice(share, speed(lower)[1], reached.phase)
    return None


def _accepted(reached: Margins, control: Settings) -> bool:
    return reached.stable and reached.phase >= control.margin


def _reached(reached: Margins, control: Settings) -> str:
    """The margin that is reached, and the one that is demanded."""
    phase = f"{math.degrees(reached.phase):.1f} deg" if math.isfinite(reached.phase) else "none"
    unstable = "" if reached.stable else ", as the sampled loop is unstable"
    return f"the phase margin is {phase}{unstable}; it must be at least {math.degrees(control.margin):g} deg"


def _refusal(p: stage.Stage, control: Settings, reached: Margins) -> DesignError:
    name, value, unit = speed(control)
    late = f", dead time {p.drive.dead_time * 1e3:.3g} ms" if p.drive.dead_time > 0.0 else ""
    reason = (
        f"{_reached(reached, control)} (period {control.period * 1e3:g} ms, nd {p.drive.delay_samples}, "
        f"nm {p.encoder.delay_samples}, current lag {p.drive.current_lag * 1e3:.3g} ms{late})"
    )
    problem = Problem(reason, ProblemKind.LOOP, f"control.{name}", f"{value:g} {unit}", unit)
    advice = _slower_feedback(p, control)
    if advice is None:
        remedy = "take a shorter period or remove delay, as no lower bandwidth helps"
        return DesignError(problem._replace(remedy=remedy), phase=reached.phase)
    also = "" if isinstance(control, Control) else f" with position_gain and 1/integral_time x {advice.share:g}"
    phase = math.degrees(advice.phase)
    remedy = f"take {advice.bandwidth:.3g} Hz{also} ({phase:.1f} deg) or a shorter period"
    return DesignError(problem._replace(remedy=remedy), phase=reached.phase, advised=advice.bandwidth)
