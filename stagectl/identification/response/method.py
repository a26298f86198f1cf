"""Frequency response from current to velocity at several amplitudes, and the linear parameters in it.

Friction shows in the response: the smaller the amplitude, the lower the gain and the further ahead the phase, so that a
curve fit takes friction for damping.  Two ways out, of which the one with the narrower interval of D is believed:

* with the axis kept moving friction is constant and falls out;
* sines at several amplitudes tell friction from damping: ``Re(Kt/H) = D + 4 Tc/(pi W)``.

Else the largest amplitude is fitted as it is, and the answer says that its D is too high.

Source: Simultaneous Identification ..., section IV.A.1, Figs 2 and 4.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Capture, IdentificationError
from stagectl.identification.response import fits
from stagectl.identification.response.lines import Curve, curves, threshold
from stagectl.identification.response.sampling import known_delay
from stagectl.identification.result import Found, Parameter
from stagectl.units import ROTARY

LEAST_LINES = 3  # of a fit
BEYOND = 15.0  # mean slips: displacement amplitude from which a line counts as out of presliding
AMPLITUDES = 3  # at one frequency, for a straight line over 4/(pi W)


def identify(
    captures: list[Capture], file: StageFile, progress: Callable[[int, int], None] = lambda done, total: None
) -> Found:
    """Responses of all `captures`, and inertia, viscous friction, Coulomb friction and delay from them.

    Raises IdentificationError where fewer than three lines are sound.
    """
    taken: list[Curve] = []
    notes: list[str] = []
    for k, capture in enumerate(captures):
        found, doubts = curves(capture, file)
        taken += found
        notes += doubts
        progress(k + 1, len(captures) + 1)
    merged = _merged(taken)
    _check(merged)
    done = _fitted(merged, file)
    progress(len(captures) + 1, len(captures) + 1)
    straight = _describing(merged, file.motor.force_constant, _presliding(done))
    delay = known_delay(captures[0], file)
    parameters = _parameters(done, file, delay)
    details = {
        "curves": [_written(one) for one in merged],
        "fits": [_row(name, fit, amplitude) for name, fit, amplitude in done],
        "describing": straight,
        "known_delay": delay,
        "friction_effect": [_effect(one, done[-1][1], file.motor.force_constant) for one in merged],
    }
    told = done[-1][0] != "largest amplitude"  # a damping that holds friction belongs in no stage file
    changes = {f"mechanics.{name}": parameters[name].value for name in ("inertia", "viscous") if told}
    return Found(parameters, None, details, tuple(notes + _doubts(merged, done, captures[0])), changes)


Done = list[tuple[str, fits.Fit, float]]  # what it was fitted to, the fit, amplitude (A)


def _merged(taken: list[Curve]) -> list[Curve]:
    """Curves of the same condition in several captures as one; the largest amplitude last."""
    groups: dict[tuple[str, float, bool], list[Curve]] = {}
    for one in taken:
        groups.setdefault((one.kind, round(one.amplitude, 9), one.moving), []).append(one)
    joined = [joined_curve(group) for group in groups.values()]
    return sorted(joined, key=lambda one: (one.moving, one.amplitude))


def joined_curve(group: list[Curve]) -> Curve:
    """Several curves of one condition, by frequency."""
    order = np.argsort(np.concatenate([one.frequency for one in group]), kind="stable")
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(one, name) for one in group])[order]
        for name in ("frequency", "response", "deviation", "coherence", "velocity", "relay")
    }
    worst = max((one.distortion for one in group if not math.isnan(one.distortion)), default=math.nan)
    return group[0]._replace(
        periods=min([one.periods for one in group if one.periods > 1], default=1), distortion=worst, **columns
    )


def _check(merged: list[Curve]) -> None:
    sound = sum(int(np.sum(one.sound)) for one in merged)
    if sound < LEAST_LINES:
        total = sum(len(one.frequency) for one in merged)
        raise IdentificationError(
            f"{sound} of {total} lines are sound; must be at least {LEAST_LINES}, over a range of frequencies: excite "
            "more of them, with more periods (coherence) and a larger amplitude"
        )


def _fitted(merged: list[Curve], file: StageFile) -> Done:
    """All fits that the curves allow, the one that is believed last."""
    constant = file.motor.force_constant
    still = [one for one in merged if not one.moving and np.sum(one.sound) >= LEAST_LINES]
    done: Done = []
    if still:
        largest = still[-1]
        p = fits.lines([largest], constant)
        for fit in (fits.gain_curve(p), fits.linear(p), fits.linear(p, fits.PAPER_LAG), fits.with_delay(p, "delay")):
            done.append(("largest amplitude", fit, largest.amplitude))
    free: Done = []
    sines = [one for one in merged if not one.moving and one.kind == "sine"]
    if sines and _tells_friction(p := fits.lines(sines, constant)):
        free.append(("all sines", fits.with_friction(p, "friction-corrected"), sines[-1].amplitude))
    moving = [one for one in merged if one.moving]
    if moving and len((p := fits.lines(moving, constant)).frequency) >= LEAST_LINES:
        free.append(("axis kept moving", fits.with_delay(p, "delay"), moving[-1].amplitude))
    done += sorted(free, key=lambda one: -one[1].covariance[1, 1])
    if not done:
        raise IdentificationError(
            f"no condition has {LEAST_LINES} sound lines: record more frequencies at one amplitude"
        )
    return done


def _tells_friction(p: fits.Lines) -> bool:
    """Sines at two frequencies, and enough of them for inertia, damping, friction and delay."""
    return len(p.frequency) >= 4 and float(np.ptp(p.frequency)) > 0.01 * float(np.max(p.frequency))


def _presliding(done: Done) -> float:
    """Displacement amplitude below which the friction's slips show in Re(Kt/H); 0 where they are not known."""
    for _, fit, _ in done:
        if len(fit.slip) and fit.coulomb > 0.0:
            return BEYOND * float(fit.values[2:] @ fit.slip) / fit.coulomb
    return 0.0


def _describing(merged: list[Curve], constant: float, presliding: float) -> list[dict[str, Any]]:
    """D and Tc from each frequency with enough amplitudes: a straight line of Re(Kt/H) over 4/(pi W)."""
    sines = [one for one in merged if not one.moving and one.kind == "sine" and np.any(one.sound)]
    if not sines:
        return []
    p = fits.lines(sines, constant)
    frequency = np.round(p.frequency, 6)
    found = []
    for f in np.unique(frequency[np.isfinite(frequency)]).tolist():
        here = frequency == f
        if np.sum(here) < AMPLITUDES:
            continue
        over, effort = p.relay.real[here] / p.velocity[here], p.effort.real[here]
        columns = np.column_stack([np.ones(len(over)), over]) / effort[:, None]
        (viscous, coulomb), *_ = np.linalg.lstsq(columns, np.ones(len(over)), rcond=None)
        found.append(
            {
                "frequency": f,
                "presliding": bool(np.min(p.velocity[here]) < presliding * 2.0 * math.pi * f),
                "viscous": float(viscous),
                "coulomb": float(coulomb),
                "relay_over_velocity": over.tolist(),
                "velocity": p.velocity[here].tolist(),
                "effort": effort.tolist(),
            }
        )
    return found


def _parameters(done: Done, file: StageFile, known: float) -> dict[str, Parameter]:
    rotary = file.axis.kind == ROTARY
    best = done[-1][1]
    unit = np.eye(len(best.values) + 1)
    delay = best.interval(unit[-1], "s")
    found = {
        "inertia": best.interval(unit[0], "kg m^2" if rotary else "kg"),
        "viscous": best.interval(unit[1], "N m s/rad" if rotary else "N s/m"),
        "delay": Parameter(delay.value + known, delay.low + known, delay.high + known, "s"),
    }
    for _, fit, _ in done:
        if len(fit.slip):
            weights = np.append(np.append(np.zeros(2), np.ones(len(fit.slip))), 0.0)
            found["coulomb"] = fit.interval(weights, "N m" if rotary else "N")
    return found


def _row(of: str, fit: fits.Fit, amplitude: float) -> dict[str, Any]:
    return {
        "of": of,
        "name": fit.name,
        "amplitude": amplitude,
        "inertia": float(fit.values[0]),
        "viscous": float(fit.values[1]),
        "coulomb": None if math.isnan(fit.coulomb) else fit.coulomb,
        "delay": fit.delay,
        "residual": fit.residual,
    }


def _effect(one: Curve, fit: fits.Fit, constant: float) -> dict[str, Any]:
    """What friction does to each sound line: gain (dB) and phase (deg) over those of the linear model."""
    s = 2j * np.pi * one.frequency[one.sound]
    ratio = one.response[one.sound] * np.exp(s * fit.delay) * (fit.values[0] * s + fit.values[1]) / constant
    return {
        "kind": one.kind,
        "amplitude": one.amplitude,
        "moving": one.moving,
        "frequency": one.frequency[one.sound].tolist(),
        "gain_db": (20.0 * np.log10(np.abs(ratio))).tolist(),
        "phase_deg": np.degrees(np.angle(ratio)).tolist(),
    }


def _written(one: Curve) -> dict[str, Any]:
    """A curve as JSON values; NaN becomes null."""
    return {
        "name": one.name,
        "kind": one.kind,
        "amplitude": one.amplitude,
        "moving": one.moving,
        "periods": one.periods,
        "distortion": None if math.isnan(one.distortion) else one.distortion,
        "frequency": one.frequency.tolist(),
        "gain": np.abs(one.response).tolist(),
        "phase": np.unwrap(np.angle(one.response)).tolist(),
        "deviation": [None if math.isnan(x) else x for x in one.deviation.tolist()],
        "coherence": [None if math.isnan(x) else x for x in one.coherence.tolist()],
        "velocity": one.velocity.tolist(),
        "sound": one.sound.tolist(),
    }


def _doubts(merged: list[Curve], done: Done, capture: Capture) -> list[str]:
    notes = [
        "the force constant is taken from the stage file: inertia and friction scale with it",
        f"the delay counts from the {capture.current_column} column to the position column",
    ]
    for one in merged:
        where = f"{one.kind} of {one.amplitude:.3g} A{', axis moving' if one.moving else ''}"
        poor = one.frequency[~one.sound]
        if len(poor):
            notes.append(
                f"{where}: coherence below {threshold(one.periods):.2f} at {len(poor)} of {len(one.frequency)} lines "
                f"({poor[0]:.3g} to {poor[-1]:.3g} Hz); they are shown, not fitted"
            )
        if alone := int(np.sum(np.isnan(one.coherence))):
            notes.append(
                f"{where}: nothing to average at {alone} of {len(one.frequency)} lines, so coherence and variance are "
                "not known there; record more periods"
            )
        if one.kind == "multisine" and not math.isnan(one.distortion):
            notes.append(
                f"{where}: even lines, which an odd multisine does not excite, carry {100.0 * one.distortion:.2g} % of "
                "the excited ones: even distortion and noise (odd distortion, as of friction, is not in them)"
            )
    if done[-1][0] == "largest amplitude":
        notes.append(
            "friction is in this response: viscous is too high and inertia wrong, by more than their intervals, and "
            "nothing of them is written to a stage file. Record sines at three amplitudes, "
            "or keep the axis moving while the current is injected (type: excited)"
        )
    return notes
