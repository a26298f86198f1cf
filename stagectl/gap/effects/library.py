"""The library: every effect by its name, and what the records say of several of them."""

import functools
import operator
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from stagectl.compensation import model_effects
from stagectl.gap.effects import drive, friction, mechanics
from stagectl.gap.effects.effect import Data, Definition, Effect, Scales, definition
from stagectl.gap.logs.session import GapError
from stagectl.kernels.fields import get
from stagectl.kernels.stage import Stage
from stagectl.problem import meant

_PARAMETERS = {name: of for part in (mechanics, drive, friction) for name, of in part.PARAMETERS.items()}


def _effect(name: str, record: dict[str, Any]) -> Effect:
    """The effect of one record; raises TypeError where that has an entry that `Effect` does not know."""
    fields: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in record.items()}
    fields.setdefault("label", name.replace("_", " "))
    if "coordinate" not in fields:
        fields["coordinate"] = fields["seen_over"][0]
    fields["look_alikes"] = {other: _data(names) for other, names in record.get("look_alikes", {}).items()}
    return Effect(name, parameters=_PARAMETERS.get(name), **fields)


def _data(names: Sequence[str]) -> Data:
    return functools.reduce(operator.or_, (Data[name.upper()] for name in names))


_RECORDS = tomllib.loads((Path(__file__).parent / "effects.toml").read_text(encoding="utf-8"))
EFFECTS: Mapping[str, Effect] = {name: _effect(name, record) for name, record in _RECORDS.items()}
FORCE_SCALED = tuple(effect.name for effect in EFFECTS.values() if effect.force_scaled)
_COORDINATES: Mapping[str, str] = {
    "displacement_since_reversal": "displacement since the reversal",
    "position_mod_pitch": "position modulo the pitch",
    "none": "no coordinate",
}


def definitions(scales: Scales) -> list[Definition]:
    """All effects that can be searched for on a machine of these sizes."""
    known = (definition(effect, scales) for effect in EFFECTS.values() if not effect.nominal)
    return [effect for effect in known if effect is not None]


def answered() -> tuple[str, ...]:
    """The effects that a controller answers along the reference, once its model has them: by a current, or a map."""
    known = (effect for effect in EFFECTS.values() if not effect.nominal)
    return tuple(effect.name for effect in known if effect.answer in ("current", "map"))


def left_out(p: Stage, names: Iterable[str]) -> Stage:
    """The stage model without these effects."""
    return model_effects.without(p, [place for name in sorted(names) for place in EFFECTS[name].places])


def absent(p: Stage, names: Iterable[str]) -> list[str]:
    """Those of the effects that a controller answers which this model does not have."""
    return [name for name in names if name in answered() and not _holds(p, name)]


def _holds(p: Stage, name: str) -> bool:
    known = left_out(p, [name])
    return any(get(p, place) != get(known, place) for place in EFFECTS[name].places)


def label(name: str) -> str:
    """``viscous asymmetry`` for ``viscous_asymmetry``; a name that is not in the library with blanks."""
    effect = EFFECTS.get(name)
    return effect.label if effect else name.replace("_", " ")


def coordinate_label(name: str) -> str:
    """``position modulo the pitch`` for ``position_mod_pitch``."""
    return _COORDINATES.get(name, name.replace("_", " "))


def look_alikes(name: str, data: Data) -> tuple[str, ...]:
    """Effects that such `data` show as they show effect `name`, in the order of its record."""
    return tuple(other for other, where in EFFECTS[name].look_alikes.items() if where & data)


def excited_by(experiment: str) -> tuple[str, ...]:
    """Effects that an experiment of this name, or of this family, excites."""
    return tuple(effect.name for effect in EFFECTS.values() if experiment in effect.experiments)


def excluded(words: Sequence[str]) -> tuple[str, ...]:
    """Names from ``--exclude a,b --exclude c``.  Raises UnknownEffectError."""
    names = tuple(name.strip() for word in words for name in word.split(",") if name.strip())
    for name in names:
        if name not in EFFECTS:
            raise UnknownEffectError(name)
    return names


class UnknownEffectError(GapError):
    """`value` of an option is not the name of an effect; `range` holds the names that are."""

    def __init__(self, value: str) -> None:
        self.reason = f": not an effect; {meant(value, tuple(EFFECTS))}"
        super().__init__(f"{value}{self.reason}")
        self.value, self.range = value, tuple(EFFECTS)
