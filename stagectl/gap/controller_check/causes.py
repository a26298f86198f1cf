"""Why a logged command is not the recomputed one: each simple cause tried, and the one named that explains most.

The terms of the command are linear in the gains, so a wrong gain is a factor on its term, by least squares.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from stagectl.gap.logs.session import Array, Session
from stagectl.kernels import friction, friction_path, law, rollout

if TYPE_CHECKING:
    from stagectl.gap.controller_check.recomputed_command import Compared

EXPLAINED = 0.1  # rms that is left, as a share of the difference: below it a cause is named
SURE = 0.05  # the same, for a difference that is within the limit
SLIGHT = 0.01  # factor on a term, less one, that counts then
NOISE = 0.9  # what every cause leaves of noise
SHIFTS = 8  # rows
ALONE = 0.5  # what a single cause may leave of what several leave
_PID = {"proportional": "the proportional gain", "integral": "the integral gain", "derivative": "the derivative gain"}
_CASCADE = {
    "proportional": "the velocity gain",
    "integral": "the integral gain",
    "derivative": "the force filter's part",
}
_KNOWN = {
    "feedforward": "the feedforward",
    "friction": "the friction compensation",
    "added": "the injected current",
    "observer": "the observer's part",
}
_POLES = (0.25, 0.5, 0.7, 0.8, 0.9, 1.1, 1.25, 1.5, 2.0, 4.0)


class Cause(NamedTuple):
    """An explanation, and the share of the difference (rms) that it leaves."""

    left: float
    words: str
    factor: float = 1.0  # on a term, where it is one


def probable(session: Session, each: list[Compared], allowed: float) -> str:
    """The most probable cause in words."""
    worst = max(each, key=lambda one: one.worst[0])
    causes = [
        *_factors(session, each),
        *_anticipated(session, worst),
        *_shifts(session, worst),
        *_poles(session, worst),
        *_others(worst),
    ]
    best = min(causes, key=lambda one: one.left)
    several = _several(session, each)
    if best.left < EXPLAINED and best.left < several.left / ALONE + allowed / _rms(worst.difference):
        return f"{best.words} ({_explained(best)})"
    if several.left < EXPLAINED:
        return f"{several.words} ({_explained(several)})"
    return (
        f"no single cause explains it; nearest: {best.words} ({_explained(best)}).  Look at the units of gains and "
        "columns, at the sampling time, at what else is added to the command, and whether the record is of this machine"
    )


def slight(session: Session, each: list[Compared]) -> str:
    """A factor on a term that explains a difference within the limit, in words; empty where none does."""
    best = min(_factors(session, each), key=lambda one: one.left)
    if best.left > SURE or abs(best.factor - 1.0) < SLIGHT:
        return ""
    return f"{best.words} ({_explained(best)})"


def unexplained(session: Session, each: list[Compared]) -> bool:
    """Whether no cause explains any of the difference: it is noise, such as that of rounding."""
    worst = max(each, key=lambda one: _rms(one.difference))
    causes = [*_factors(session, each), *_anticipated(session, worst), *_shifts(session, worst)]
    return min(one.left for one in (*causes, _several(session, each))) > NOISE


def _explained(cause: Cause) -> str:
    return f"explains {100.0 * (1.0 - min(cause.left, 1.0)):.3g} % of the difference"


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values * values)))


def _terms(session: Session, one: Compared) -> dict[str, Array]:
    """The parts of the recomputed command (n,) A by their names, those that are not zero."""
    p, r = session.law, one.log.setpoints
    assert p is not None and r is not None
    own = {name: one.terms[:, j] for j, name in enumerate(law.Output._fields)}
    known = {name: r[:, j] for j, name in enumerate(law.Setpoint._fields)}
    parts = {name: own[name] for name in ("proportional", "integral", "derivative", "observer")}
    parts |= {"feedforward": known["feedforward"], "friction": known["friction"]}
    return parts | {"added": known["learned"] + known["injection"]}


def _joined(session: Session, each: list[Compared]) -> tuple[dict[str, Array], Array]:
    """Parts and differences of all logs in the rows that count."""
    rows = [np.isfinite(one.difference) for one in each]
    parts = [_terms(session, one) for one in each]
    found = {name: np.concatenate([p[name][r] for p, r in zip(parts, rows, strict=True)]) for name in parts[0]}
    found = {name: part for name, part in found.items() if np.any(part)}
    return found, np.concatenate([one.difference[r] for one, r in zip(each, rows, strict=True)])


def _names(session: Session) -> dict[str, str]:
    assert session.law is not None
    return {**(_CASCADE if session.law.cascaded else _PID), **_KNOWN}


def _factors(session: Session, each: list[Compared]) -> Iterator[Cause]:
    """One term, all feedback, or the whole command by a factor; a constant added."""
    parts, difference = _joined(session, each)
    size = _rms(difference)
    named = {_names(session)[name]: part for name, part in parts.items()}
    feeding = [part for name, part in parts.items() if name in _PID]
    if len(feeding) > 1:
        named["the whole feedback"] = np.sum(feeding, axis=0)
    for words, part in named.items():
        factor = 1.0 + float(difference @ part) / float(part @ part)
        yield Cause(_rms(difference - (factor - 1.0) * part) / size, _looks_like(words, factor), factor)
    whole = np.sum(list(parts.values()), axis=0)
    factor = 1.0 + float(difference @ whole) / float(whole @ whole)
    yield Cause(_rms(difference - (factor - 1.0) * whole) / size, _scaled(session, factor))
    mean = float(np.mean(difference))
    yield Cause(_rms(difference - mean) / size, f"a constant {mean:.4g} A is added to the logged command")


def _looks_like(what: str, factor: float) -> str:
    if abs(factor) < 0.02:
        return f"{what} seems to be missing from the logged command"
    return f"{what} looks like {factor:.3g} of the nominal one"


def _scaled(session: Session, factor: float) -> str:
    """A factor on the whole command: often a unit."""
    constant = session.stage.motor.force_constant
    for value, unit in ((constant, "an effort instead of a current"), (1e3, "mA"), (-1.0, "of the opposite sign")):
        if abs(factor / value - 1.0) < 0.01:
            return f"the logged command looks like {factor:.4g} times the recomputed one, as if it were {unit}"
    return f"the logged command looks like {factor:.4g} times the recomputed one: a scale or a unit of the column"


def _several(session: Session, each: list[Compared]) -> Cause:
    """All terms by factors of their own at once."""
    parts, difference = _joined(session, each)
    table = np.column_stack(list(parts.values()))
    size = np.sqrt(np.mean(table * table, axis=0))
    factors = np.linalg.lstsq(table / size, difference, rcond=1e-10)[0] / size
    left = _rms(difference - table @ factors) / _rms(difference)
    moved = [
        f"{_names(session)[name]} {1.0 + factor:.3g}"
        for name, factor in zip(parts, factors, strict=True)
        if abs(factor) > 0.01
    ]
    return Cause(left, f"several terms differ; as shares of the nominal ones: {', '.join(moved)}")


def _answers(session: Session, setpoints: Array, position: Array, p: law.Law | None = None) -> Array:
    used = p or session.law
    assert used is not None
    out = np.zeros((len(position), len(law.Output._fields)))
    rollout.answers(used, (np.ascontiguousarray(setpoints), np.ascontiguousarray(position), out))
    return out[:, law.Output._fields.index("command")]


def _shifts(session: Session, one: Compared) -> Iterator[Cause]:
    """Reference, position or command of other rows."""
    log = one.log
    assert log.setpoints is not None and log.command is not None
    position, known, command = log.position, log.setpoints, log.command
    size, inside = _rms(one.difference), np.isfinite(one.difference)
    inside[:SHIFTS] = inside[len(inside) - SHIFTS :] = False
    own = one.terms[:, law.Output._fields.index("command")]
    ahead = known[:, 2] + known[:, 3]
    for n in (n for n in range(-SHIFTS, SHIFTS + 1) if n):
        way = f"{abs(n)} {'row' if abs(n) == 1 else 'rows'} {'later' if n > 0 else 'earlier'}"
        for what, again in (
            ("the reference acts", _answers(session, _moved(known, n), position)),
            ("the position was seen", _answers(session, known, _moved(position, n))),
            ("the command is logged", _moved(own, n)),
            ("feedforward and friction compensation act", own + _moved(ahead, n) - ahead),
        ):
            left = _rms((command - again)[inside]) / size
            yield Cause(left, f"{what} {way} than the description says")


def _moved(values: Array, n: int) -> Array:
    """Rows `n` later, the ends held."""
    at = np.clip(np.arange(len(values)) - n, 0, len(values) - 1)
    return values[at]


def _poles(session: Session, one: Compared) -> Iterator[Cause]:
    """Another pole of the derivative's filter."""
    p, log = session.law, one.log
    assert p is not None and log.setpoints is not None and log.command is not None
    if p.cascaded or p.feedback.derivative == 0.0:
        return
    dt = session.dt
    pole = 2.0 * (1.0 - p.feedback.decay) / (dt * (1.0 + p.feedback.decay))
    gain = p.feedback.derivative * (2.0 + pole * dt) / (2.0 * pole)
    rows = np.isfinite(one.difference)
    for factor in _POLES:
        a = factor * pole
        other = p.feedback._replace(derivative=2.0 * gain * a / (2.0 + a * dt), decay=(2.0 - a * dt) / (2.0 + a * dt))
        again = _answers(session, log.setpoints, log.position, p._replace(feedback=other))
        left = _rms((log.command - again)[rows]) / _rms(one.difference)
        yield Cause(left, f"the pole of the derivative's filter looks like {factor:.2g} of the nominal one")


def _anticipated(session: Session, one: Compared) -> Iterator[Cause]:
    """A feedforward or friction compensation of another model than is described."""
    reference = one.log.reference
    if reference is None:
        return
    p, dt = session.stage, session.dt
    constant = p.motor.force_constant
    velocity = np.gradient(reference, dt)
    force = np.zeros((len(reference), len(p.friction.operators.weight)))
    friction_path.operators(friction.Gms(p.friction.operators), reference, dt, force)
    rows, size = np.isfinite(one.difference), _rms(one.difference)
    for what, part in (
        ("the inertia of the feedforward", p.mechanics.inertia * np.gradient(velocity, dt)),
        ("the viscous friction of the feedforward", p.mechanics.viscous * velocity),
        ("the friction compensation", force @ np.asarray(p.friction.operators.weight)),
    ):
        part = part[rows] / constant
        if not np.any(part):
            continue
        share = float(one.difference[rows] @ part) / float(part @ part)
        left = _rms(one.difference[rows] - share * part) / size
        yield Cause(left, f"{what} seems to differ by {share:+.3g} of the model's")


def _others(one: Compared) -> Iterator[Cause]:
    """A limit that was active in the logged command."""
    command = one.log.command
    assert command is not None
    own, rows = one.terms[:, law.Output._fields.index("command")], np.isfinite(one.difference)
    high, low = float(command[rows].max()), float(command[rows].min())
    left = _rms((command - np.clip(own, low, high))[rows]) / _rms(one.difference)
    yield Cause(left, f"a limit is active: the logged command stays within [{low:.4g}, {high:.4g}] A")
