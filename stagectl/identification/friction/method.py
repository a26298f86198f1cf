"""The method `friction-models`: the whole friction family fitted to the same captures by the same code, and compared.

Each member is fitted as `fit` describes, and compared as `comparison` does.
"""

import math
from typing import Any

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import standard_errors, thresholds
from stagectl.identification.capture import Array, Capture
from stagectl.identification.friction import closed_loop, comparison
from stagectl.identification.friction.comparison import FIRST, Basis, bic
from stagectl.identification.friction.fit import FrictionFit, fitted, plant, prepared, sensitivity
from stagectl.identification.friction.members import FAMILY
from stagectl.identification.result import IdentificationResult, Note, Parameter, Progress, Topic
from stagectl.identification.simultaneous.estimate import known_delay
from stagectl.identification.thresholds import NORMAL_95
from stagectl.kernels import stage
from stagectl.number_format import percent
from stagectl.units import unit_on

NOTED_CHANGE = 1e-4  # s of delay, whose effect the note gives
LAW = {"dahl": "dahl", "lugre": "lugre"}  # in a stage file; all others become stop operators


def identify(
    captures: list[Capture],
    file: StageFile,
    progress: Progress = lambda done, total: None,
    delay: float | None = None,
) -> IdentificationResult:
    """All members of the family; the parameters are those of the best by BIC of those that a stage file can hold.

    Each member has its own `delay` (s) between current and position where it is None.
    Raises IdentificationError where the captures do not determine inertia and friction.
    """
    basis = Basis(prepared(captures, file, known_delay(captures, file, delay)), captures, file)
    fits: list[FrictionFit] = []
    rows: list[dict[str, Any]] = []
    for number, name in enumerate(FAMILY):
        fits.append(fitted(name, basis.data))
        row = comparison.summary(fits[-1], basis)
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
    if "closed_loop" in rows[best] and fits[best].delay:
        notes.append(Note(Topic.METHOD, "closed loop: simulated without the delay, which the stage file does not get"))
    if "closed_loop" in rows[best] and any(capture.meta.get("name") == "EMPS" for capture in captures):
        details["published"] = closed_loop.PUBLISHED._asdict()
        text = comparison.error_text(details["published"])
        notes.append(Note(Topic.METHOD, f"published for this record, four parameters and a delay: {text}"))
    return result._replace(details=details, notes=(*notes, *result.notes))


def _result(fit: FrictionFit, basis: Basis) -> IdentificationResult:
    """Values with their intervals; a parameter that is not identifiable has its bounds for an interval, and a note."""
    covariance, per_second = _covariance(fit, basis)
    count, axis = len(fit.weights), basis.file.axis.kind
    parameters, notes = {}, []
    for number, (name, unit) in enumerate(comparison.names(fit)):
        si, spread = unit_on(axis, unit), NORMAL_95 * math.sqrt(covariance[number, number])
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
    half = NORMAL_95 * math.sqrt(covariance[-1, -1])
    parameters["delay"] = Parameter.around(fit.delay, half, "s")
    notes.append(_delay_note(fit, half, per_second))
    return IdentificationResult(
        parameters, details={"model": fit.name}, notes=tuple(notes), changes=_changes(fit, basis)
    )


def _covariance(fit: FrictionFit, basis: Basis) -> tuple[Array, Array]:
    """Covariance (k, k) of weights, logarithms of theta and the delay, infinite where they have no effect.

    A given delay has a covariance of zero.  The second array holds the change of each of the others that is effective
    per second of delay.
    """
    rate = basis.data.rate(fit.delay)
    columns = np.column_stack([fit.regressor, sensitivity(fit, basis.data), rate])
    length = np.linalg.norm(columns, axis=0)
    effective = length > 1e-9 * float(np.linalg.norm(basis.data.force(fit.delay)))
    effective[: len(fit.weights)] = length[: len(fit.weights)] > 0.0
    known = not basis.data.delay.deviation
    effective[-1] = not known
    unit, size = columns[:, effective] / length[effective], length[effective]
    covariance = np.full((len(length), len(length)), math.inf)
    covariance[np.ix_(effective, effective)] = standard_errors.covariance(unit, fit.residual) / np.outer(size, size)
    covariance[-1, -1] = 0.0 if known else covariance[-1, -1]
    others = np.count_nonzero(effective[:-1])
    return covariance, -np.linalg.pinv(unit[:, :others]) @ rate / size[:others]


def _delay_note(fit: FrictionFit, half: float, per_second: Array) -> Note:
    """The delay, and the effect of 0.1 ms on inertia and viscous friction."""
    changes = ", ".join(
        f"{name} by {percent(NOTED_CHANGE * abs(slope / value))}"
        for name, value, slope in zip(FIRST, fit.weights.tolist(), per_second.tolist(), strict=False)
        if value
    )
    words = (
        f"{1e3 * fit.delay:.3g} ± {1e3 * half:.2g} ms, of this model" if half else f"{1e3 * fit.delay:.3g} ms, given"
    )
    included = "include its uncertainty" if half else "do not include"
    text = f"delay: {words}; 0.1 ms more or less would change {changes}, which the intervals {included}"
    return Note(Topic.DELAY, text)


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
