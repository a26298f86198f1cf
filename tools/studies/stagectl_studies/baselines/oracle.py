"""Told which effects are there: the best that this library can do on these logs."""

from collections.abc import Sequence

from stagectl.gap.selection import refine
from stagectl_studies.baselines.baseline_common import Answer, Ground, shifts, singles


def oracle(g: Ground, names: Sequence[str]) -> Answer:
    """All effects that are told, the largest first, each refined beside the ones before it.

    What the library does not hold (a value that the model has, an effect on no list) stays with the base refit.
    """
    now = refine.start(g.evidence)
    waiting = [name for name in names if name in {form.effect.name for form in g.library.forms}]
    while waiting:
        best = singles(g, now)
        name = next((word for word in best if word in waiting), None)
        if name is None:
            break
        waiting.remove(name)
        after = refine.refine(g.evidence, now.model, [*now.effects, best[name]])
        now = after if after.residual_sum_of_squares < now.residual_sum_of_squares else now
    return Answer(tuple(effect.effect.name for effect in now.effects), now.equipped.stage, shifts(g))
