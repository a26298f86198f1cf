"""The method `frf`: frequency response from current to velocity at several amplitudes, and its linear parameters.

Friction shows in the response: the smaller the amplitude, the lower the gain and the further ahead the phase, so that a
curve fit takes friction for damping.  There are two ways out, and the one with the narrower interval of D is taken:

* with the axis kept moving friction is constant and falls out;
* sines at several amplitudes separate friction from damping: ``Re(Kt/H) = D + 4 Tc/(pi W)``.

Otherwise the largest amplitude is fitted as it is, and a note warns that its D is too high.

Source: Simultaneous Identification ..., section IV.A.1, Figs 2 and 4.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Capture, IdentificationError, Refusal, each
from stagectl.identification.response import fits
from stagectl.identification.response.lines import Curve, coherence_threshold, curves
from stagectl.identification.response.sampling_correction import known_delay
from stagectl.identification.result import IdentificationResult, Note, Parameter, Progress, Topic, unit_of
from stagectl.number_format import percent
from stagectl.typed_json import plain

LARGEST = "largest amplitude"


class ConditionFit(NamedTuple):
    """A fit to the lines of some conditions."""

    condition: str
    fit: fits.ResponseFit
    amplitude: float  # A


def identify(
    captures: list[Capture], file: StageFile, progress: Progress = lambda done, total: None
) -> IdentificationResult:
    """Responses of all `captures`, and inertia, viscous friction, Coulomb friction and delay from them.

    Raises IdentificationError where fewer than three lines are sound.
    """
    measured: list[Curve] = []
    notes: list[str] = []
    for of_capture, doubts in each(captures, lambda capture: curves(capture, file), progress, further=1):
        measured += of_capture
        notes += doubts
    merged = _merged(measured)
    _check(merged)
    fitted = _fitted(merged, file)
    progress(len(captures) + 1, len(captures) + 1)
    taken = fitted[-1]
    delay = known_delay(captures[0], file)
    parameters = _parameters(fitted, file, delay)
    details = {
        "curves": [_curve_values(curve) for curve in merged],
        "fits": [_row(entry) for entry in fitted],
        "describing": _describing(merged, file.motor.force_constant, _presliding(fitted)),
        "known_delay": delay,
        "friction_effect": [_friction_effect(curve, taken.fit, file.motor.force_constant) for curve in merged],
    }
    # A damping that includes friction is not written to the stage file.
    names = ("inertia", "viscous") if taken.condition != LARGEST else ()
    changes = {f"mechanics.{name}": parameters[name].value for name in names}
    notes += _doubts(merged, taken, captures[0])
    return IdentificationResult(parameters, None, details, tuple(notes), changes)


def _merged(measured: list[Curve]) -> list[Curve]:
    """Curves of the same condition in several captures as one; the largest amplitude last."""
    groups: dict[tuple[str, float, bool], list[Curve]] = {}
    for curve in measured:
        groups.setdefault((curve.kind, round(curve.amplitude, 9), curve.moving), []).append(curve)
    joined = [joined_curve(group) for group in groups.values()]
    return sorted(joined, key=lambda curve: (curve.moving, curve.amplitude))


def joined_curve(group: list[Curve]) -> Curve:
    """Several curves of curve condition, by frequency."""
    order = np.argsort(np.concatenate([curve.frequency for curve in group]), kind="stable")
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(curve, name) for curve in group])[order]
        for name in ("frequency", "response", "deviation", "coherence", "velocity", "relay")
    }
    worst = max((curve.distortion for curve in group if not math.isnan(curve.distortion)), default=math.nan)
    return group[0]._replace(
        periods=min([curve.periods for curve in group if curve.periods > 1], default=1), distortion=worst, **columns
    )


def _check(merged: list[Curve]) -> None:
    sound = sum(int(np.sum(curve.sound)) for curve in merged)
    if sound < thresholds.LEAST_LINES:
        total = sum(len(curve.frequency) for curve in merged)
        raise IdentificationError(
            f"{sound} of {total} lines are sound; must be at least {thresholds.LEAST_LINES}, over a range of "
            "frequencies: excite more of them, with more periods (coherence) and a larger amplitude",
            Refusal.TOO_FEW_LINES,
            value=sound,
            admissible=f"[{thresholds.LEAST_LINES}, inf)",
        )


def _fitted(merged: list[Curve], file: StageFile) -> list[ConditionFit]:
    """All fits that the curves allow; the last one is taken."""
    constant = file.motor.force_constant
    still = [curve for curve in merged if not curve.moving and np.sum(curve.sound) >= thresholds.LEAST_LINES]
    biased: list[ConditionFit] = []
    if still:
        largest = still[-1]
        p = fits.lines([largest], constant)
        plain = (fits.gain_curve(p), fits.linear(p), fits.linear(p, thresholds.PAPER_LAG), fits.with_delay(p))
        biased = [ConditionFit(LARGEST, fit, largest.amplitude) for fit in plain]
    free: list[ConditionFit] = []
    sines = [curve for curve in merged if not curve.moving and curve.kind == "sine"]
    if sines and _separates_friction(p := fits.lines(sines, constant)):
        free.append(ConditionFit("all sines", fits.with_friction(p), sines[-1].amplitude))
    moving = [curve for curve in merged if curve.moving]
    if moving and len((p := fits.lines(moving, constant)).frequency) >= thresholds.LEAST_LINES:
        free.append(ConditionFit("axis kept moving", fits.with_delay(p), moving[-1].amplitude))
    fitted = biased + sorted(free, key=lambda entry: -entry.fit.covariance[1, 1])
    if not fitted:
        text = f"no condition has {thresholds.LEAST_LINES} sound lines: record more frequencies at one amplitude"
        raise IdentificationError(text, Refusal.TOO_FEW_LINES, admissible=f"[{thresholds.LEAST_LINES}, inf)")
    return fitted


def _separates_friction(p: fits.Lines) -> bool:
    """Whether there are sines at two frequencies, and enough for inertia, damping, friction and delay."""
    return len(p.frequency) >= 4 and float(np.ptp(p.frequency)) > 0.01 * float(np.max(p.frequency))


def _presliding(fitted: list[ConditionFit]) -> float:
    """Displacement amplitude (rad | m) below which the slips show in Re(Kt/H); 0 where they are not known."""
    for _, fit, _ in fitted:
        if len(fit.slip) and fit.coulomb > 0.0:
            return thresholds.BEYOND_PRESLIDING * float(fit.values[2:] @ fit.slip) / fit.coulomb
    return 0.0


def _describing(merged: list[Curve], constant: float, presliding: float) -> list[dict[str, Any]]:
    """D and Tc from each frequency with enough amplitudes: a straight line of Re(Kt/H) over 4/(pi W)."""
    sines = [curve for curve in merged if not curve.moving and curve.kind == "sine" and np.any(curve.sound)]
    if not sines:
        return []
    p = fits.lines(sines, constant)
    frequency = np.round(p.frequency, 6)
    rows = []
    for f in np.unique(frequency[np.isfinite(frequency)]).tolist():
        here = frequency == f
        if np.sum(here) < thresholds.LINE_AMPLITUDES:
            continue
        over, effort = p.relay.real[here] / p.velocity[here], p.effort.real[here]
        columns = np.column_stack([np.ones(len(over)), over]) / effort[:, None]
        (viscous, coulomb), *_ = np.linalg.lstsq(columns, np.ones(len(over)), rcond=None)
        rows.append(
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
    return rows


def _parameters(fitted: list[ConditionFit], file: StageFile, known: float) -> dict[str, Parameter]:
    kind, best = file.axis.kind, fitted[-1].fit
    unit = np.eye(len(best.values) + 1)
    delay = best.interval(unit[-1], "s")
    parameters = {
        "inertia": best.interval(unit[0], unit_of("inertia", kind)),
        "viscous": best.interval(unit[1], unit_of("viscous", kind)),
        "delay": Parameter(delay.value + known, delay.low + known, delay.high + known, "s"),
    }
    for _, fit, _ in fitted:
        if len(fit.slip):
            weights = np.append(np.append(np.zeros(2), np.ones(len(fit.slip))), 0.0)
            parameters["coulomb"] = fit.interval(weights, unit_of("coulomb", kind))
    return parameters


def _row(entry: ConditionFit) -> dict[str, Any]:
    condition, fit, amplitude = entry
    return {
        "of": condition,
        "name": fit.name,
        "amplitude": amplitude,
        "inertia": float(fit.values[0]),
        "viscous": float(fit.values[1]),
        "coulomb": None if math.isnan(fit.coulomb) else fit.coulomb,
        "delay": fit.delay,
        "residual": fit.residual,
    }


def _friction_effect(curve: Curve, fit: fits.ResponseFit, constant: float) -> dict[str, Any]:
    """Effect of friction on each sound line: gain (dB) and phase (deg) over those of the linear model."""
    s = 2j * np.pi * curve.frequency[curve.sound]
    ratio = curve.response[curve.sound] * np.exp(s * fit.delay) * (fit.values[0] * s + fit.values[1]) / constant
    return {
        "kind": curve.kind,
        "amplitude": curve.amplitude,
        "moving": curve.moving,
        "frequency": curve.frequency[curve.sound].tolist(),
        "gain_db": (20.0 * np.log10(np.abs(ratio))).tolist(),
        "phase_deg": np.degrees(np.angle(ratio)).tolist(),
    }


def _curve_values(curve: Curve) -> dict[str, Any]:
    """A curve as JSON values; NaN becomes null."""
    polar = {"gain": np.abs(curve.response), "phase": np.unwrap(np.angle(curve.response))}
    shown = {**curve._asdict(), **polar, "sound": curve.sound}
    return {name: plain(value) for name, value in shown.items() if name not in ("response", "relay")}


def _doubts(merged: list[Curve], taken: ConditionFit, capture: Capture) -> list[str]:
    notes: list[str] = [
        Note(
            Topic.FORCE_CONSTANT,
            "the force constant is taken from the stage file: inertia and friction scale with it",
        ),
        Note(Topic.DELAY, f"the delay counts from the {capture.current_column} column to the position column"),
    ]
    for curve in merged:
        notes += _curve_doubts(curve)
    if taken.condition == LARGEST:
        text = (
            "friction is in this response: viscous is too high and inertia wrong, by more than their intervals, and "
            "neither is written to a stage file. Record sines at three amplitudes, or keep the axis moving while the "
            "current is injected (type: excited)"
        )
        notes.append(Note(Topic.NOT_IDENTIFIED, text))
    return notes


def _curve_doubts(curve: Curve) -> list[Note]:
    where = f"{curve.kind} of {curve.amplitude:.3g} A{', axis moving' if curve.moving else ''}"
    poor, notes = curve.frequency[~curve.sound], []
    if len(poor):
        text = (
            f"{where}: coherence below {coherence_threshold(curve.periods):.2f} at {len(poor)} of "
            f"{len(curve.frequency)} lines ({poor[0]:.3g} to {poor[-1]:.3g} Hz); they are shown, not fitted"
        )
        notes.append(Note(Topic.COHERENCE, text))
    if alone := int(np.sum(np.isnan(curve.coherence))):
        text = (
            f"{where}: nothing to average at {alone} of {len(curve.frequency)} lines, so coherence and variance are "
            "not known there; record more periods"
        )
        notes.append(Note(Topic.PRECISION, text))
    if curve.kind == "multisine" and not math.isnan(curve.distortion):
        text = (
            f"{where}: even lines, which an odd multisine does not excite, carry {percent(curve.distortion)} of "
            "the excited ones: even distortion and noise (odd distortion, as of friction, is not in them)"
        )
        notes.append(Note(Topic.RESIDUAL, text))
    return notes
