"""The compensators by their names: the stage's friction model, the ball-screw paper's, and the slider's forms."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from stagectl.compensation import rolling, zero_crossing
from stagectl.kernels import friction


class Model(NamedTuple):
    """The stage's own friction: its stop operators or its bristle, run along the reference (`kernels.feedforward`).

    The operators run without Stribeck's rise, and continue from motion to motion; `gms` has the rise, and begins at 0.
    """


# By the name in the stage file.  All but `model` have ``along(legs) -> (n,) N m | N``.
FORMS: dict[str, type[Any]] = {"model": Model, **rolling.FORMS, **zero_crossing.FORMS}


class Compensators(NamedTuple):
    """Compensators next to the one that acts: `compare` sets them against each other by their names."""

    table: rolling.ReversalTable | None = None
    gms: rolling.GeneralisedMaxwell | None = None
    rheology: rolling.RheologySpring | None = None
    exponential: zero_crossing.Exponential | None = None
    gaussian: zero_crossing.Gaussian | None = None
    displacement: zero_crossing.Displacement | None = None
    symmetric: zero_crossing.Symmetric | None = None


def recorded(name: str, entries: Mapping[str, Any]) -> Any:
    """The compensator `name` of a recording's entries (SI): numbers, lists of them, words, and Stribeck's block.

    Raises TypeError or ValueError where they do not fit.
    """
    values: dict[str, Any] = {key: tuple(map(float, x)) if isinstance(x, list) else x for key, x in entries.items()}
    if "stribeck" in values:
        values["stribeck"] = friction.Stribeck(**values["stribeck"])
    return FORMS[name](**{key: float(x) if isinstance(x, int) else x for key, x in values.items()})


def name_of(compensator: Any) -> str:
    """The name of a compensator."""
    return next(name for name, kind in FORMS.items() if isinstance(compensator, kind))


def named(name: str, acting: Any, compared: Compensators) -> Any:
    """The compensator `name`: the `acting` one, or one that is `compared`; None where the stage file holds none."""
    if name_of(acting) == name:
        return acting
    return Model() if name == "model" else getattr(compared, name)
