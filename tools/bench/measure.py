"""What a benchmark's row is, and how contenders are timed: interleaved, so that a busy machine disturbs all alike."""

import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple


class Spread(NamedTuple):
    """A median with the quartiles around it."""

    low: float
    median: float
    high: float


class Wanted(NamedTuple):
    """The bound that the issue names."""

    bound: float
    at_least: bool


class Row(NamedTuple):
    """One line of the result."""

    what: str
    measured: Spread
    unit: str
    wanted: Wanted | None  # None: shown, not judged
    method: str

    @property
    def ratio(self) -> float | None:
        """How many times better than wanted; below 1 it is not met."""
        if self.wanted is None:
            return None
        share = self.measured.median / self.wanted.bound
        return share if self.wanted.at_least else 1.0 / share

    @property
    def verdict(self) -> str:
        """``met``, ``not met``, or nothing where nothing is wanted."""
        if self.ratio is None:
            return ""
        return "met" if self.ratio >= 1.0 else "not met"


class Against(NamedTuple):
    """Ours beside a peer's in one run: something of which less is better."""

    topic: str
    peer: str
    what: str
    ours: Spread
    theirs: Spread
    unit: str
    ratio: Spread  # theirs over ours, round by round: above 1 ours is the better one
    method: str


class Contender(NamedTuple):
    """Something that computes control periods when called."""

    name: str
    run: Callable[[], object]
    periods: int  # in one call


def spread(values: Sequence[float]) -> Spread:
    """Median and quartiles; of fewer than four values the extremes."""
    if len(values) < 4:
        return Spread(min(values), statistics.median(values), max(values))
    low, median, high = statistics.quantiles(values, n=4, method="inclusive")
    return Spread(low, median, high)


def interleaved(contenders: Sequence[Contender], rounds: int) -> dict[str, list[float]]:
    """Seconds per control period of each contender in each round; every round begins with another one."""
    for contender in contenders:
        contender.run()  # compiles, and warms the caches
    found: dict[str, list[float]] = {contender.name: [] for contender in contenders}
    for number in range(rounds):
        first = number % len(contenders)
        for contender in (*contenders[first:], *contenders[:first]):
            begin = time.perf_counter()
            contender.run()
            found[contender.name].append((time.perf_counter() - begin) / contender.periods)
    return found


def times_faster(ours: Sequence[float], theirs: Sequence[float]) -> Spread:
    """Spread of `theirs` over `ours`, round by round."""
    return spread([b / a for a, b in zip(ours, theirs, strict=True)])


def versus(
    label: tuple[str, str, str], values: tuple[Sequence[float], Sequence[float]], unit: tuple[str, float], method: str
) -> Against:
    """Ours and theirs, round by round; `label` = (topic, peer, what), `unit` with what the values are multiplied by."""
    topic, peer, what = label
    ours, theirs = values
    name, factor = unit
    shown = scaled(ours, factor), scaled(theirs, factor)
    return Against(topic, peer, what, *shown, name, times_faster(ours, theirs), method)


def scaled(values: Sequence[float], factor: float) -> Spread:
    """Spread of `values` in another unit."""
    return spread([factor * value for value in values])


def as_json(row: Row) -> dict[str, Any]:
    """The row with its ratio and verdict."""
    wanted = None if row.wanted is None else row.wanted._asdict()
    judged = {"ratio": row.ratio, "verdict": row.verdict}
    return {**row._asdict(), "measured": row.measured._asdict(), "wanted": wanted, **judged}
