"""Whose the gap is: each named effect's share goes to its block and its coordinate, as the effect's record says.

What the parameters of the model take is a part by itself, and what nothing explains stands as such.  Where an effect is
named, block and coordinate are those of the effects and of the drive's parameters, which are effects where a current
is measured; else those of the parameters or of the unexplained, of the larger.
"""

from collections.abc import Sequence

from stagectl.gap.effects.effect import CONTROLLER, DRIVE, MECHANICS
from stagectl.gap.result.diagnosis import BLOCKS, NAMED, PARAMETERS, UNEXPLAINED, Coordinate, FoundEffect, Part
from stagectl.gap.selection import refine
from stagectl.gap.selection.established import Selection
from stagectl.gap.selection.refine import Evidence


def parts_of(e: Evidence, selected: Selection, found: Sequence[FoundEffect]) -> tuple[Part, ...]:
    """Shares of what the nominal model leaves above the floor of repeats: effects, parameters, the unexplained."""
    named = [effect for effect in found if effect.probability >= NAMED]
    before, after = (
        max(refine.total(e, residuals) - refine.floor(e), 0.0) for residuals in (e.base.before, e.base.after)
    )
    effects = [
        Part(effect.name, effect.block, effect.coordinate, selected.gains.get(effect.name, 0.0))
        for effect in named
        if not effect.parameter
    ]
    parts = [
        *effects,
        *_of_parameters([effect for effect in named if effect.parameter], before - after),
        *_unexplained(selected, [effect.name for effect in effects]),
    ]
    whole = sum(max(part.share, 0.0) for part in parts) or 1.0
    return tuple(part._replace(share=max(part.share, 0.0) / whole) for part in parts)


def _unexplained(selected: Selection, named: Sequence[str]) -> list[Part]:
    """What the model leaves in mechanics and drive, and what of it is in the model without being `named`."""
    left = {MECHANICS: selected.left[0], DRIVE: selected.left[1]}
    for effect in (valued.effect for valued in selected.fitted.effects if valued.effect.name not in named):
        left[DRIVE if effect.block == DRIVE else MECHANICS] += selected.gains.get(effect.name, 0.0)
    return [Part(UNEXPLAINED, block, "none", share) for block, share in left.items()]


def of_named(parts: Sequence[Part], named: Sequence[FoundEffect]) -> tuple[Part, ...]:
    """`parts`, those of effects that are no longer `named` as unexplained."""
    names = {PARAMETERS, *(effect.name for effect in named)}
    return tuple(part if part.name in names else part._replace(name=UNEXPLAINED, coordinate="none") for part in parts)


def _of_parameters(off: Sequence[FoundEffect], taken: float) -> list[Part]:
    """What the parameters that are off take, for each block by itself, at the coordinate of its largest one."""
    ranked = sorted(off, key=lambda effect: -effect.share)
    first = {effect.block: effect.coordinate for effect in reversed(ranked)}
    whole = sum(effect.share for effect in off) or 1.0
    return [
        Part(PARAMETERS, block, place, taken * sum(effect.share for effect in off if effect.block == block) / whole)
        for block, place in first.items()
    ]


def blocks(parts: Sequence[Part], checked: bool, measured: bool) -> dict[str, float | None]:
    """Share of each of `BLOCKS` in the causes that are known best; None where the block's cut was impossible.

    That of the controller needs a command that could be `checked`, that of the drive a current that was `measured`.
    """
    impossible = {CONTROLLER: not checked, DRIVE: not measured}
    causes = causes_of(parts)
    whole = sum(part.share for part in causes)
    shares = dict.fromkeys(BLOCKS, 0.0)
    for part in causes:
        shares[part.block] += part.share / whole if whole else 0.0
    return {name: share if share or not impossible.get(name) else None for name, share in shares.items()}


def causes_of(parts: Sequence[Part]) -> list[Part]:
    """The named effects, and parameters that are none of the mechanics' own, which every machine has a little off.

    Where no effect is named, all parameters or the unexplained: whichever of the two is more.
    """
    effects = [part for part in parts if part.name not in (PARAMETERS, UNEXPLAINED)]
    of_parameters = [part for part in parts if part.name == PARAMETERS and part.share > 0.0]
    if effects:
        beside = [part for part in of_parameters if part.block != MECHANICS]
        return [*(part._replace(share=max(part.share, 1e-9)) for part in effects), *beside]
    unexplained = [part for part in parts if part.name == UNEXPLAINED]
    return max(unexplained, of_parameters, key=lambda causes: sum(part.share for part in causes))


def with_coordinates(parts: Sequence[Part], predicted: Sequence[Coordinate]) -> tuple[Coordinate, ...]:
    """Coordinates of the causes by their shares, next to what functions of single coordinates predict of the rest."""
    causes = [part for part in causes_of(parts) if part.name != UNEXPLAINED]
    rest = sum(part.share for part in parts if part.name == UNEXPLAINED)
    whole = sum(part.share for part in causes) + rest or 1.0
    shares = {item.name: rest / whole * item.share for item in predicted}
    for part in causes:
        if part.coordinate != "none":
            shares[part.coordinate] = shares.get(part.coordinate, 0.0) + part.share / whole
    return tuple(Coordinate(name, share) for name, share in sorted(shares.items(), key=lambda pair: -pair[1]))
