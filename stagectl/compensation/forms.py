"""The sources of the friction compensation: the stage's friction model, or a fitted form."""

from __future__ import annotations

from typing import Any, NamedTuple

from stagectl.compensation import zero_crossing


class Model(NamedTuple):
    """The stage's own friction: its stop operators run along the reference (`kernels.feedforward`)."""


# By the name in the stage file.  All but `model` have ``along(legs) -> (n,) N m | N``.
FORMS: dict[str, type[Any]] = {"model": Model, **zero_crossing.FORMS}
