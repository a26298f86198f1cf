"""The method `friction-models`: the whole friction family fitted to the same captures by the same code, and compared.

Each member is fitted as `fit` describes, and compared as `comparison` does.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import standard_errors, thresholds
from stagectl.identification.capture import Array, Capture
from stagectl.identification.friction import closed_loop, comparison
from stagectl.identification.friction import delay as delays
from stagectl.identification.friction.comparison import FIRST, Basis, bic
from stagectl.identification.friction.fit import (
    FilteredCapture,
    FrictionFit,
    Scale,
    fitted,
    plant,
    prepared,
    sensitivity,
)
from stagectl.identification.friction.members import FAMILY
from stagectl.identification.result import IdentificationResult, Note, Parameter, Progress, Topic
from stagectl.identification.thresholds import NORMAL_95
from stagectl.kernels import stage
from stagectl.units import Quantity

LAW = {"dahl": "dahl", "lugre": "lugre"}  # in a stage file; all others become stop operators


def identify(
    captures: list[Capture],
    file: StageFile,
    progress: Progress = lambda done, total: None,
    delay: float | None = None,
) -> IdentificationResult:
    """All members of the family; the parameters are those of the best by BIC of those that a stage file can hold.

    `delay` (s) between current and position is one for all members (`delay`); it is estimated where it is None.
    Raises IdentificationError where the captures do not determine inertia and friction.
    """
    basis = _basis(captures, file, delay)
    force = basis.force
    fits: list[FrictionFit] = []
    rows: list[dict[str, Any]] = []
    for number, name in enumerate(FAMILY):
        fits.append(fitted(name, basis.data, basis.scale))
        row = comparison.summary(fits[-1], force)
        rows.append({**row, "held_out": comparison.held_out(fits[-1], basis), **comparison.simulated(fits[-1], basis)})
        progress(number + 1, len(FAMILY))
    independent = standard_errors.independent(min(fits, key=lambda fit: fit.residual_square).residual)
    for fit, row in zip(fits, rows, strict=True):
        row["bic"] = bic(fit, independent)
    holdable = [row["bic"] if fit.member.whole else math.inf for fit, row in zip(fits, rows, strict=True)]
    best = int(np.argmin(holdable))
    result = _result(fits[best], basis)
    details = {**result.details, "chosen": fits[best].name, "models": rows, "independent_rows": independent}
    notes = comparison.notes(rows, best, captures)
    if "closed_loop" in rows[best] and basis.delay.value:
        notes.append(Note(Topic.METHOD, "closed loop: simulated without the delay, which the stage file does not get"))
    if "closed_loop" in rows[best] and any(capture.meta.get("name") == "EMPS" for capture in captures):
        details["published"] = closed_loop.PUBLISHED._asdict()
        text = comparison.error_text(details["published"])
        notes.append(Note(Topic.METHOD, f"published for this record, four parameters and a delay: {text}"))
    return result._replace(details=details, notes=(*notes, *result.notes))


def _basis(captures: list[Capture], file: StageFile, delay: float | None) -> Basis:
    """The captures with their current shifted to its force."""

    def at(value: float) -> tuple[list[FilteredCapture], Scale]:
        return prepared([delays.shifted(capture, value) for capture in captures], file)

    def residual_rms(value: float) -> float:
        residual = fitted(thresholds.DELAY_PROBE, *at(value)).residual
        return math.sqrt(float(np.mean(residual * residual)))

    plain = at(0.0)
    used = delays.given(delay) if delay is not None else delays.estimated(captures, file, residual_rms)
    return Basis(*(at(used.value) if used.value else plain), captures, file, used)


def _result(fit: FrictionFit, basis: Basis) -> IdentificationResult:
    """Values with their intervals; a parameter that is not identifiable has its bounds for an interval, and a note."""
    covariance, per_second = _covariance(fit, basis)
    count, axis = len(fit.weights), basis.file.axis.kind
    parameters, notes = {}, []
    for number, (name, unit) in enumerate(comparison.names(fit)):
        si, spread = Quantity(unit, "", "").unit_for(axis), NORMAL_95 * math.sqrt(covariance[number, number])
        if number < count:
            value = float(fit.weights[number])
            low = value - spread if name == "offset" else max(value - spread, 0.0)
            parameters[name] = Parameter(value, low, value + spread, si)
            continue
        parameters[name] = _searched(fit, number - count, spread, si)
        low, high = fit.bounds[number - count]
        span = f"[{low:.3g}, {high:.3g}] {si}".rstrip()
        if not spread < math.log(thresholds.IDENTIFIED_FACTOR):
            text = f"{fit.name}: these captures do not determine {name}; it was searched in {span}"
            notes.append(Note(Topic.NOT_IDENTIFIED, text))
        elif not 1.01 * low < parameters[name].value < high / 1.01:
            text = f"{fit.name}: {name} lies at an end of {span}, where it was searched; it may be beyond"
            notes.append(Note(Topic.PRECISION, text))
    if "coulomb" not in parameters:
        parameters["coulomb"] = _coulomb(fit, covariance, parameters["offset"].unit)
    if basis.delay.known is not None:
        parameters["delay"] = basis.delay.known
    notes.append(delays.note(basis.delay, list(FIRST), fit.weights, per_second))
    return IdentificationResult(
        parameters, details={"model": fit.name}, notes=tuple(notes), changes=_changes(fit, basis)
    )


def _covariance(fit: FrictionFit, basis: Basis) -> tuple[Array, Array]:
    """Covariance (k, k) of weights and logarithms of theta, infinite where they have no effect.

    The second array holds the change of each effective parameter per second of delay.
    """
    columns = np.column_stack([fit.regressor, sensitivity(fit, basis.data)])
    length = np.linalg.norm(columns, axis=0)
    effective = length > 1e-9 * float(np.linalg.norm(basis.force))
    effective[: len(fit.weights)] = length[: len(fit.weights)] > 0.0
    unit, size = columns[:, effective] / length[effective], length[effective]
    inner = standard_errors.covariance(unit, fit.residual)
    slope = -np.linalg.pinv(unit) @ np.concatenate([capture.rate for capture in basis.data])
    per_second = slope / size
    shared = basis.delay.deviation**2 * np.outer(per_second, per_second)
    covariance = np.full((len(length), len(length)), math.inf)
    covariance[np.ix_(effective, effective)] = inner / np.outer(size, size) + shared
    return covariance, per_second


def _changes(fit: FrictionFit, basis: Basis) -> dict[str, Any]:
    """What a stage file gets: the mechanics, and the friction that the plant simulates this model with."""
    model = plant(fit, basis.file, basis.jump)
    mechanics = {f"mechanics.{name}": getattr(model.mechanics, name) for name in ("inertia", "viscous", "bias")}
    return {**mechanics, "friction": friction_block(model.friction, LAW.get(fit.name, "stop-operators"))}


def friction_block(p: stage.Friction, law: str) -> dict[str, Any]:
    """The plant's friction as the block of a stage file, SI."""
    bristle = p.bristle
    if law == "stop-operators":
        pairs = zip(p.operators.weight, p.operators.slip, strict=True)
        carrying = [(float(weight), float(slip)) for weight, slip in pairs if weight > 0.0]
        weight, slip = zip(*carrying, strict=True) if carrying else ((0.0,), (1.0,))
        block: dict[str, Any] = {"law": law, "weight": list(weight), "slip": list(slip)}
        return {**block, "stribeck": p.stribeck._asdict()} if p.stribeck.rise > 0.0 else block
    block = {"law": law, "coulomb": bristle.coulomb, "range": bristle.coulomb / bristle.stiffness}
    if law == "dahl":
        return {**block, "exponent": bristle.exponent}
    return {**block, "damping": bristle.damping, "stribeck": bristle.stribeck._asdict()}


def _searched(fit: FrictionFit, number: int, spread: float, unit: str) -> Parameter:
    """A searched parameter; its interval is one of its logarithm, within the bounds."""
    value, (low, high) = float(fit.theta[number]), fit.bounds[number]
    if not spread < math.log(thresholds.IDENTIFIED_FACTOR):
        return Parameter(value, low, high, unit)
    return Parameter(value, max(value * math.exp(-spread), low), min(value * math.exp(spread), high), unit)


def _coulomb(fit: FrictionFit, covariance: Array, unit: str) -> Parameter:
    """Coulomb friction of a bundle, the sum of its weights; of a table, half the rise from end to end."""
    share = 0.5 if fit.name == "table" else 1.0
    inside = slice(2, 2 + len(fit.member.linear))
    value = share * float(np.sum(fit.weights[inside]))
    spread = share * NORMAL_95 * math.sqrt(max(float(np.sum(covariance[inside, inside])), 0.0))
    return Parameter.around(value, spread, unit)
