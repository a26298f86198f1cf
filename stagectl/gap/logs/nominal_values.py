"""Values of a nominal.yaml, one by one: checked against unit and range; defaults for missing ones are noted."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

from stagectl.gap.logs.session import NominalValueError
from stagectl.problem import below, nearest
from stagectl.recording.scales import number_in
from stagectl.units import LINEAR, ROTARY, Quantity, quantity_of


class Block(NamedTuple):
    """One block of the file, with the notes made while it is read."""

    name: str
    values: dict[str, Any]
    place: Path
    kind: str  # rotary | linear
    defaults: list[str]  # grows: missing values, with the defaults taken for them
    notes: list[str]  # grows

    def has(self, key: str) -> bool:
        """Whether there is a value; null is none."""
        return self.values.get(key) is not None

    def number(self, key: str, quantity: Quantity, default: float | None = None) -> float:
        """The number at `key`.

        Raises NominalValueError where it is no number, lies outside its range, or is missing and has no default.
        """
        if not self.has(key):
            if default is None:
                raise self.refused(key, f"must be a number{self._admissible(quantity)}")
            shown = "no limit" if math.isinf(default) else f"{default:g} {quantity.unit_for(self.kind)}".strip()
            self.defaults.append(f"{self.name}.{key} ({shown})")
            return default
        return self._checked(key, self.values[key], quantity)

    def fields(self, kind: type, *required: str, **defaults: float) -> list[float]:
        """The numbers at the fields of a parameter block: those that are `required`, then those with `defaults`."""
        given: dict[str, float | None] = {**dict.fromkeys(required), **defaults}
        return [self.number(name, quantity(kind, name), default) for name, default in given.items()]

    def whole(self, key: str, quantity: Quantity, default: int | None = None) -> int:
        """The whole number at `key`."""
        value = self.number(key, quantity, default)
        if value != round(value):
            raise self.refused(key, f"must be a whole number{self._admissible(quantity)}")
        return round(value)

    def numbers(self, key: str, quantity: Quantity) -> list[float]:
        """The list of numbers at `key`; empty where there is none."""
        values = self.values.get(key)
        if values is None:
            return []
        if not isinstance(values, list):
            raise self.refused(key, f"must be a list of numbers{self._admissible(quantity)}")
        return [self._checked(f"{key}[{j}]", value, quantity) for j, value in enumerate(values)]

    def word(self, key: str, admitted: Sequence[str], default: str) -> str:
        """The one of `admitted` with which the text at `key` begins."""
        text = self.values.get(key)
        if text is None:
            self.defaults.append(f"{self.name}.{key} ({default})")
            return default
        word = next((word for word in admitted if str(text).strip().lower().startswith(word)), None)
        if word is None:
            raise self.refused(key, f"must be (or begin with) one of {', '.join(admitted)}")
        return word

    def block(self, key: str) -> Block:
        """The block within this one; empty where there is none.

        Raises NominalValueError where the key holds something else.
        """
        name, inner = below(self.name, key), self.values.get(key)
        if inner is not None and not isinstance(inner, dict):
            raise NominalValueError(self.place, name, inner, "must be a block of `key: value`")
        return self._replace(name=name, values=inner or {})

    def ignore_others(self, known: Iterable[str]) -> None:
        """Note all keys that are not `known`, each with the nearest known one."""
        names = list(known)
        for key in self.values:
            if key not in names:
                self.notes.append(unknown_key(str(key), below(self.name, key), self.place.name, names))

    def refused(self, key: str, rule: str) -> NominalValueError:
        """An error that names the file, the key, its value and the `rule` for it."""
        return NominalValueError(self.place, f"{self.name}.{key}", self.values.get(key), rule)

    def _checked(self, key: str, value: Any, quantity: Quantity) -> float:
        number = number_in(value)
        if not quantity.admits(number):
            rule = f"must be a number{self._admissible(quantity)}"
            raise NominalValueError(self.place, f"{self.name}.{key}", value, rule)
        return number

    def _admissible(self, quantity: Quantity) -> str:
        unit = quantity.unit_for(self.kind)
        return f" in {quantity.interval}{' ' + unit if unit else ''}: {quantity.meaning}"


def of_file(nominal: dict[str, Any], place: Path, kind: str) -> Block:
    """The whole file as a block; `kind` is rotary or linear."""
    assert kind in (ROTARY, LINEAR)
    return Block("", nominal, place, kind, [], [])


def unknown_key(key: str, shown: str, place: str, known: Sequence[str]) -> str:
    """The note on a `key`, `shown` in its place, that is none of the `known` ones."""
    near = nearest(key, known)
    return f"{shown} of {place} is not known and has no effect{f'; did you mean {near}?' if near else ''}"


def quantity(block_type: type, field: str) -> Quantity:
    """Unit, range and meaning that a parameter block declares for a field."""
    declared = quantity_of(get_type_hints(block_type, include_extras=True)[field])
    assert declared is not None
    return declared
