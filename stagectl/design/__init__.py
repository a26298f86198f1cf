"""From the stage and the control settings to the law that runs: gains, margins, and what is refused."""

from __future__ import annotations

import contextlib
import math
from typing import NamedTuple

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
from stagectl.design.margins import Margins, Rational, compensator, margins, observed, plant, swings
from stagectl.kernels import feedback, feedforward, law, observer, stage

__all__ = [
    "CascadeControl",
    "Control",
    "Controller",
    "DesignError",
    "Feedback",
    "Layer",
    "Margins",
    "Rational",
    "Settings",
    "cascaded",
    "compensator",
    "design",
    "designed_feedback",
    "gains",
    "margins",
    "observed",
    "observer_bandwidth",
    "plant",
    "running",
    "speed",
    "swings",
    "unjudged",
    "unrest",
    "watched",
]

_SHARES = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1)  # of what is too fast: what is advised instead


class Controller(NamedTuple):
    """What runs: the law period by period, and what is computed from the trajectory beforehand."""

    law: law.Law
    feedforward: feedforward.Feedforward


def design(p: stage.Stage, control: Settings, without: frozenset[str] = frozenset()) -> Controller:
    """The controller for this stage; `without` names layers of ``control.layers`` that are switched off.

    Raises DesignError where the phase margin is below ``control.margin``.
    """
    designed = designed_feedback(p, control)
    reached = margins(p, designed, control.period)
    if not reached.stable or reached.phase < control.margin:
        raise DesignError(_refusal(p, control, reached))
    layers = frozenset(control.layers) - without
    watching = watched(p, control, designed) if "observer" in layers else observer.ABSENT
    anticipation = feedforward.Feedforward(
        feedforward.held(p.mechanics, p.motor.force_constant, control.period),
        p.friction.operators,
        p.motor.force_constant,
        "ptc" in layers,
        "friction" in layers,
    )
    feeding = running(designed, control.period, p.drive.current_limit)
    return Controller(feeding._replace(observer=watching), anticipation)


def watched(p: stage.Stage, control: Settings, designed: Feedback) -> observer.Observer:
    """The disturbance observer that `control` asks for, beside this feedback.

    Raises DesignError where the two together fall below ``control.margin``, or the delay is too long to observe.
    """
    bandwidth, dt = observer_bandwidth(control), control.period
    found = _observing(p, control)
    reached = margins(p, designed, dt, found)
    if reached.stable and reached.phase >= control.margin:
        return found
    alone = math.degrees(margins(p, designed, dt).phase)
    state = f"{math.degrees(reached.phase):.1f} deg" if reached.stable else "none: the sampled loop is unstable"
    raise DesignError(
        f"control.observer_bandwidth = {bandwidth:g} Hz leaves a phase margin of {state} ({alone:.1f} deg without the "
        f"observer); at least {math.degrees(control.margin):g} deg are asked for.  {_calmer(p, control, designed)}"
    )


def unrest(p: stage.Stage, control: Settings) -> str:
    """What is wrong with this control on an axis that friction holds, in words; empty where it comes to rest.

    Raises DesignError where its gains cannot be realised.
    """
    frequency = swings(p, *unjudged(p, control))
    if frequency is None:
        return ""
    return (
        f"when it stands, and friction is a spring, the loop swings by itself at {frequency:.3g} Hz, about as wide as "
        f"the friction's shortest slip: {_quieter(p, control)} or a shorter period"
    )


def _quieter(p: stage.Stage, control: Settings) -> str:
    name, _, unit = speed(control)
    for share in _SHARES:
        lower = slower(control, share)
        with contextlib.suppress(DesignError):
            if swings(p, *unjudged(p, lower)) is None:
                return f"take {name} = {speed(lower)[1]:.3g} {unit}"
    return "take less delay"


def unjudged(p: stage.Stage, control: Settings) -> tuple[Feedback, float, observer.Observer]:
    """Feedback, period (s) and observer of a control, whatever its margin.

    Raises DesignError where they cannot be realised.
    """
    designed = designed_feedback(p, control)
    return designed, control.period, _observing(p, control) if "observer" in control.layers else observer.ABSENT


def _observing(p: stage.Stage, control: Settings) -> observer.Observer:
    try:
        return observer.designed(p, control.period, observer_bandwidth(control))
    except observer.DelayError as error:
        raise DesignError(f"control.layers holds observer: {error}") from error


def _calmer(p: stage.Stage, control: Settings, designed: Feedback) -> str:
    for share in _SHARES:
        lower = share * observer_bandwidth(control)
        reached = margins(p, designed, control.period, observer.designed(p, control.period, lower))
        if reached.stable and reached.phase >= control.margin:
            return f"Take {lower:.3g} Hz ({math.degrees(reached.phase):.1f} deg), or switch the layer observer off"
    return "Switch the layer observer off, or take a lower bandwidth for the feedback"


def running(designed: Feedback, dt: float, current_limit: float) -> law.Law:
    """The law with this feedback, at the period `dt` (s)."""
    if isinstance(designed, feedback.Gains):
        return law.Law(feedback.discretised(designed, dt), current_limit)
    return law.Law(feedback.ABSENT, current_limit, designed, True)


def _refusal(p: stage.Stage, control: Settings, reached: Margins) -> str:
    margin = f"a phase margin of {math.degrees(reached.phase):.1f} deg" if math.isfinite(reached.phase) else "no margin"
    state = "" if reached.stable else " and the sampled loop is unstable"
    name, value, unit = speed(control)
    return (
        f"control.{name} = {value:g} {unit} leaves {margin}{state}; at least "
        f"{math.degrees(control.margin):g} deg are asked for.  Period {control.period * 1e3:g} ms, nd "
        f"{p.drive.delay_samples}, nm {p.encoder.delay_samples}, current lag {p.drive.current_lag * 1e3:.3g} ms.  "
        f"{_advice(p, control)}"
    )


def _advice(p: stage.Stage, control: Settings) -> str:
    for share in _SHARES:
        lower = slower(control, share)
        try:
            reached = margins(p, designed_feedback(p, lower), control.period)
        except DesignError:
            break
        if reached.stable and reached.phase >= control.margin:
            also = "" if isinstance(control, Control) else f" with position_gain and 1/integral_time x {share:g}"
            value = speed(lower)[1]
            return f"Take {value:.3g} Hz{also} ({math.degrees(reached.phase):.1f} deg) or a shorter period"
    return "Take a shorter period or remove delay: no lower bandwidth helps"
