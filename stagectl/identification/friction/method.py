"""The whole friction family fitted to the same captures by the same code, and compared.

Each member is fitted as `friction_fit` says.  They are compared by

    BIC = m ln(RSS/n) + p ln m          m: how many independent numbers the n rows are worth, p parameters

by what they leave of rows they were not fitted to, and, where the capture says how its controller worked, by a
simulation in closed loop (`closed_loop`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import standard_errors
from stagectl.identification.capture import Array, Capture, IdentificationError
from stagectl.identification.friction import closed_loop
from stagectl.identification.friction import delay as delays
from stagectl.identification.friction.fit import Data, Fit, Scale, columns_of, fitted, plant, prepared, sensitivity
from stagectl.identification.friction.members import FAMILY
from stagectl.identification.friction.notes import four, words
from stagectl.identification.result import Found, Parameter, Progress
from stagectl.kernels import stage
from stagectl.units import Quantity

FASTEST = 0.75  # of the largest speed: above are the rows held out by speed
TOLD = 30.0  # a searched parameter that is known no better than to this factor is not told
FIRST = (("inertia", "kg m^2 | kg"), ("viscous", "N m s/rad | N s/m"))
LAST = (("offset", "N m | N"),)
SHARP = 20.0  # counts of the encoder over which a model's jump of Coulomb friction happens in simulation
LAW = {"dahl": "dahl", "lugre": "lugre"}  # in a stage file; all others become stop operators
PROBE = "gms"  # shows whether a delay leaves less of the force


class _Judge(NamedTuple):
    """What all members are judged on."""

    data: list[Data]
    scale: Scale
    captures: list[Capture]
    file: StageFile
    delay: delays.Delay

    @property
    def force(self) -> Array:
        """Thinned forces (m,) of all captures."""
        return np.concatenate([one.force for one in self.data])


def identify(
    captures: list[Capture], file: StageFile, progress: Progress | None = None, delay: float | None = None
) -> Found:
    """All members of the family; the parameters are those of the best by BIC of those that a stage file can have.

    `delay` (s) between current and position is one for all members, see `delay`; it is looked for where it is None.
    Raises IdentificationError where the captures do not tell inertia and friction.
    """
    judge = _judge(captures, file, delay)
    data, scale = judge.data, judge.scale
    fits: list[Fit] = []
    rows: list[dict[str, Any]] = []
    for number, name in enumerate(FAMILY):
        fits.append(fitted(name, data, scale))
        rows.append(
            {**_row(fits[-1], judge.force), "held_out": _held_out(fits[-1], judge), **_run_again(fits[-1], judge)}
        )
        if progress is not None:
            progress(number + 1, len(FAMILY))
    worth = standard_errors.independent(min(fits, key=_square).residual)
    for one, row in zip(fits, rows, strict=True):
        row["bic"] = bic(one, worth)
    best = int(np.argmin([row["bic"] if one.member.whole else math.inf for one, row in zip(fits, rows, strict=True)]))
    found = _found(fits[best], judge)
    details = {**found.details, "chosen": fits[best].name, "models": rows, "independent_rows": worth}
    notes = words(rows, best, captures)
    if "closed_loop" in rows[best] and judge.delay.value:
        notes.append("closed loop: run without the delay, which stands beside the model")
    if "closed_loop" in rows[best] and any(one.meta.get("name") == "EMPS" for one in captures):
        details["published"] = closed_loop.PUBLISHED._asdict()
        notes.append(f"published for this record, four parameters and a delay: {four(details['published'])}")
    return found._replace(details=details, notes=(*notes, *found.notes))


def _judge(captures: list[Capture], file: StageFile, delay: float | None) -> _Judge:
    """The captures with the current where its force is."""

    def at(value: float) -> tuple[list[Data], Scale]:
        return prepared([delays.shifted(one, value) for one in captures], file)

    def left(value: float) -> float:
        residual = fitted(PROBE, *at(value)).residual
        return math.sqrt(float(np.mean(residual * residual)))

    plain = at(0.0)
    taken = delays.given(delay) if delay is not None else delays.estimated(captures, file, left)
    return _Judge(*(at(taken.value) if taken.value else plain), captures, file, taken)


def fit(name: str, captures: list[Capture], file: StageFile, delay: float = 0.0) -> Found:
    """One member of the family fitted to `captures`, `delay` (s) between their current and position.

    Raises IdentificationError where there is no such member, or the captures do not tell its parameters.
    """
    if name not in FAMILY:
        raise IdentificationError(f"friction model {name}; must be one of {', '.join(FAMILY)}")
    judge = _judge(captures, file, delay)
    one = fitted(name, judge.data, judge.scale)
    found, worth = _found(one, judge), standard_errors.independent(one.residual)
    return found._replace(details={**found.details, **_row(one, judge.force), "bic": bic(one, worth)})


def bic(one: Fit, worth: float) -> float:
    """Bayesian information criterion, for a residual that is worth so many independent numbers."""
    return worth * math.log(_square(one) / len(one.residual)) + one.member.size * math.log(worth)


def _square(one: Fit) -> float:
    return float(one.residual @ one.residual)


def _row(one: Fit, force: Array) -> dict[str, Any]:
    return {
        "name": one.name,
        "words": one.member.words,
        "count": one.member.size,
        "force_residual_percent": 100.0 * math.sqrt(_square(one)) / float(np.linalg.norm(force)),
        "values": dict(
            zip((name for name, _ in _names(one)), (*one.weights.tolist(), *one.theta.tolist()), strict=True)
        ),
    }


def _names(one: Fit) -> list[tuple[str, str]]:
    """Name and unit of every weight and searched parameter, in the order of the fit."""
    return [*FIRST, *one.member.linear, *LAST, *((each.name, each.unit) for each in one.member.searched)]


def _held_out(one: Fit, judge: _Judge) -> dict[str, float]:
    """Residual in percent of the rows that a second fit did not see: the later half, and the fastest rows."""
    force = judge.force
    speed = np.abs(np.concatenate([each.fixed[:, 1] for each in judge.data]))
    half = np.concatenate([np.arange(len(each.force)) < len(each.force) // 2 for each in judge.data])
    found = {}
    for name, seen in (("later_half", half), ("fastest", speed < FASTEST * judge.scale.fastest)):
        again = fitted(one.name, judge.data, judge.scale, seen, one.theta)
        whole = fitted_force(again, judge.data)
        error = (force - whole)[~seen]
        found[name] = 100.0 * float(np.linalg.norm(error) / np.linalg.norm(force[~seen])) if len(error) else math.nan
    return found


def fitted_force(one: Fit, data: Sequence[Data]) -> Array:
    """Force (m,) of the model on all rows."""
    return columns_of(one, data) @ one.weights


def _run_again(one: Fit, judge: _Judge) -> dict[str, Any]:
    """The errors in closed loop of the first capture whose controller is known; nothing where none is."""
    for capture in judge.captures:
        servo = controller(capture, judge.file)
        if servo is None or capture.reference is None:
            continue
        model = plant(one, judge.file, SHARP * judge.scale.step)
        return {"closed_loop": closed_loop.errors(closed_loop.simulated(model, servo, capture), capture)._asdict()}
    return {}


def controller(capture: Capture, file: StageFile) -> closed_loop.Servo | None:
    """The servo that a capture says it was recorded with; None where it does not."""
    known = capture.meta.get("nominal", {}).get("controller", {})
    if known.get("kp") is None or known.get("kv") is None:
        return None
    return closed_loop.Servo(float(known["kp"]), float(known["kv"]), file.drive.current_limit)


def _found(one: Fit, judge: _Judge) -> Found:
    """Values with their intervals; what the captures do not tell has its bounds for an interval, and a note."""
    moves = sensitivity(one, judge.data)
    whole = np.column_stack([one.regressor, moves])
    length = np.linalg.norm(whole, axis=0)
    told = length > 1e-9 * float(np.linalg.norm(judge.force))
    told[: len(one.weights)] = length[: len(one.weights)] > 0.0
    covariance = np.full((len(length), len(length)), math.inf)
    inner = standard_errors.covariance(whole[:, told] / length[told], one.residual)
    slope = -np.linalg.pinv(whole[:, told] / length[told]) @ np.concatenate([each.rate for each in judge.data])
    per_second = slope / length[told]
    shared = judge.delay.deviation**2 * np.outer(per_second, per_second)
    covariance[np.ix_(told, told)] = inner / np.outer(length[told], length[told]) + shared
    count, axis = len(one.weights), judge.file.axis.kind
    parameters, notes = {}, []
    for number, (name, unit) in enumerate(_names(one)):
        si, spread = Quantity(unit, "", "").unit_for(axis), standard_errors.SURE * math.sqrt(covariance[number, number])
        if number < count:
            value = float(one.weights[number])
            low = value - spread if name == "offset" else max(value - spread, 0.0)
            parameters[name] = Parameter(value, low, value + spread, si)
            continue
        parameters[name] = _searched(one, number - count, spread, si)
        low, high = one.bounds[number - count]
        span = f"[{low:.3g}, {high:.3g}] {si}".rstrip()
        if not spread < math.log(TOLD):
            notes.append(f"{one.name}: {name} is not told by these captures; it was searched for in {span}")
        elif not 1.01 * low < parameters[name].value < high / 1.01:
            notes.append(f"{one.name}: {name} lies at an end of {span}, where it was searched for; it may be beyond")
    if "coulomb" not in parameters:
        parameters["coulomb"] = _total(one, covariance, parameters["offset"].unit)
    if judge.delay.known is not None:
        parameters["delay"] = judge.delay.known
    notes.append(delays.note(judge.delay, [name for name, _ in FIRST], one.weights, per_second))
    return Found(parameters, details={"model": one.name}, notes=tuple(notes), changes=_changes(one, judge))


def _changes(one: Fit, judge: _Judge) -> dict[str, Any]:
    """What a stage file gets: the mechanics, and the friction that the plant simulates this model with."""
    found = plant(one, judge.file, SHARP * judge.scale.step)
    mechanics = {f"mechanics.{name}": getattr(found.mechanics, name) for name in ("inertia", "viscous", "bias")}
    return {**mechanics, "friction": friction_block(found.friction, LAW.get(one.name, "stop-operators"))}


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


def _searched(one: Fit, number: int, spread: float, unit: str) -> Parameter:
    """A searched parameter; its interval is one of its logarithm, within the bounds."""
    value, (low, high) = float(one.theta[number]), one.bounds[number]
    if not spread < math.log(TOLD):
        return Parameter(value, low, high, unit)
    return Parameter(value, max(value * math.exp(-spread), low), min(value * math.exp(spread), high), unit)


def _total(one: Fit, covariance: Array, unit: str) -> Parameter:
    """Coulomb friction of a bundle, the sum of its weights; of a table, half the rise from end to end."""
    share = 0.5 if one.name == "table" else 1.0
    inside = slice(2, 2 + len(one.member.linear))
    value = share * float(np.sum(one.weights[inside]))
    spread = share * standard_errors.SURE * math.sqrt(max(float(np.sum(covariance[inside, inside])), 0.0))
    return Parameter(value, value - spread, value + spread, unit)
