"""Who takes the gap: named effects, parameters, and the form of the rolling friction."""

from collections.abc import Mapping, Sequence

from stagectl.gap.inference.patch_fields import fields_of
from stagectl.gap.result.diagnosis import FORM, NOISE, PARAMETERS, Fields, FoundEffect
from stagectl.gap.result.verdict_text import FORM_SHARE, shrinks
from stagectl.gap.validation.validate import Validation
from stagectl.kernels.stage import Stage


def closable(shares: Mapping[str, float]) -> float:
    """Share of the squared gap that is no noise."""
    return max(1.0 - shares.get(NOISE, 0.0), 1e-9)


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
    law = nominal.friction._replace(
        operators=found.improved.friction.operators, bristle=found.improved.friction.bristle
    )
    taken = found.closure.shares.get(FORM, 0.0) / closable(found.closure.shares)
    return (
        fields_of(nominal, nominal._replace(friction=law)) if taken >= FORM_SHARE and shrinks(found.closure.gap) else ()
    )
