"""Lines of the exam's table: a value, its interval, the trials it is from, and what is asked of it."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from stagectl_studies.exam import intervals

Record = dict[str, Any]


class Asked(NamedTuple):
    """What a row must reach, and its target; `most`: the value is to stay below."""

    target: float | None = None
    must: float | None = None
    most: bool = False


class Row(NamedTuple):
    """One line of the table."""

    name: str
    value: float | None
    low: float | None
    high: float | None
    trials: int
    kind: str  # rate | mean | median
    target: float | None
    must: float | None
    most: bool
    reached: str  # target | must | no | "" where nothing is asked or nothing was counted


def rate(name: str, hits: Sequence[bool], asked: Asked = Asked()) -> Row:  # noqa: B008  an immutable default
    """A rate with its Wilson interval."""
    value = sum(hits) / len(hits) if hits else math.nan
    return _row(name, (value, *intervals.wilson(sum(hits), len(hits))), len(hits), "rate", asked)


def mean(name: str, values: Sequence[float], asked: Asked = Asked()) -> Row:  # noqa: B008
    """A mean with its interval."""
    return _row(name, intervals.mean(values), len(values), "mean", asked)


def median(name: str, values: Sequence[float], asked: Asked = Asked()) -> Row:  # noqa: B008
    """A median with its interval."""
    return _row(name, intervals.median(values), len(values), "median", asked)


def _row(name: str, interval: tuple[float, float, float], count: int, kind: str, asked: Asked) -> Row:
    value, low, high = (end if math.isfinite(end) else None for end in interval)
    return Row(name, value, low, high, count, kind, asked.target, asked.must, asked.most, _reached(value, asked))


def _reached(value: float | None, asked: Asked) -> str:
    if value is None or asked.must is None or asked.target is None:
        return ""
    side: Callable[[float], bool] = (lambda bound: value <= bound) if asked.most else (lambda bound: value >= bound)
    return "target" if side(asked.target) else "must" if side(asked.must) else "no"


def is_open(record: Record, factor: float = 1.0) -> bool:
    """Whether there is a gap to close: above so many floors, and not of another controller."""
    gap = record["gap"]
    return bool(record["truth"]["hidden"] != ["controller"] and gap["before"] > factor * gap["floor"])
