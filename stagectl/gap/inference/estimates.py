"""Parameters of the model as fitted, with their common errors."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stagectl.gap.inference import cable_centre
from stagectl.gap.inference.value_errors import Errors
from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals import friction_family, least_squares
from stagectl.gap.selection import bristle_members, refine
from stagectl.gap.selection.priors import WEIGHT
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels import stage


class Estimate(NamedTuple):
    """A parameter as fitted, SI."""

    value: float
    nominal: float
    deviation: float  # standard
    scale: float  # to which its change is relative
    prior: float  # standard deviation around the nominal value before the data
    larger: float = 0.0  # by how much the value may be larger besides, and not smaller


class Joint(NamedTuple):
    """Estimates with their common errors."""

    estimates: Mapping[str, Estimate]
    matrix: Array  # (n, n) their mean square errors, in this order

    def given(self, name: str, others: Sequence[str]) -> Estimate:
        """The estimate of `name` where `others` are at their nominal values."""
        names, estimate = list(self.estimates), self.estimates[name]
        fixed = [other for other in others if other in names]
        own, places = names.index(name), [names.index(other) for other in fixed]
        back = np.array([self.estimates[other].value - self.estimates[other].nominal for other in fixed])
        slope = self.matrix[own, places] @ least_squares.inverse(self.matrix[np.ix_(places, places)])
        variance = self.matrix[own, own] - slope @ self.matrix[places, own]
        return estimate._replace(
            value=estimate.value - float(slope @ back), deviation=float(np.sqrt(max(variance, 0.0)))
        )


def estimates(session: Session, e: Evidence, now: Fitted, known: Errors) -> Joint:
    """Values of the parameters whose errors are known; a spring's centre may be what a bias seems to be."""
    p, q, delay = session.stage, now.model.stage, [whole_delay(p, session.dt) for p in (now.model.stage, session.stage)]
    values = {
        "inertia": (q.mechanics.inertia, p.mechanics.inertia, p.mechanics.inertia),
        "viscous": (q.mechanics.viscous, p.mechanics.viscous, p.mechanics.viscous or max(q.mechanics.viscous, 1e-300)),
        "bias": (q.mechanics.bias, p.mechanics.bias, _friction_unit(session, now)),
        "time_shift": (now.model.shift, 0.0, session.dt),
        "dead_time": (*delay, session.dt),
        "coulomb": (stage.sliding(q.friction), stage.sliding(p.friction), _friction_unit(session, now)),
    }
    rows = {name: _functional(name, known.names, p.friction.bristle.coulomb) for name in values}
    names = [name for name, row in rows.items() if name == "coulomb" or row.any()]
    of_columns = np.array([rows[name] for name in names])
    of_centre = [cable_centre.reach(now) if name == cable_centre.BIAS else 0.0 for name in names]
    matrix = of_columns @ known.matrix @ of_columns.T + np.diag(np.square(of_centre))
    deviation = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    estimate = {}
    before = _width(of_columns, e, known.names)
    parts = zip(names, deviation.tolist(), before.tolist(), (of_columns @ known.larger).tolist(), strict=True)
    for name, spread, prior, larger in parts:
        value, nominal, scale = values[name]
        estimate[name] = Estimate(value, nominal, spread, scale, prior, larger)
    return Joint(estimate, matrix)


def _width(of_columns: Array, e: Evidence, columns: Sequence[str]) -> Array:
    """(n,) Standard deviation before the data of sums (n, k) of `columns`: a friction has that of all its forces."""
    base = set(refine.moving(e))
    each = [e.base.prior.width(name) if name in base else 0.0 for name in columns]
    width: Array = np.hypot.reduce(of_columns * np.array(each), axis=1)
    return width


def whole_delay(p: stage.Stage, dt: float) -> float:
    """From a command to the current of the drive (s): whole periods `dt` (s), dead time and current loop."""
    return p.drive.delay_samples * dt + p.drive.dead_time + p.drive.current_lag


def _friction_unit(session: Session, now: Fitted) -> float:
    """The friction (N m | N) to which a change is relative: the nominal one, or where there is none the fitted one."""
    nominal = stage.sliding(session.stage.friction)
    return nominal or max(stage.sliding(now.model.stage.friction), friction_family.size(session.stage))


def _functional(name: str, columns: Sequence[str], bristle: float) -> Array:
    """(k,) What gives the parameter `name` from the amplitudes of `columns`: one of them, or the sum of all forces.

    The amplitude of the nominal bristle is a share of its force `bristle` (N m | N).
    """
    if name == "coulomb":
        forces = [float(column.startswith(WEIGHT) or bristle_members.is_member(column)) for column in columns]
        return np.array([bristle if columns[k] == "bristle_size" else force for k, force in enumerate(forces)])
    return np.array([column == name for column in columns], float)
