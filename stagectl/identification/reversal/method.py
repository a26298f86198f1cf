"""Zero-crossing friction from captures of reversals: every form fitted, compared, and one chosen."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, get_type_hints

import numpy as np

from stagectl.compensation.zero_crossing import FORMS, Form
from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Capture, IdentificationError
from stagectl.identification.result import Found, Parameter, Progress
from stagectl.identification.reversal.fit import GENERATIONS, Data, Fit, fitted, gathered
from stagectl.identification.reversal.reversals import Reversals, reversals
from stagectl.units import quantity_of

UNBOUNDED = ("exponential", "symmetric")  # forms whose fit leaves the physical range of Cs if it may


class _Fits(NamedTuple):
    """All that was fitted, and from what."""

    chosen: str
    forms: dict[str, Fit]
    free: dict[str, Fit]  # without the physical bounds on Cs
    data: Data
    seen: list[Reversals]


def identify(
    captures: list[Capture],
    file: StageFile,
    progress: Progress | None = None,
    form: str = "displacement",
    seed: int = 1,
) -> Found:
    """All forms fitted to the reversals of `captures`; the parameters are those of `form`.

    Raises IdentificationError where a form is unknown, or no capture has a reversal between two spans of constant
    friction.
    """
    if form not in FORMS:
        raise IdentificationError(f"form = {form}; must be one of {', '.join(FORMS)}")
    seen, notes = _usable(captures, file)
    data = gathered(seen)
    steps = _Steps(progress, (len(FORMS) + len(UNBOUNDED)) * GENERATIONS)
    fits = {name: fitted(name, data, seed, steps.part()) for name in FORMS}
    free = {name: fitted(name, data, seed, steps.part(), physical=False) for name in UNBOUNDED}
    steps.finish()
    return _found(_Fits(form, fits, free, data, seen), notes, file)


class _Steps:
    """Generations done, of all searches; one that converges early jumps ahead."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        self._progress, self._total, self._begun = progress, total, 0

    def part(self) -> Callable[..., None]:
        """Callback of the next search, called once a generation."""
        done, end = self._begun, self._begun + GENERATIONS
        self._begun = end

        def generation(*_: Any, **__: Any) -> None:
            nonlocal done
            done = min(done + 1, end)
            if self._progress is not None:
                self._progress(done, self._total)

        return generation

    def finish(self) -> None:
        """All done."""
        if self._progress is not None:
            self._progress(self._total, self._total)


def _usable(captures: list[Capture], file: StageFile) -> tuple[list[Reversals], tuple[str, ...]]:
    """Captures that serve; the others are named in the notes, or are the error where none is left."""
    seen: list[Reversals] = []
    refused: list[str] = []
    for capture in captures:
        try:
            seen.append(reversals(capture, file))
        except IdentificationError as error:
            refused.append(str(error))
    if not seen:
        raise IdentificationError("\n".join(refused) or "no capture given; record a trapezoid there and back")
    notes = [f"left out: {text}" for text in refused]
    for one in seen:
        notes.extend(one.notes)
    return seen, tuple(notes)


def _found(fits: _Fits, notes: tuple[str, ...], file: StageFile) -> Found:
    best = fits.forms[fits.chosen]
    block = {"form": fits.chosen, **best.form._asdict()}
    forms = {name: _described(fit, fits.data, file) for name, fit in fits.forms.items()}
    for name, free in fits.free.items():
        forms[name]["unbounded"] = _described(free, fits.data, file)
    drawn = {name: fit.form for name, fit in fits.forms.items()}
    drawn.update({f"{name}-free": fit.form for name, fit in fits.free.items()})
    details = {
        "form": fits.chosen,
        "forms": forms,
        "largest_force": fits.data.largest,
        "speed": fits.data.constant.speed,
        "reversals": [_where(one) for one in fits.seen],
        "curves": curves(fits.data, drawn),
    }
    parameters = _parameters(best, file)
    return Found(parameters, None, details, (*notes, *_remarks(fits, file)), {"compensation": block})


def _parameters(fit: Fit, file: StageFile) -> dict[str, Parameter]:
    """Each value with its interval."""
    hints = get_type_hints(type(fit.form), include_extras=True)
    ends = list(zip(*fit.interval, strict=True))
    for value, half in zip(fit.form[-2:], fit.constant.tolist(), strict=True):
        ends.append((value - half, value + half))
    found = {}
    for (name, value), (low, high) in zip(fit.form._asdict().items(), ends, strict=True):
        quantity = quantity_of(hints[name])
        unit = quantity.unit_for(file.axis.kind) if quantity is not None else ""
        found[name] = Parameter(value, float(low), float(high), unit)
    return found


def _described(fit: Fit, data: Data, file: StageFile) -> dict[str, Any]:
    """A form's row of the comparison, as JSON values."""
    return {
        "parameters": {name: one._asdict() for name, one in _parameters(fit, file).items()},
        "fitted": len(fit.interval[0]),
        "residual_rms": _rms(fit.residual),
        "residual_percent": 100.0 * _rms(fit.residual) / _rms(data.friction),
        "static_at_bound": fit.at_bound,
        "evaluations": fit.evaluations,
    }


def _rms(values: Any) -> float:
    return math.sqrt(float(np.mean(np.square(values))))


def _where(one: Reversals) -> dict[str, Any]:
    starts = one.motion.cut.start
    return {
        "capture": one.name,
        "time": [float(starts[reversal.leg]) for reversal in one.reversals],
        "way": [float(one.motion.cut.way[reversal.leg]) for reversal in one.reversals],
    }


def curves(data: Data, forms: dict[str, Form]) -> dict[str, Any]:
    """The first reversal, from its crossing (s): the friction seen (N m | N), the velocity, and each form's force."""
    rows = data.cut.leg <= 2
    after = data.cut.leg[rows] == 2
    time = np.where(after, data.cut.since[rows], -data.cut.until[rows])
    speed = data.cut.way[data.cut.leg[rows]] * data.cut.speed[rows]
    columns = {"time": time, "velocity": speed, "friction": data.friction[rows]}
    columns.update({name: form.along(data.cut)[rows] for name, form in forms.items()})
    return {name: column.tolist() for name, column in columns.items()}


def _remarks(fits: _Fits, file: StageFile) -> tuple[str, ...]:
    """What the user must know to use the numbers."""
    force = "N" if file.axis.kind == "linear" else "N m"
    largest = fits.data.largest
    notes = [
        "the viscous part is not inside: M a and D v of the stage file are taken off before the fit, and are the "
        "plant's in the compensation, too",
        "differential evolution, then a local polish (L-BFGS-B); intervals from the local Jacobian, the residual taken "
        "as coloured noise; it is mostly what the form cannot follow",
    ]
    for name, free in fits.free.items():
        if fits.forms[name].at_bound:
            notes.append(
                f"{name}: without bounds the fit would take static = {free.form.static:.3g} {force}; the largest force "
                f"seen is {largest:.3g} {force}, the constant one {fits.data.constant.positive:.3g} {force}: it stays "
                f"in between (residual {_rms(fits.forms[name].residual):.3g}, not {_rms(free.residual):.3g} {force})"
            )
    notes.extend(
        f"{name}: static lies at a bound, the constant friction or the largest force seen"
        for name, fit in fits.forms.items()
        if fit.at_bound and name not in fits.free
    )
    if fits.chosen != "displacement":
        notes.append(f"{fits.chosen} is a function of time: it holds for the acceleration it was identified at")
    return tuple(notes)
