"""The friction family compared: information criterion, rows held out, simulation in closed loop, and notes on them.

BIC = m ln(RSS/n) + p ln m          m: number of independent values that the n rows are worth, p parameters
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Capture
from stagectl.identification.friction import closed_loop
from stagectl.identification.friction.fit import Data, FrictionFit, fitted, fitted_force, plant
from stagectl.identification.result import UNITS, Note, Topic

FIRST = ("inertia", "viscous")  # parameters of every member; the offset comes behind its own weights


class Basis(NamedTuple):
    """The data that all members are fitted to and compared on."""

    data: Data
    captures: list[Capture]
    file: StageFile

    @property
    def jump(self) -> float:
        """Displacement (rad | m) over which Coulomb friction changes its sign in simulation."""
        return thresholds.COULOMB_STEPS * self.data.scale.step


def bic(fit: FrictionFit, independent: float) -> float:
    """Bayesian information criterion, for a residual that is worth so many `independent` values."""
    size = fit.member.size
    return independent * math.log(fit.residual_square / len(fit.residual)) + size * math.log(independent)


def names(fit: FrictionFit) -> list[tuple[str, str]]:
    """Name and unit of every weight and searched parameter, in the order of the fit."""
    searched = ((parameter.name, parameter.unit) for parameter in fit.member.searched)
    first = ((name, UNITS[name]) for name in FIRST)
    return [*first, *fit.member.linear, ("offset", UNITS["offset"]), *searched]


def summary(fit: FrictionFit, basis: Basis) -> dict[str, Any]:
    """One member as JSON values."""
    values = (*fit.weights.tolist(), *fit.theta.tolist())
    size = float(np.linalg.norm(basis.data.force(fit.delay)))
    return {
        "name": fit.name,
        "words": fit.member.words,
        "count": fit.member.size,
        "force_residual_percent": 100.0 * math.sqrt(fit.residual_square) / size,
        "delay": fit.delay,
        "values": dict(zip((name for name, _ in names(fit)), values, strict=True)),
    }


def held_out(fit: FrictionFit, basis: Basis) -> dict[str, float]:
    """Residual in percent of rows that a second fit did not use: the later half, and the fastest rows."""
    speed = np.abs(np.concatenate([capture.fixed[:, 1] for capture in basis.data.captures]))
    rows = [len(capture.fixed) for capture in basis.data.captures]
    half = np.concatenate([np.arange(count) < count // 2 for count in rows])
    residuals = {}
    for name, used in (("later_half", half), ("fastest", speed < thresholds.FASTEST_ROWS * basis.data.scale.fastest)):
        again = fitted(fit.name, basis.data, used, fit)
        force = basis.data.force(again.delay)
        error = (force - fitted_force(again, basis.data))[~used]
        share = float(np.linalg.norm(error) / np.linalg.norm(force[~used])) if len(error) else math.nan
        residuals[name] = 100.0 * share
    return residuals


def simulated(fit: FrictionFit, basis: Basis) -> dict[str, Any]:
    """The errors in closed loop of the first capture whose controller is known; empty where there is none."""
    for capture in basis.captures:
        servo = controller(capture, basis.file)
        if servo is None or capture.reference is None:
            continue
        run = closed_loop.simulated(plant(fit, basis.file, basis.jump), servo, capture)
        return {"closed_loop": closed_loop.errors(run, capture)._asdict()}
    return {}


def controller(capture: Capture, file: StageFile) -> closed_loop.Servo | None:
    """The servo that the capture was recorded with; None where it is not known."""
    known = capture.meta.get("nominal", {}).get("controller", {})
    if known.get("kp") is None or known.get("kv") is None:
        return None
    return closed_loop.Servo(float(known["kp"]), float(known["kv"]), file.drive.current_limit)


def notes(rows: list[dict[str, Any]], best: int, captures: list[Capture]) -> list[Note]:
    """Notes on the comparison of all `rows`, the `best` first, and on the captures it was made with."""
    chosen, first = rows[best], min(rows, key=lambda row: float(row["bic"]))
    remarks = [_winner(chosen, rows[0], "of those that a stage file can hold completely")]
    if first is not chosen:
        remarks.append(_winner(first, rows[0], f"of all {len(rows)}"))
    periods = (repeats(capture) for capture in captures)
    period = next((period for period in periods if period is not None), None)
    if period is not None:
        text = (
            f"the reference repeats every {period:.4g} s: the later half holds the same motion as the earlier, so it "
            "shows how far machine and noise repeat, not how a model does on another motion; the fastest rows, held "
            "out, show how a model extrapolates beyond the speeds it was fitted to"
        )
        remarks.append(Note(Topic.PERIODIC, text))
    remarks += [_member_note(row, float(first["bic"])) for row in rows]
    if "closed_loop" in chosen:
        text = (
            "closed loop: errors of position / velocity / acceleration / force; table and rheology model run as the "
            "stop operators with their curve, without the creep"
        )
        remarks.append(Note(Topic.METHOD, text))
    return remarks


def _winner(row: dict[str, Any], simplest: dict[str, Any], among: str) -> Note:
    return Note(
        Topic.MODEL_CHOICE,
        f"{row['words']} ({row['count']} parameters) has the lowest BIC {among}: its residual is "
        f"{row['force_residual_percent']:.3g} % of the force, that of {simplest['words']} ({simplest['count']}) "
        f"{simplest['force_residual_percent']:.3g} %",
    )


def _member_note(row: dict[str, Any], lowest: float) -> Note:
    text = (
        f"{row['words']}, {row['count']} parameters: residual {row['force_residual_percent']:.3g} % of the force, "
        f"{row['held_out']['fastest']:.3g} % of the fastest rows held out, BIC {row['bic'] - lowest:+.1f}"
    )
    loop = f"; closed loop {error_text(row['closed_loop'])}" if "closed_loop" in row else ""
    return Note(Topic.MODEL_CHOICE, text + loop)


def error_text(errors: Mapping[str, float]) -> str:
    """The four errors in closed loop, as text."""
    return " / ".join(f"{value:.4g}" for value in errors.values()) + " %"


def repeats(capture: Capture) -> float | None:
    """Period (s) of a reference that repeats at least twice; None where it does not, or there is none."""
    if capture.reference is None:
        return None
    x = capture.reference - capture.reference.mean()
    size = len(x)
    spectrum = np.fft.rfft(x, 2 * size)
    product = np.fft.irfft(spectrum * np.conj(spectrum))[: size // 2]
    power = np.concatenate([[0.0], np.cumsum(x * x)])
    lags = np.arange(size // 2)
    correlation = product / np.sqrt(np.maximum(power[size - lags] * (power[size] - power[lags]), 1e-300))
    below = np.flatnonzero(correlation < thresholds.NOT_REPEATING)
    if not len(below):
        return None
    later = int(below[0] + np.argmax(correlation[below[0] :]))
    return later * capture.dt if correlation[later] > thresholds.REPEATING else None
