"""The friction family as a regression: each member is a few columns that are linear in its weights.

::

    F = J a + D v + offset + sum_j w_j c_j(theta)         w_j >= 0; theta is searched for (variable projection)

For each member this module defines its columns, and how weights and theta make a law that the plant can run.
The plant has no table and no creep: it gets the stop operators with the same curve from rest, and of the creep its
steady part ``k tau v``.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.compensation.derived import through
from stagectl.identification import thresholds
from stagectl.identification.capture import Array
from stagectl.identification.simultaneous.laws import SHAPE, bristle_columns, bundle_columns, lugre
from stagectl.identification.thresholds import FRICTION_ELEMENTS, TABLE_ROWS
from stagectl.kernels import friction, friction_bristle, friction_memory, friction_path, stage

FORCE, STIFFNESS, DAMPING = "N m | N", "N m/rad | N/m", "N m s/rad | N s/m"
LENGTH, SPEED = "rad | m", "rad/s | m/s"


class Searched(NamedTuple):
    """A parameter that is not linear, with its bounds; those of a length or a speed are shares of the motion's."""

    name: str
    unit: str
    low: float
    high: float


class Path(NamedTuple):
    """A filtered motion that a law runs along."""

    position: Array  # (n,) rad | m
    dt: float  # s


class Member(NamedTuple):
    """One law of the family."""

    words: str
    linear: tuple[tuple[str, str], ...]  # name and unit of each weight
    searched: tuple[Searched, ...]
    columns: Callable[[Path, Sequence[float]], Array]  # (n, k)
    plant: Callable[[Sequence[float], Sequence[float], float], stage.Friction]  # of weights, theta, shortest slip
    whole: bool = True  # the plant has all of it

    @property
    def size(self) -> int:
        """Parameters, with inertia, viscous friction and offset."""
        return 3 + len(self.linear) + len(self.searched)


# The unit of a length's bounds is an encoder step for the lower and the stroke for the upper one.
_LENGTHS = Searched("range", LENGTH, thresholds.SHORTEST_RANGE, thresholds.LONGEST_RANGE)
_SPEEDS = Searched("stribeck_velocity", SPEED, thresholds.SLOWEST_STRIBECK, thresholds.FASTEST_STRIBECK)
_RISE = Searched("stribeck_rise", "", 1e-3, 1.0)
NOTHING = friction.bundle([0.0], [1.0])


def _sign(path: Path) -> Array:
    """Direction (n, 1) of the last motion; 0 before any."""
    return _branches(path)[:, 1:2]


def _branches(path: Path) -> Array:
    """Way since the last reversal, direction, and 1 before the first reversal (n, 3)."""
    state = np.empty((len(path.position), 3))
    friction_path.branches(path.position, state)
    return state


def _stribeck_columns(path: Path, theta: Sequence[float]) -> Array:
    sign = _sign(path)
    speed = np.abs(np.diff(path.position, prepend=path.position[0])) / path.dt
    return np.column_stack([sign, sign[:, 0] * np.exp(-((speed / theta[0]) ** SHAPE))])


def _gms_columns(path: Path, theta: Sequence[float]) -> Array:
    return bundle_columns(*path, slips(theta[0]), friction.Stribeck(theta[1], theta[2], SHAPE))


def _rheology_columns(path: Path, theta: Sequence[float]) -> Array:
    p = friction_memory.Rheology(1.0, theta[0], theta[1], 1.0, theta[2])
    out = np.empty((len(path.position), 2))
    friction_path.rheology(p, path.position, path.dt, out)
    return out


def _table_columns(path: Path, theta: Sequence[float]) -> Array:
    """Column j rises from -1/2 to 1/2 between the rows j and j + 1 of the table; half of it, from 0, while virgin."""
    travelled, direction, virgin = _branches(path).T
    rows = nodes(theta[0])
    scale = 1.0 + virgin
    risen = np.clip((scale[:, None] * travelled[:, None] - rows[:-1]) / np.diff(rows), 0.0, 1.0)
    return np.asarray(direction[:, None] * np.where(virgin[:, None] > 0.0, 0.5 * risen, risen - 0.5))


def slips(longest: float) -> list[float]:
    """Slips of the elements (rad | m), spaced geometrically."""
    return [longest * thresholds.SLIP_SPREAD ** (j / (FRICTION_ELEMENTS - 1) - 1.0) for j in range(FRICTION_ELEMENTS)]


def nodes(longest: float) -> Array:
    """Displacements of the table's rows (rad | m): 0, and geometrically up to `longest`."""
    return np.concatenate([[0.0], np.geomspace(longest / thresholds.SLIP_SPREAD, longest, TABLE_ROWS)])


def _coulomb_plant(w: Sequence[float], theta: Sequence[float], slip: float) -> stage.Friction:
    return stage.Friction(friction.bundle([w[0]], [slip]), friction.Stribeck())


def _stribeck_plant(w: Sequence[float], theta: Sequence[float], slip: float) -> stage.Friction:
    rise = w[1] / w[0] if w[0] > 0.0 else 0.0
    return stage.Friction(friction.bundle([w[0]], [slip]), friction.Stribeck(rise, theta[0], SHAPE))


def _dahl_plant(w: Sequence[float], theta: Sequence[float], slip: float) -> stage.Friction:
    p = friction_bristle.Bristle(w[0], max(w[0], 1e-12) / theta[0], theta[1])
    return stage.Friction(NOTHING, friction.Stribeck(), p)


def _lugre_plant(w: Sequence[float], theta: Sequence[float], slip: float) -> stage.Friction:
    unit = lugre(theta)
    p = unit._replace(coulomb=w[0], stiffness=max(w[0], 1e-12) / theta[0], damping=w[1])
    return stage.Friction(NOTHING, friction.Stribeck(), p)


def _gms_plant(w: Sequence[float], theta: Sequence[float], slip: float) -> stage.Friction:
    return stage.Friction(friction.bundle(w, slips(theta[0])), friction.Stribeck(theta[1], theta[2], SHAPE))


def _rheology_plant(w: Sequence[float], theta: Sequence[float], slip: float) -> stage.Friction:
    p = friction_memory.Rheology(w[0], theta[0], theta[1])
    places = 0.5 * np.concatenate([[0.0], np.geomspace(1e-2, 1.0, 12)]) * theta[0]
    out = np.empty((len(places), 2))
    friction_path.rheology(p, places, 1.0, out)
    return stage.Friction(through(places, out[:, 0]), friction.Stribeck())


def _table_plant(w: Sequence[float], theta: Sequence[float], slip: float) -> stage.Friction:
    rows = nodes(theta[0])
    return stage.Friction(through(0.5 * rows, 0.5 * np.concatenate([[0.0], np.cumsum(w)])), friction.Stribeck())


COULOMB = ("coulomb", FORCE)
FAMILY: dict[str, Member] = {
    "coulomb-viscous": Member("Coulomb and viscous", (COULOMB,), (), lambda path, theta: _sign(path), _coulomb_plant),
    "stribeck": Member("Stribeck", (COULOMB, ("static_excess", FORCE)), (_SPEEDS,), _stribeck_columns, _stribeck_plant),
    "dahl": Member(
        "Dahl with exponent",
        (COULOMB,),
        (_LENGTHS, Searched("exponent", "", 0.3, 3.0)),
        lambda path, theta: bristle_columns(*path, friction_bristle.Bristle(1.0, 1.0 / theta[0], theta[1]))[:, :1],
        _dahl_plant,
    ),
    "lugre": Member(
        "LuGre",
        (COULOMB, ("bristle_damping", DAMPING)),
        (_LENGTHS, _RISE, _SPEEDS),
        lambda path, theta: bristle_columns(*path, lugre(theta)),
        _lugre_plant,
    ),
    "gms": Member(
        f"GMS, {FRICTION_ELEMENTS} elements",
        tuple((f"weight_{j + 1}", FORCE) for j in range(FRICTION_ELEMENTS)),
        (_LENGTHS, _RISE, _SPEEDS),
        _gms_columns,
        _gms_plant,
    ),
    "rheology": Member(
        "rheology (reconstruction)",
        (COULOMB, ("creep_stiffness", STIFFNESS)),
        (_LENGTHS, Searched("exponent", "", 1.05, 4.0), Searched("relaxation", "s", 0.02, 2.0)),
        _rheology_columns,
        _rheology_plant,
        whole=False,
    ),
    "table": Member(
        f"data-based table, {TABLE_ROWS} rows",
        tuple((f"rise_{j + 1}", FORCE) for j in range(TABLE_ROWS)),
        (_LENGTHS,),
        _table_columns,
        _table_plant,
        whole=False,
    ),
}
