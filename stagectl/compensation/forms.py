"""What the friction compensation may be computed from: the stage's own model, or a form of its own."""

from __future__ import annotations

from typing import Any, NamedTuple

from stagectl.compensation import zero_crossing


class Model(NamedTuple):
    """The stage's own friction: its stop operators run along the reference (`kernels.feedforward`)."""


# By the name in the stage file.  All but `model` have ``force(position (n,), velocity (n,), dt) -> (n,)``.
FORMS: dict[str, type[Any]] = {"model": Model, **zero_crossing.FORMS}
