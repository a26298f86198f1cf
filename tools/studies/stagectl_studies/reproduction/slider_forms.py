"""The forms of the slider paper's friction, fitted to its reversals: by today's optimiser and by a genetic algorithm.

The conventional form is a function of the speed, the same before and behind the crossing.  It cannot hold where the
guide is still a spring, so it is fitted where it can: to the rows before the crossing.  Fitted to all rows it has no
Stribeck rise left, or a dip in the place of one.  The paper's own agrees with the proposed form there ("when the
velocity is greater than zero ... the same", Fig. 8).
"""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from stagectl.compensation.legs import Array
from stagectl.compensation.zero_crossing import Form
from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Capture
from stagectl.identification.reversal import fit
from stagectl.identification.reversal.method import curves
from stagectl.identification.reversal.reversals import reversals
from stagectl_studies.reproduction import genetic

CONVENTIONAL, FIRST, SECOND, OURS = "symmetric", "exponential", "gaussian", "displacement"
FREE = "exponential-free"  # its force at zero velocity not held in physical bounds
PAPERS = (CONVENTIONAL, FIRST, SECOND)  # searched by the genetic algorithm, too


class Search(NamedTuple):
    """What one optimiser found."""

    cost: float  # N, rms over the rows that were fitted
    evaluations: int
    seconds: float


class FittedForm(NamedTuple):
    """One form with its values."""

    form: Form
    residual: float  # N, rms over the whole reversal
    today: Search
    genetic: Search | None  # of the paper's three


class FittedForms(NamedTuple):
    """All forms, and the reversals that they were fitted to."""

    forms: dict[str, FittedForm]
    curves: dict[str, list[float]]  # of the first reversal: time, velocity, friction, and each form's force
    friction: float  # N, rms of what is fitted


def fitted_forms(captures: list[Capture], file: StageFile, seed: int, tell: Callable[[int, int], None]) -> FittedForms:
    """All forms fitted to the reversals of `captures`.

    Raises IdentificationError as the method `zero-crossing` does.
    """
    data = fit.gathered([reversals(capture, file) for capture in captures])
    names = (CONVENTIONAL, FIRST, FREE, SECOND, OURS)
    forms = {}
    for number, name in enumerate(names):
        forms[name] = _fitted(name, data, seed)
        tell(number + 1, len(names))
    drawn = curves(data, {name: fitted.form for name, fitted in forms.items()})
    return FittedForms(forms, drawn, _rms(data.friction))


def sliding(data: fit.ReversalData) -> fit.ReversalData:
    """The rows before each crossing: legs with odd numbers end there."""
    before = data.cut.leg % 2 == 1
    columns = ("leg", "since", "until", "covered", "speed")
    cut = data.cut._replace(**{name: getattr(data.cut, name)[before] for name in columns})
    return data._replace(cut=cut, friction=data.friction[before])


def _fitted(name: str, data: fit.ReversalData, seed: int) -> FittedForm:
    kind, physical = name.removesuffix("-free"), name != FREE
    rows = sliding(data) if name == CONVENTIONAL else data
    begun = time.perf_counter()
    best = fit.fitted(kind, rows, seed, physical=physical)
    today = Search(_rms(best.residual), best.evaluations, time.perf_counter() - begun)
    bred = _bred(kind, rows, seed) if name in PAPERS else None
    return FittedForm(best.form, _rms(data.friction - best.form.along(data.cut)), today, bred)


def _bred(kind: str, rows: fit.ReversalData, seed: int) -> Search:
    """By the genetic algorithm, between the same bounds."""
    low, high = fit.bounds(kind, rows, physical=True)
    begun = time.perf_counter()
    found = genetic.searched(lambda z: fit.misfit(kind, z, rows), np.log(low), np.log(high), seed)
    seconds = time.perf_counter() - begun
    return Search(float(np.sqrt(found.cost / len(rows.friction))), found.evaluations, seconds)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
