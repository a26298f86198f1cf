"""What a caller may pass: quantities as numbers in SI or as text with a unit, layers, paths, and how progress shows."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar, overload

from stagectl.problem import meant
from stagectl.units import Quantity, StageError, UnitError, parse, unit_in

if TYPE_CHECKING:
    from rich.console import Console


LAYERS = ("ptc", "friction", "effects", "observer")  # that can be switched off
PathLike = str | os.PathLike[str]
Count = Annotated[int, Quantity("", "[1, inf)", "how many")]
Seed = Annotated[int | None, Quantity("", "[0, 2147483647]", "of what is drawn at random; none: the stage file's")]
Step = Annotated[float, Quantity("s", "(0, inf)", "time from one row to the next")]
Value = TypeVar("Value")


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
        degrees = f"; in degrees write '{value} deg'" if declared.unit == "rad" and not isinstance(value, str) else ""
        raise ArgumentError(name, value, f"; must lie in {declared.interval_in(unit)}{degrees}")
    return number


def switched_off(without: str | Iterable[str], compensator: str = "model") -> frozenset[str]:
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
                if "," in name:
                    each = " ".join(f"--without {one.strip()}" for one in name.split(","))
                    raise ArgumentError("without", name, f": name each by itself: {each}")
                raise ArgumentError("without", name, f": {meant(name, (*known, *answered()))}")
    return frozenset("friction" if name == compensator else name for name in names)


def paths_of(places: PathLike | Sequence[PathLike]) -> list[Path]:
    """One path or several as a list."""
    return [Path(places)] if isinstance(places, str | os.PathLike) else [Path(place) for place in places]


def entry(name: str, word: str, known: Mapping[str, Value]) -> Value:
    """What `known` holds under a `word`.  Raises ArgumentError with the nearest of its words, or all."""
    if word in known:
        return known[word]
    raise ArgumentError(name, word, f": {meant(word, list(known))}")


ProgressOption = bool | Callable[[float, float], object]  # True: a bar; a function of (steps done, steps in all)
Update = Callable[..., None]  # (done, total, title): the total and the title may change on the way
Say = Callable[[str], object]  # takes a message for the user


@contextmanager
def reported(option: ProgressOption, title: str, total: float) -> Iterator[Update]:
    """What a computation calls as it proceeds."""
    if option is True:
        with progress(title, total) as update:
            yield update
    elif option is False:
        yield lambda *_: None
    else:
        yield _without_title(option)


def _without_title(report: Callable[[float, float], object]) -> Update:
    def update(done: float, total: float, *_: str) -> None:
        report(done, total)

    return update


@contextmanager
def progress(title: str, total: float) -> Iterator[Update]:
    """A bar on standard error, with the time left."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=terminal()) as shown:
        task = shown.add_task(title, total=total)

        def update(done: float, total: float, words: str = title) -> None:
            shown.update(task, completed=done, total=total, description=words)

        yield update


@functools.cache
def terminal() -> Console:
    """The one console on standard error: messages and a bar on two of them would overwrite each other."""
    from rich.console import Console

    # Names and paths appear as they are, whatever brackets they hold.
    return Console(stderr=True, soft_wrap=True, highlight=False, markup=False)
