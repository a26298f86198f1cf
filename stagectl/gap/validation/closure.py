"""How far the gap closes, and which share of it each part of the answer takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from stagectl.gap.logs.session import Log, Session
from stagectl.gap.residuals import sensitivities
from stagectl.gap.residuals.half_strokes import by_experiment, runs
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.result.diagnosis import NOISE, UNEXPLAINED, Gap, Trace
from stagectl.gap.selection.candidates import equipped
from stagectl.gap.selection.refine import Evidence
from stagectl.gap.selection.swap_tests import Selection
from stagectl.gap.validation import held_out_gap
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


def told(session: Session, e: Evidence, selected: Selection, improved: Stage) -> Told:
    """Of the held-out runs, or of all where none is: in closed loop where it is known, else along the path."""
    judged = [log for log in session.logs if log.held_out] or [log for log in session.logs if not log.held_out]
    if session.law is None or any(log.setpoints is None for log in judged):
        return along_the_path(session, e, selected, improved, judged)
    found = closed(session, e, selected, improved, judged)
    return found._replace(open=stays_open(found.gap, judged))


def closed(session: Session, e: Evidence, selected: Selection, improved: Stage, judged: Sequence[Log]) -> Told:
    """The gap of the held-out runs in closed loop."""
    now, nominal = selected.fitted, sensitivities.model_of(session, session.stage)
    before, after = (held_out_gap.predicted(session, p, judged) for p in (session.stage, improved))
    training = [log for log in session.logs if not log.held_out]
    inside = [held_out_gap.predicted(session, p, training) for p in (session.stage, improved)]
    counted, known = held_out_gap.counted(session, judged), held_out_gap.counted(session, training)
    found = {}
    for channel in held_out_gap.CHANNELS:
        unit = "A" if channel == "current" else ("m" if session.kind == "linear" else "rad")
        first, last = (held_out_gap.squares(known, rows, channel) for rows in inside)
        expected = held_out_gap.gap(first, last, held_out_gap.floor(known, inside[1], channel), unit).closure
        first, last = (held_out_gap.squares(counted, rows, channel) for rows in (before, after))
        found[channel] = held_out_gap.gap(first, last, held_out_gap.floor(counted, after, channel), unit, expected)
    position = found.pop("position")

    def remaining(members: frozenset[str]) -> float:
        model = now.model if "parameters" in members else nominal
        stage = equipped(model, [one for one in now.effects if one.effect.name in members]).stage
        return held_out_gap.remaining(counted, held_out_gap.predicted(session, stage, judged))

    players = ["parameters", *(one.effect.name for one in now.effects)]
    shares = _shares(held_out_gap.shapley(players, remaining), position)
    if session.logs[0].current is None:
        found.pop("current")
    traces = held_out_gap.traces([one.log for one in counted], before, after, position.floor, session.dt)
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


def along_the_path(session: Session, e: Evidence, selected: Selection, improved: Stage, judged: Sequence[Log]) -> Told:
    """The gap of the effort along the measured path, where no loop can be simulated."""
    now, dt = selected.fitted, session.dt
    held = bool(judged and judged[0].held_out)
    paths = runs(session, held)
    unit = "N" if session.kind == "linear" else "N m"

    def left(model: TrackedModel) -> held_out_gap.Squares:
        return held_out_gap.effort(model, paths, e.base.noise, dt)

    nominal = sensitivities.model_of(session, session.stage)
    after = left(now.model._replace(stage=improved))
    least = held_out_gap.effort_floor(now.model, paths, e.base.noise, dt)
    gap = held_out_gap.gap(left(nominal), after, least, unit)

    def remaining(members: frozenset[str]) -> float:
        model = now.model if "parameters" in members else nominal
        return float(left(equipped(model, [one for one in now.effects if one.effect.name in members])).gap.sum())

    players = ["parameters", *(one.effect.name for one in now.effects)]
    shares = _shares(held_out_gap.shapley(players, remaining), gap)
    return Told(gap, {}, shares, [])
