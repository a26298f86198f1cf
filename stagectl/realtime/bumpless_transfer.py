"""What keeps the current from jumping when something else than time moves on: gains, or the origin of the positions.

A new law takes over with the current that the old one would give in this period: its integral makes up for the
difference (bumpless transfer; Astrom and Hagglund, Advanced PID Control, section 3.5, tracking at one instant).
"""

from collections.abc import Iterator
from typing import Any

from stagectl.kernels import law


def transferred(old: law.Law, new: law.Law, x: law.State, asked: law.Setpoint, measured: float) -> law.State:
    """The state with which `new` gives, for this period, the command that `old` would give in state `x`."""
    same_kind = old.cascaded == new.cascaded
    start = x if same_kind else law.AT_REST._replace(observer=x.observer)
    if asked.closed == 0.0:
        return start
    before, _ = law.step(old, x, asked, measured)
    return _carrying(new, start, asked, measured, before.command)


def loaded(p: law.Law, asked: law.Setpoint, measured: float, current: float) -> law.State:
    """At rest, with an integral that carries the axis with `current` (A): that of gravity as a brake is released."""
    return law.AT_REST if current == 0.0 else _carrying(p, law.AT_REST, asked, measured, current)


def _carrying(p: law.Law, start: law.State, asked: law.Setpoint, measured: float, current: float) -> law.State:
    """The state `start` with an integral that makes the command of this period `current` (A)."""
    after, _ = law.step(p, start, asked, measured)
    return law.carrying(start, current - after.command)


def shifted(x: law.State, by: float) -> law.State:
    """The same state where every position is smaller by `by` (rad | m): the origin has moved."""
    outer, seen = x.cascade, x.observer
    return x._replace(
        cascade=outer._replace(last=outer.last - by, before=outer.before - by),
        observer=seen._replace(position=seen.position - by),
    )


def flattened(block: Any) -> Iterator[float]:
    """The numbers of a block of parameters in order, for a place that holds only numbers."""
    for value in block:
        if hasattr(value, "_fields"):
            yield from flattened(value)
        else:
            yield float(value)


def rebuilt(like: Any, numbers: Iterator[float]) -> Any:
    """A block of the kind of `like` from its `flattened` numbers; whole and true-or-false values stay what they are."""
    return type(like)(
        *(rebuilt(value, numbers) if hasattr(value, "_fields") else type(value)(next(numbers)) for value in like)
    )
