"""How far the gap closes, and which share of it each part of the answer takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from stagectl.gap import columns, shrink
from stagectl.gap.candidates import equipped
from stagectl.gap.columns import Model
from stagectl.gap.found import NOISE, UNEXPLAINED, Gap, Trace
from stagectl.gap.refine import Evidence
from stagectl.gap.runs import by_experiment, runs
from stagectl.gap.search import Selected
from stagectl.gap.session import Log, Session
from stagectl.kernels.stage import Stage

OPEN = 5.0  # times the floor; of 72 machines without an effect, 24 with another law of friction, none was beyond 2.3
HALF = 0.5  # of the closable gap: less is closed for sure


class Told(NamedTuple):
    """The gap before and after, and who takes which share of it."""

    gap: Gap
    gaps: dict[str, Gap]
    shares: dict[str, float]  # of the squared gap before; with the floor they sum to one
    traces: list[Trace]
    open: bool = False  # whether the loop says that something is missing


def told(session: Session, e: Evidence, selected: Selected, improved: Stage) -> Told:
    """Of the held-out runs, or of all where none is: in closed loop where it is known, else along the path."""
    judged = [log for log in session.logs if log.held_out] or [log for log in session.logs if not log.held_out]
    if session.law is None or any(log.setpoints is None for log in judged):
        return along_the_path(session, e, selected, improved, judged)
    found = closed(session, e, selected, improved, judged)
    return found._replace(open=stays_open(found.gap, judged))


def closed(session: Session, e: Evidence, selected: Selected, improved: Stage, judged: Sequence[Log]) -> Told:
    """The gap of the held-out runs in closed loop."""
    now, nominal = selected.fitted, columns.model_of(session, session.stage)
    before, after = (shrink.predicted(session, p, judged) for p in (session.stage, improved))
    training = [log for log in session.logs if not log.held_out]
    inside = [shrink.predicted(session, p, training) for p in (session.stage, improved)]
    counted, known = shrink.counted(session, judged), shrink.counted(session, training)
    found = {}
    for channel in shrink.CHANNELS:
        unit = "A" if channel == "current" else ("m" if session.kind == "linear" else "rad")
        first, last = (shrink.squares(known, rows, channel) for rows in inside)
        expected = shrink.gap(first, last, shrink.floor(known, inside[1], channel), unit).closure
        first, last = (shrink.squares(counted, rows, channel) for rows in (before, after))
        found[channel] = shrink.gap(first, last, shrink.floor(counted, after, channel), unit, expected)
    position = found.pop("position")

    def remaining(members: frozenset[str]) -> float:
        model = now.model if "parameters" in members else nominal
        stage = equipped(model, [one for one in now.effects if one.effect.name in members]).stage
        return shrink.remaining(counted, shrink.predicted(session, stage, judged))

    players = ["parameters", *(one.effect.name for one in now.effects)]
    shares = _shares(shrink.shapley(players, remaining), position)
    if session.logs[0].current is None:
        found.pop("current")
    traces = shrink.traces([one.log for one in counted], before, after, position.floor, session.dt)
    return Told(position, found, shares, traces)


def stays_open(gap: Gap, judged: Sequence[Log]) -> bool:
    """Whether the loop says that something is missing: a gap far above the floor of which surely less than half closes.

    What is left along the measured path may lie within the form of friction, and no coordinate order it.  Never where
    one of the `judged` runs was not repeated, or copied: the floor is not known then, and noise is no gap.
    """
    repeated = gap.floor > 0.0 and all(len(one) > 1 for one in by_experiment(judged).values())
    return repeated and gap.after > OPEN * gap.floor and gap.high < HALF


def _shares(taken: dict[str, float], gap: Gap) -> dict[str, float]:
    """Shares of the squared gap before: parameters, effects, what is left, what repeats differ by."""
    count = sum(taken.values())
    whole = gap.before**2
    scale = (gap.before**2 - gap.after**2) / count if abs(count) > 0.0 else 0.0
    noise = min(gap.floor**2 / whole, 1.0) if whole > 0.0 else 1.0
    shares = (
        {name: value * scale / whole for name, value in taken.items()} if whole > 0.0 else dict.fromkeys(taken, 0.0)
    )
    return {**shares, UNEXPLAINED: 1.0 - noise - sum(shares.values()), NOISE: noise}


def along_the_path(session: Session, e: Evidence, selected: Selected, improved: Stage, judged: Sequence[Log]) -> Told:
    """The gap of the effort along the measured path, where no loop can be simulated."""
    now, dt = selected.fitted, session.dt
    held = bool(judged and judged[0].held_out)
    paths = runs(session, held)
    unit = "N" if session.kind == "linear" else "N m"

    def left(model: Model) -> shrink.Squares:
        return shrink.effort(model, paths, e.base.noise, dt)

    nominal = columns.model_of(session, session.stage)
    after = left(now.model._replace(stage=improved))
    least = shrink.effort_floor(now.model, paths, e.base.noise, dt)
    gap = shrink.gap(left(nominal), after, least, unit)

    def remaining(members: frozenset[str]) -> float:
        model = now.model if "parameters" in members else nominal
        return float(left(equipped(model, [one for one in now.effects if one.effect.name in members])).gap.sum())

    players = ["parameters", *(one.effect.name for one in now.effects)]
    shares = _shares(shrink.shapley(players, remaining), gap)
    return Told(gap, {}, shares, [])
