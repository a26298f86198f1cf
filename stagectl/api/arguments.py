"""What a caller may pass: quantities as numbers in SI or as text with a unit, names of layers, paths."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import overload

from stagectl.units import Quantity, StageError, UnitError, parse, unit_in

LAYERS = ("ptc", "friction", "effects", "observer")  # that can be switched off
PathLike = str | os.PathLike[str]


class ArgumentError(StageError):
    """An argument that cannot be used: its `name`, the `value` that was passed, and the `reason`.

    `needs` names another argument without which it has no meaning, if that is the reason.
    """

    def __init__(self, name: str, value: object, reason: str, needs: str = "") -> None:
        super().__init__(f"{name} {value}{reason}")
        self.name, self.value, self.reason, self.needs = name, value, reason, needs


@overload
def quantity(name: str, value: float | str, declared: Quantity, example: str) -> float: ...


@overload
def quantity(name: str, value: None, declared: Quantity, example: str) -> None: ...


def quantity(name: str, value: float | str | None, declared: Quantity, example: str) -> float | None:
    """`value` in SI: a number is in SI already, a text carries its unit.

    Raises ArgumentError where the unit does not fit or the value is outside its interval.
    """
    if value is None:
        return None
    try:
        number = parse(value, declared.unit) if isinstance(value, str) else float(value)
    except UnitError as error:
        raise ArgumentError(name, value, f": {error}; write {example}") from error
    if not declared.admits(number):
        unit = unit_in(value) if isinstance(value, str) else declared.unit
        raise ArgumentError(name, value, f"; must lie in {declared.interval_in(unit)}")
    return number


def switched_off(without: Iterable[str], compensator: str = "model") -> frozenset[str]:
    """The layers and effects that are switched off; the `compensator` that acts is the layer ``friction``.

    Raises ArgumentError where there is no such layer, or a compensator does not act.
    """
    names = [without] if isinstance(without, str) else list(without)
    known = (*LAYERS, compensator)
    unknown = [name for name in names if name not in known]
    if unknown:
        from stagectl.gap.effects.library import answered

        for name in unknown:
            if name not in answered():
                raise ArgumentError("without", name, f"; must be one of {', '.join((*known, *answered()))}")
    return frozenset("friction" if name == compensator else name for name in names)


def paths_of(places: PathLike | Sequence[PathLike]) -> list[Path]:
    """One path or several as a list."""
    return [Path(places)] if isinstance(places, str | os.PathLike) else [Path(place) for place in places]
