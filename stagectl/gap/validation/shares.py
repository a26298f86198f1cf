"""Who takes the gap: named effects, parameters, and the form of the rolling friction."""

from collections.abc import Sequence

from stagectl.gap.inference.patch_fields import fields_of
from stagectl.gap.result.diagnosis import FORM, PARAMETERS, Fields, FoundEffect, closable
from stagectl.gap.validation.thresholds import FORM_SHARE
from stagectl.gap.validation.validate import Validation
from stagectl.kernels.stage import Stage


def of_effects(effects: Sequence[FoundEffect], shares: dict[str, float]) -> list[FoundEffect]:
    """Effects with their shares of the closable gap.

    Parameters have one share together, which they divide in proportion to what each takes of the misfit.  The length of
    the rolling zone has that of the friction's form.
    """
    whole, shares = closable(shares), {"presliding": shares.get(FORM, 0.0), **shares}
    divided = [effect for effect in effects if effect.parameter and effect.name not in shares]
    taken = {effect.name: max(effect.share, 0.0) for effect in divided}
    total = sum(taken.values()) or 1.0
    parameters = shares.get(PARAMETERS, 0.0) / whole

    def share(effect: FoundEffect) -> float:
        divides = effect.name in taken
        return parameters * taken[effect.name] / total if divides else shares.get(effect.name, 0.0) / whole

    return [effect._replace(share=share(effect)) for effect in effects]


def law_of(nominal: Stage, found: Validation) -> Fields:
    """The friction's law of the improved model, where its form takes a part of the gap."""
    shares = found.closure.shares
    if shares.get(FORM, 0.0) < FORM_SHARE * closable(shares) or not found.closure.gap.shrinks:
        return ()
    return _rubbing(nominal, found.improved)


def as_improved(effects: Sequence[FoundEffect], nominal: Stage, improved: Stage) -> list[FoundEffect]:
    """The `effects`, a Coulomb friction with the curve of the improved model: a fitted one may lead the loop away."""
    fields = _rubbing(nominal, improved)
    return [effect._replace(fields=fields) if effect.name == "coulomb" and fields else effect for effect in effects]


def _rubbing(nominal: Stage, improved: Stage) -> Fields:
    """Size and curve of the improved model's friction, without its further effects."""
    rubs = improved.friction
    law = nominal.friction._replace(operators=rubs.operators, bristle=rubs.bristle)
    return fields_of(nominal, nominal._replace(friction=law))
