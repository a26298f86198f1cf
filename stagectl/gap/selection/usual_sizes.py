"""What is known before the data: the base's parameters around their nominal values, and every effect's usual sizes."""

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import chdtrc

from stagectl.gap.effects.library import EFFECTS
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.selection import constants, priors
from stagectl.gap.selection.candidates import EffectValues, Form
from stagectl.gap.selection.evidence import Candidate, Prior
from stagectl.gap.selection.refine import Fitted

Places = Callable[[Sequence[str]], list[int]]  # of columns, by their names


def of_base(prior: priors.Prior, now: TrackedModel, names: Sequence[str], places: Places) -> Prior:
    """The base's parameters `names`, as steps from where the model `now` has them."""
    moved, width = np.array([prior.informed(now, names)[name] for name in names]).T
    return Prior(tuple(places(names)), -moved, width)


def of_form_error(members: Sequence[int]) -> Prior:
    """The friction's error of form: a mixture of the null ensemble's `members` with the spread of a single one."""
    deviation = np.full(len(members), max(len(members), 1) ** -0.5)
    return Prior(tuple(members), np.zeros(len(members)), deviation)


def immaterial(forms: Sequence[Form], places: Places) -> Prior:
    """Every effect at a size that does not matter: a few per cent of the typical one, over all places on its grid.

    Each machine has a trace of everything, so that a trace is no finding; and what the effects explain, they explain
    with an error of form.  An effect whose column bends with its size has no column of a trace.
    """
    straight, counts = [form for form in forms if not form.effect.nonlinear], _counts(forms)
    sizes = [
        constants.IMMATERIAL * size / counts[form.effect.name] ** 0.5
        for form in straight
        for size in _usual(form, forms)
    ]
    columns = tuple(places([name for form in straight for name in form.names]))
    return Prior(columns, np.zeros(len(columns)), np.array(sizes))


def _usual(form: Form, forms: Sequence[Form]) -> list[float]:
    """The typical sizes of a form; of one that holds a narrower effect, no more than that effect's.

    Their trace is one and the same.  At the size that is typical of a bare motor, all cogging of a screw is a trace.
    """
    held = {effect.name for effect in EFFECTS.values() if form.effect.name in effect.generalisations}
    narrow = {a.unit: abs(a.typical[0]) for one in forms if one.effect.name in held for a in one.effect.amplitudes}
    pairs = zip(form.typical, form.effect.amplitudes, strict=True)
    return [min(abs(size), narrow.get(amplitude.unit, abs(size))) for size, amplitude in pairs]


def _counts(forms: Sequence[Form]) -> Counter[str]:
    return Counter(form.effect.name for form in forms)


def of_effects(forms: Sequence[Form], places: Places) -> list[Candidate]:
    """Every form of every effect at every scale; an effect's forms share its prior."""
    counts = _counts(forms)
    return [
        candidate
        for number, form in enumerate(forms)
        for candidate in _candidates(form, number, tuple(places(form.names)), 1.0 / counts[form.effect.name])
    ]


def _candidates(form: Form, number: int, places: tuple[int, ...], share: float) -> list[Candidate]:
    """One form at every scale; one whose column bends with its size at the size at which the column was taken."""
    size, name = np.abs(np.array(form.typical)), form.effect.name
    if form.effect.nonlinear:
        return [Candidate(name, number, Prior(places, np.array(form.typical), constants.BENT * size), share)]
    size = np.abs(np.array([amplitude.typical[0] for amplitude in form.effect.amplitudes]))
    positive = all(amplitude.low == 0.0 for amplitude in form.effect.amplitudes)
    whole, none = sum(often for _, often in constants.SCALES), np.zeros(len(size))
    return [
        Candidate(name, number, Prior(places, none, scale * size), share * often / whole, positive)
        for scale, often in constants.SCALES
    ]


def as_large(valued: EffectValues) -> float:
    """Of the machines that have the effect, the share on which it is as large as here, or larger.

    By the scales of the typical size; a column that bends was taken at its size, of which nothing else is known.
    """
    if valued.effect.nonlinear:
        return 1.0
    amplitudes = valued.effect.amplitudes
    size = sum((valued.values[a.name] / a.typical[0]) ** 2 for a in amplitudes)
    larger = sum(often * chdtrc(len(amplitudes), size / scale**2) for scale, often in constants.SCALES)
    return float(larger / sum(often for _, often in constants.SCALES))


def of_own(now: Fitted, places: Places) -> Prior:
    """The parameters of the effects that are in the model, as steps from their fitted values."""
    names, deviations = [], []
    for valued in now.effects:
        effect = valued.effect
        sizes = [
            (a.name, constants.WIDEST * max(abs(valued.values[a.name]), abs(a.typical[0]))) for a in effect.amplitudes
        ]
        whole = {s.name: 1.0 if s.share else valued.values[s.name] for s in effect.shapes if s.refined}
        sizes += [(name, constants.SHAPE * size) for name, size in whole.items()]
        names += [f"{effect.name}.{name}" for name, _ in sizes]
        deviations += [size for _, size in sizes]
    return Prior(tuple(places(names)), np.zeros(len(names)), np.array(deviations))
