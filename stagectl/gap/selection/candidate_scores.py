"""All candidates next to a model: what each would explain of its residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from stagectl.gap.effects.effect import Definition
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import gram_matrices, sensitivities
from stagectl.gap.residuals.gram_matrices import Grams, Products
from stagectl.gap.selection import baseline_fit, null_ensemble, refine
from stagectl.gap.selection.candidates import EffectValues, Form
from stagectl.gap.selection.cross_validation import (
    CURRENT,
    EFFORT,
    Score,
    channels_of,
    partialled_out,
    scores,
    without_nuisances,
)
from stagectl.gap.selection.detection_thresholds import Clarity, Threshold, clarity
from stagectl.gap.selection.refine import Evidence, Fitted


class Library(NamedTuple):
    """All candidates with their columns, and what the null ensemble gives them."""

    forms: tuple[Form, ...]
    products: Products  # with the columns of the base and the null ensemble
    thresholds: Mapping[str, Threshold]  # by effect
    resampled: int  # resamples for each experiment that is left out, to see whether an effect stays
    first: tuple[float, float]  # closable sum of squares after the baseline fit, of effort and current
    measured: bool  # whether the logs hold the current next to the command

    def channel(self, effect: Definition) -> int:
        """The channel of the residuals that shows `effect`."""
        return CURRENT if effect.block == "drive" and self.measured else EFFORT

    def forms_of(self, effect: str) -> list[Form]:
        """The candidates of one effect."""
        return [form for form in self.forms if form.effect.name == effect]


class CandidateScores(NamedTuple):
    """Every effect that is not in a model yet, scored on the residuals of that model."""

    scores: list[Score]
    floor: Array  # (2,) sum of squares that repeats differ by, of effort and current
    moving: list[str]  # columns that move next to every candidate
    products: Products
    residuals: list[list[Array]]

    def half_strokes(self, forms: Sequence[Form]) -> Grams:
        """The matrices of the half strokes, with the columns that a verdict on `forms` needs."""
        own = dict.fromkeys(name for form in forms for name in form.names)
        names = [*self.moving, *null_ensemble.member_names(self.products.names), *own]
        return gram_matrices.grams(gram_matrices.selected(self.products, names), self.residuals)

    def clarity(self, forms: Sequence[Form]) -> Clarity:
        """How clear the effect of `forms` is."""
        g = self.half_strokes(forms)
        return clarity(g, g.places(self.moving), forms)


def scored(e: Evidence, library: Library, now: Fitted) -> CandidateScores:
    """Every effect that is not in the model yet, on the residuals of `now`."""
    own = refine.parameters(now)
    columns = sensitivities.all_columns(now.equipped, e.runs, own, e.base.noise)
    products = gram_matrices.with_columns(library.products, columns)
    g, moving = (
        gram_matrices.fold_sums(products, now.residuals),
        [*nuisances(e), *(direction.name for direction in own)],
    )
    present = {valued.effect.name for valued in now.effects}
    forms = [form for form in library.forms if form.effect.name not in present]
    of_forms = scores(channels_of(g), g.places(moving), [g.places(form.names) for form in forms], forms)
    return CandidateScores(of_forms, g.floor.sum(axis=0), moving, products, now.residuals)


def nuisances(e: Evidence) -> list[str]:
    """Columns that move next to every candidate: the base's parameters, and the friction laws of the family."""
    names = [direction.name for direction in e.base.directions]
    return [*refine.nuisances(e), *(name for name in names if baseline_fit.is_member(name))]


def closable(e: Evidence, g: Grams) -> tuple[float, float]:
    """Sum of squares that no nuisance explains, above the floor of repeats: of residual effort and missing current."""
    free = without_nuisances(channels_of(g), g.places(nuisances(e)))
    effort, current = free[:, :, -1, -1].sum(axis=1) - g.floor.sum(axis=0)
    return float(effort), float(current)


def unexplained_effort(e: Evidence, now: Fitted) -> float:
    """Sum of squares of the residual effort that no nuisance explains: what functions are fitted to."""
    own = sensitivities.all_columns(now.equipped, e.runs, refine.parameters(now), e.base.noise)
    products = gram_matrices.with_columns(gram_matrices.selected(e.base.products, nuisances(e)), own)
    g = gram_matrices.fold_sums(products, now.residuals)
    return float(partialled_out(channels_of(g)[EFFORT], range(len(g.names)))[:, -1, -1].sum())


def name_of(score: Score) -> str:
    """The effect of a score."""
    return score.form.effect.name


def effect_of(score: Score) -> EffectValues:
    """The effect of a score, with its amplitudes."""
    return EffectValues(score.form.effect, score.form.values(score.amplitudes))
