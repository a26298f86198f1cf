"""The method `zero-crossing`: friction from captures of reversals, every form fitted and compared, one chosen."""

import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple, get_type_hints

import numpy as np

from stagectl.compensation.zero_crossing import FORMS, Form
from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Capture, IdentificationError, Refusal, accepted
from stagectl.identification.result import IdentificationResult, Note, Parameter, Progress, Topic
from stagectl.identification.reversal.fit import FormFit, ReversalData, fitted, gathered
from stagectl.identification.reversal.reversals import Reversals, reversals
from stagectl.identification.thresholds import GENERATIONS
from stagectl.units import quantity_of, unit_on

UNBOUNDED = ("exponential", "symmetric")  # forms whose fit leaves the physical range of Cs if it may


class _FormFits(NamedTuple):
    """All fits, and their data."""

    chosen: str
    forms: dict[str, FormFit]
    free: dict[str, FormFit]  # without the physical bounds on Cs
    data: ReversalData
    captures: list[Reversals]


def identify(
    captures: list[Capture],
    file: StageFile,
    progress: Progress = lambda done, total: None,
    form: str = "displacement",
    seed: int = 1,
) -> IdentificationResult:
    """All forms fitted to the reversals of `captures`; the parameters are those of `form`.

    Raises IdentificationError where a form is unknown, or no capture has a reversal between two spans of constant
    friction.
    """
    if form not in FORMS:
        text = f"form = {form}; must be one of {', '.join(FORMS)}"
        raise IdentificationError(text, Refusal.UNKNOWN_OPTION, value=form, admissible=", ".join(FORMS))
    usable, left_out = accepted(captures, lambda capture: reversals(capture, file))
    data = gathered(usable)
    fits: dict[bool, dict[str, FormFit]] = {True: {}, False: {}}  # with and without the physical bounds on Cs
    searches = [*((name, True) for name in FORMS), *((name, False) for name in UNBOUNDED)]
    total = len(searches) * GENERATIONS
    for number, (name, physical) in enumerate(searches):
        fits[physical][name] = fitted(name, data, seed, _counted(progress, number * GENERATIONS, total), physical)
    progress(total, total)
    notes = (*left_out, *(note for capture in usable for note in capture.notes))
    return _result(_FormFits(form, fits[True], fits[False], data, usable), notes, file)


def _counted(progress: Progress, begun: int, total: int) -> Callable[..., None]:
    """What a search calls once a generation, after `begun` generations of the searches before."""
    steps = itertools.count(begun)

    def generation(*_: Any, **__: Any) -> None:
        progress(next(steps), total)

    return generation


def _result(fits: _FormFits, notes: tuple[str, ...], file: StageFile) -> IdentificationResult:
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
        "reversals": [_reversal_times(capture) for capture in fits.captures],
        "curves": curves(fits.data, drawn),
    }
    parameters = _parameters(best, file)
    return IdentificationResult(parameters, None, details, (*notes, *_remarks(fits, file)), {"compensation": block})


def _parameters(fit: FormFit, file: StageFile) -> dict[str, Parameter]:
    """Each value with its interval."""
    hints = get_type_hints(type(fit.form), include_extras=True)
    ends = list(zip(*fit.interval, strict=True))
    for value, half in zip(fit.form[-2:], fit.constant.tolist(), strict=True):
        ends.append((value - half, value + half))
    parameters = {}
    for (name, value), (low, high) in zip(fit.form._asdict().items(), ends, strict=True):
        quantity = quantity_of(hints[name])
        unit = quantity.unit_for(file.axis.kind) if quantity is not None else ""
        parameters[name] = Parameter(value, float(low), float(high), unit)
    return parameters


def _described(fit: FormFit, data: ReversalData, file: StageFile) -> dict[str, Any]:
    """A form's row of the comparison, as JSON values."""
    return {
        "parameters": {name: parameter._asdict() for name, parameter in _parameters(fit, file).items()},
        "fitted": len(fit.interval[0]),
        "residual_rms": _rms(fit.residual),
        "residual_percent": 100.0 * _rms(fit.residual) / _rms(data.friction),
        "static_at_bound": fit.at_bound,
        "evaluations": fit.evaluations,
    }


def _rms(values: Any) -> float:
    return math.sqrt(float(np.mean(np.square(values))))


def _reversal_times(capture: Reversals) -> dict[str, Any]:
    starts = capture.motion.cut.start
    return {
        "capture": capture.name,
        "time": [float(starts[reversal.leg]) for reversal in capture.reversals],
        "way": [float(capture.motion.cut.way[reversal.leg]) for reversal in capture.reversals],
    }


def curves(data: ReversalData, forms: dict[str, Form]) -> dict[str, Any]:
    """The first reversal, from its crossing (s): measured friction (N m | N), velocity, and each form's force."""
    rows = data.cut.leg <= 2
    after = data.cut.leg[rows] == 2
    time = np.where(after, data.cut.since[rows], -data.cut.until[rows])
    speed = data.cut.way[data.cut.leg[rows]] * data.cut.speed[rows]
    columns = {"time": time, "velocity": speed, "friction": data.friction[rows]}
    columns.update({name: form.along(data.cut)[rows] for name, form in forms.items()})
    return {name: column.tolist() for name, column in columns.items()}


def _remarks(fits: _FormFits, file: StageFile) -> list[Note]:
    """Notes that the user needs to use the numbers."""
    force = unit_on(file.axis.kind, "N m | N")
    largest, constant = fits.data.largest, fits.data.constant.positive
    texts = [
        "the viscous part is not included: M a and D v of the stage file are subtracted before the fit, and the "
        "plant's own are used in the compensation, too",
        "differential evolution, then a local polish (L-BFGS-B); intervals from the local Jacobian, the residual taken "
        "as coloured noise; it is mostly model error",
    ]
    notes = [Note(Topic.METHOD, text) for text in texts]
    for name, free in fits.free.items():
        if fits.forms[name].at_bound:
            text = (
                f"{name}: without bounds the fit would take static = {free.form.static:.3g} {force}; the largest force "
                f"seen is {largest:.3g} {force}, the constant one {constant:.3g} {force}: it stays in between "
                f"(residual {_rms(fits.forms[name].residual):.3g}, not {_rms(free.residual):.3g} {force})"
            )
            notes.append(Note(Topic.PRECISION, text))
    for name, fit in fits.forms.items():
        if fit.at_bound and name not in fits.free:
            text = f"{name}: static lies at a bound, the constant friction or the largest force seen"
            notes.append(Note(Topic.PRECISION, text))
    if fits.chosen != "displacement":
        text = f"{fits.chosen} is a function of time: it holds for the acceleration it was identified at"
        notes.append(Note(Topic.ACCELERATION_BOUND, text))
    return notes
