"""Values of a nominal.yaml, one by one: checked against unit and range; what stands in for a missing one is said."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

from stagectl.gap.logs.session import GapError
from stagectl.units import LINEAR, ROTARY, Quantity, quantity_of


class Block(NamedTuple):
    """One block of the file, and what has been said of it so far."""

    name: str
    values: dict[str, Any]
    place: Path
    kind: str  # rotary | linear
    said: list[str]  # grows: values that stand in for missing ones
    notes: list[str]  # grows

    def has(self, key: str) -> bool:
        """Whether there is a value; null is none."""
        return self.values.get(key) is not None

    def number(self, key: str, quantity: Quantity, default: float | None = None) -> float:
        """The number at `key`.

        Raises GapError where it is none, lies outside, or is missing and nothing stands in for it.
        """
        if not self.has(key):
            if default is None:
                raise GapError(f"{self._at(key)} is missing; must be a number{self._admissible(quantity)}")
            shown = "no limit" if math.isinf(default) else self._shown(default, quantity)
            self.said.append(f"{self.name}.{key} ({shown})")
            return default
        return self._checked(key, self.values[key], quantity)

    def whole(self, key: str, quantity: Quantity, default: int | None = None) -> int:
        """The whole number at `key`."""
        found = self.number(key, quantity, default)
        if found != round(found):
            raise GapError(f"{self._at(key)} = {found:g}; must be a whole number{self._admissible(quantity)}")
        return round(found)

    def numbers(self, key: str, quantity: Quantity) -> list[float]:
        """The list of numbers at `key`; empty where there is none."""
        found = self.values.get(key)
        if found is None:
            return []
        if not isinstance(found, list):
            raise GapError(f"{self._at(key)} = {found!r}; must be a list of numbers{self._admissible(quantity)}")
        return [self._checked(f"{key}[{j}]", value, quantity) for j, value in enumerate(found)]

    def word(self, key: str, admitted: Sequence[str], default: str) -> str:
        """The one of `admitted` that the text at `key` begins with."""
        text = self.values.get(key)
        if text is None:
            self.said.append(f"{self.name}.{key} ({default})")
            return default
        found = next((one for one in admitted if str(text).strip().lower().startswith(one)), None)
        if found is None:
            raise GapError(f"{self._at(key)} = {text!r}; must be (or begin with) one of {', '.join(admitted)}")
        return found

    def block(self, key: str) -> Block:
        """The block within this one; empty where there is none."""
        return block(self.values, key, self, f"{self.name}.{key}")

    def ignore_others(self, known: Iterable[str]) -> None:
        """Say which keys are not understood, with the nearest one that is."""
        names = list(known)
        for key in self.values:
            if key not in names:
                near = difflib.get_close_matches(str(key), names, 1)
                meant = f"; did you mean {near[0]}?" if near else ""
                self.notes.append(f"{self.name}.{key} of {self.place.name} is not known and has no effect{meant}")

    def refused(self, key: str, why: str) -> GapError:
        """An error that names the key, its value and the file."""
        return GapError(f"{self._at(key)} = {self.values.get(key)!r}; {why}")

    def _checked(self, key: str, value: Any, quantity: Quantity) -> float:
        try:
            number = math.nan if isinstance(value, bool) else float(value)
        except (TypeError, ValueError):
            number = math.nan
        if not quantity.admits(number):
            raise GapError(f"{self._at(key)} = {value!r}; must be a number{self._admissible(quantity)}")
        return number

    def _admissible(self, quantity: Quantity) -> str:
        unit = quantity.unit_for(self.kind)
        return f" in {quantity.interval}{' ' + unit if unit else ''}: {quantity.meaning}"

    def _shown(self, value: float, quantity: Quantity) -> str:
        return f"{value:g} {quantity.unit_for(self.kind)}".strip()

    def _at(self, key: str) -> str:
        return f"{self.place}: {self.name}.{key}"


def block(values: dict[str, Any], key: str, like: Block, name: str) -> Block:
    """The block `key` of `values`.

    Raises GapError where something else than a block stands there.
    """
    found = values.get(key)
    if found is not None and not isinstance(found, dict):
        raise GapError(f"{like.place}: {name} = {found!r}; must be a block of `key: value`")
    return like._replace(name=name, values=found or {})


def of_file(nominal: dict[str, Any], place: Path, kind: str) -> Block:
    """The whole file as a block; `kind` is rotary or linear."""
    assert kind in (ROTARY, LINEAR)
    return Block("", nominal, place, kind, [], [])


def quantity(block_type: type, field: str) -> Quantity:
    """Unit, range and meaning that a parameter block declares beside a field."""
    found = quantity_of(get_type_hints(block_type, include_extras=True)[field])
    assert found is not None
    return found
