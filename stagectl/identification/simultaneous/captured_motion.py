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
    straight = [motion(p) for p in calmed]
    paths = [friction_columns.path(p, rows[:, VELOCITY]) for p, rows in zip(calmed, straight, strict=True)]
    free = [_bending(rows, x) for rows, x in zip(straight, paths, strict=True)]
    return Motion(calmed, paths, free, friction_columns.shapes(calmed, np.vstack(free)), gravity)


def resolved(calmed: Motion, parts: list[Part]) -> Motion:
    """The same motion with the rows of the `parts`."""
    paths = [x._replace(rows=friction_columns.path_rows(p)) for p, x in zip(parts, calmed.paths, strict=True)]
    before = zip(parts, paths, calmed.parts, calmed.free, strict=True)
    free = [rows if p == c else _bending(motion(p), x) for p, x, c, rows in before]
    return calmed._replace(parts=parts, paths=paths, free=free)


def _bending(straight: Array, along: friction_columns.Path) -> Array:
    """Columns (rows, FREE) from those that are straight in the speed: the speed of the path hides no encoder step."""
    speed = along.velocity
    return np.column_stack([straight, along.smoothed(np.array([speed * np.abs(speed), speed**3])).T])
