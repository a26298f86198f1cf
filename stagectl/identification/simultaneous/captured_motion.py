"""All captures along their paths, through windows that hide an encoder's steps, and through those of the regression."""

from typing import NamedTuple

import numpy as np

from stagectl.identification.capture import Array
from stagectl.identification.simultaneous import friction_columns
from stagectl.identification.simultaneous.regressors import VELOCITY, Part, calm, motion


class Motion(NamedTuple):
    """All captures along their paths."""

    parts: list[Part]
    paths: list[friction_columns.Path]
    free: list[Array]  # (rows, FREE) of each
    shapes: friction_columns.Shapes
    gravity: bool


def quiet(parts: list[Part], gravity: bool) -> Motion:
    """The motion through windows that hide the encoder's steps."""
    calmed = [calm(p) for p in parts]
    free = [motion(p) for p in calmed]
    paths = [friction_columns.path(p, rows[:, VELOCITY]) for p, rows in zip(calmed, free, strict=True)]
    return Motion(calmed, paths, free, friction_columns.shapes(calmed, np.vstack(free)), gravity)


def resolved(calmed: Motion, parts: list[Part]) -> Motion:
    """The same motion with the rows of the `parts`."""
    paths = [x._replace(rows=friction_columns.path_rows(p)) for p, x in zip(parts, calmed.paths, strict=True)]
    free = [rows if p == c else motion(p) for p, c, rows in zip(parts, calmed.parts, calmed.free, strict=True)]
    return calmed._replace(parts=parts, paths=paths, free=free)
