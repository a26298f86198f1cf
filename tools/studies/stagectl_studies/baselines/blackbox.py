"""Boosted trees on what the nominal simulator leaves: how far the gap closes if no one asks why.

Learnt is the position that the nominal closed loop lacks, over speed, displacement since the last reversal, position,
position modulo the pitch, acceleration, current and session clock, all of the simulated run, now and some milliseconds
before.  Nothing measured of a held-out run enters its prediction.
"""

import numpy as np

from stagectl.gap.logs.session import Array, GapError, Log, Session
from stagectl.gap.validation import rollouts
from stagectl.gap.validation.rollouts import column
from stagectl_studies.baselines.baseline_common import Answer, Ground

LAGS = (0, 4, 16, 64)  # control periods
EVERY = 2  # samples that are learnt from
SEED = 20100


def blackbox(g: Ground) -> Answer:
    """Predictions of the held-out runs; no model, and no name.

    Raises GapError where scikit-learn is not installed.
    """
    try:
        from sklearn.ensemble import HistGradientBoostingRegressor
    except ImportError as error:
        raise GapError("the black box needs scikit-learn: pip install 'stagectl[exam]'") from error
    session = g.session
    training = [log for log in session.logs if not log.held_out]
    held = [log for log in session.logs if log.held_out]
    simulated = rollouts.simulated_logs(session, session.stage, [*training, *held])
    known = simulated[: len(training)]
    pairs = zip(training, known, strict=True)
    x = np.concatenate([features(session, log, rows)[::EVERY] for log, rows in pairs])
    y = np.concatenate([_lacking(log, rows)[::EVERY] for log, rows in zip(training, known, strict=True)])
    scale = float(np.std(y)) or 1.0
    trees = HistGradientBoostingRegressor(max_iter=300, learning_rate=0.08, max_leaf_nodes=63, random_state=SEED)
    trees.fit(x, y / scale)
    models = []
    for log, rows in zip(held, simulated[len(training) :], strict=True):
        learnt: Array = scale * np.asarray(trees.predict(features(session, log, rows)), dtype=np.float64)
        models.append(column(rows, "measured")[: log.rows] + learnt)
    return Answer((), None, predicted=tuple(models))


def _lacking(log: Log, rows: Array) -> Array:
    return np.asarray(log.position - column(rows, "measured")[: log.rows])


def features(session: Session, log: Log, rows: Array) -> Array:
    """(n, f) of one simulated run."""
    position, current = column(rows, "measured")[: log.rows], column(rows, "measured_current")[: log.rows]
    speed = np.gradient(position, session.dt)
    since = since_reversal(position, speed)
    moving = [speed, since, current, np.gradient(speed, session.dt)]
    pitch = session.stage.mechanics.pitch
    still = [position, np.mod(position, pitch) if pitch else position, log.start + session.dt * np.arange(log.rows)]
    return np.stack([*(_late(curve, lag) for curve in moving for lag in LAGS), *still], axis=1)


def since_reversal(position: Array, speed: Array) -> Array:
    """Displacement since the speed last changed its sign, (n,)."""
    turned = np.flatnonzero(np.diff(np.sign(speed)) != 0.0) + 1
    last = np.zeros(len(position), dtype=np.int64)
    last[turned] = turned
    since: Array = position - position[np.maximum.accumulate(last)]
    return since


def _late(signal: Array, lag: int) -> Array:
    return np.concatenate([np.full(lag, signal[0]), signal[: len(signal) - lag]])
