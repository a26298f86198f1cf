"""Why a logged command differs from the recomputed comparison: the simple cause that explains most of the difference.

The terms of the command are linear in the gains, so a wrong gain is a factor on its term, found by least squares.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.controller_check import thresholds
from stagectl.gap.controller_check.recomputed_command import Comparison
from stagectl.gap.logs.deployed_controller import DIFFERENCES
from stagectl.gap.logs.deployed_setpoints import differenced
from stagectl.gap.logs.session import Array, Session
from stagectl.kernels import friction, friction_path, law
from stagectl.recording.replay import recomputed

_PID = {"proportional": "the proportional gain", "integral": "the integral gain", "derivative": "the derivative gain"}
_CASCADE = {
    "proportional": "the velocity gain",
    "integral": "the integral gain",
    "derivative": "the force filter's part",
}
_OTHERS = {
    "feedback": "the whole feedback",
    "feedforward": "the feedforward",
    "friction": "the friction compensation",
    "added": "the injected current",
    "observer": "the observer's part",
}


class Cause(NamedTuple):
    """An explanation of a difference, and the share of its rms that it leaves."""

    kind: str  # factor | command_factor | constant | several | shift | pole | reference_velocity | model | limit | none
    term: str  # what differs, by the field of the law, or by its column
    value: float  # the factor, A, rows, or share of the model's
    left: float
    words: str

    @property
    def described(self) -> str:
        """In words, with the share that it explains."""
        return f"{self.words} (explains {100.0 * (1.0 - min(self.left, 1.0)):.3g} % of the difference)"


def probable(session: Session, comparisons: Sequence[Comparison], allowed: float) -> Cause:
    """The most probable cause of a difference above `allowed` (A); its kind is "none" where none explains it."""
    worst = max(comparisons, key=lambda comparison: comparison.worst[0])
    causes = [
        *_factors(session, comparisons),
        *_model_errors(session, worst),
        *_shifts(worst),
        *_poles(worst, session.dt),
        *_reference_velocities(worst, session.dt),
        _limit(worst),
    ]
    best = min(causes, key=lambda cause: cause.left)
    several = _several(session, comparisons)
    rounded = allowed / math.sqrt(3.0) / _rms(worst.difference)  # as numbers that are off by up to `allowed`
    if best.left < max(thresholds.EXPLAINED, rounded) and best.left < several.left / thresholds.ALONE + allowed / _rms(
        worst.difference
    ):
        return best
    if several.left < thresholds.EXPLAINED:
        return several
    words = (
        "no single cause explains it.  Check the units of gains and columns, the sampling time, what else is added to "
        f"the command, and whether the record is of this machine.  Nearest cause: {best.words}"
    )
    return best._replace(kind="none", words=words)


def within_limit(session: Session, comparisons: Sequence[Comparison]) -> Cause | None:
    """A factor on a term that explains a difference within the limit; None where there is none."""
    best = min(_factors(session, comparisons), key=lambda cause: cause.left)
    wrong_gain = best.kind == "factor" and abs(best.value - 1.0) >= thresholds.LEAST_FACTOR
    return best if best.left <= thresholds.EXPLAINED_WITHIN and wrong_gain else None


def unexplained(session: Session, comparisons: Sequence[Comparison]) -> bool:
    """Whether no cause explains any of the difference: it is noise, such as that of rounding."""
    worst = max(comparisons, key=lambda comparison: _rms(comparison.difference))
    causes = [*_factors(session, comparisons), *_model_errors(session, worst), *_shifts(worst)]
    return min(cause.left for cause in (*causes, _several(session, comparisons))) > thresholds.NOISE


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values * values)))


def _left(comparison: Comparison, command: Array, rows: NDArray[np.bool_] | None = None) -> float:
    """Share of the difference's rms that is left where the recomputed command were `command` (n,) A."""
    rows = np.isfinite(comparison.difference) if rows is None else rows
    return _rms((comparison.logged - command)[rows]) / _rms(comparison.difference)


def _terms(comparison: Comparison) -> dict[str, Array]:
    """The parts (n,) A of one recomputed command."""
    known = {name: comparison.setpoints[:, j] for name, j in law.SETPOINT_COLUMNS.items()}
    feedback = ("proportional", "integral", "derivative", "observer")
    parts = {name: comparison.terms[:, law.OUTPUT_COLUMNS[name]] for name in feedback}
    parts |= {"feedforward": known["feedforward"], "friction": known["friction"]}
    return parts | {"added": known["learned"] + known["injection"]}


def _joined(comparisons: Sequence[Comparison]) -> tuple[dict[str, Array], Array]:
    """The parts (n,) A of all recomputed commands that are not zero, and the differences (n,) A, where rows count."""
    counting = [np.isfinite(comparison.difference) for comparison in comparisons]
    terms = [_terms(comparison) for comparison in comparisons]
    parts = {
        name: np.concatenate([part[name][rows] for part, rows in zip(terms, counting, strict=True)])
        for name in terms[0]
    }
    differences = [comparison.difference[rows] for comparison, rows in zip(comparisons, counting, strict=True)]
    return {name: part for name, part in parts.items() if np.any(part)}, np.concatenate(differences)


def _name(session: Session, term: str) -> str:
    assert session.law is not None
    return {**(_CASCADE if session.law.cascaded else _PID), **_OTHERS}[term]


def _factors(session: Session, comparisons: Sequence[Comparison]) -> Iterator[Cause]:
    """A factor on one term, on all feedback or on the whole command; a constant that was added."""
    parts, difference = _joined(comparisons)
    size, terms = _rms(difference), {**parts, "command": np.sum(list(parts.values()), axis=0)}
    feedback = [part for name, part in parts.items() if name in _PID]
    if len(feedback) > 1:
        terms["feedback"] = np.sum(feedback, axis=0)
    for term, part in terms.items():
        more = _share(difference, part)
        kind, words = "command_factor" if term == "command" else "factor", _factor_words(session, term, 1.0 + more)
        yield Cause(kind, term, 1.0 + more, _rms(difference - more * part) / size, words)
    mean = float(np.mean(difference))
    words = f"a constant {mean:.4g} A is added to the logged command"
    yield Cause("constant", "command", mean, _rms(difference - mean) / size, words)


def _share(difference: Array, part: Array) -> float:
    """Least-squares factor on `part` that explains `difference`."""
    return float(difference @ part) / float(part @ part)


def _factor_words(session: Session, term: str, factor: float) -> str:
    """A factor on a term is a gain; one on the whole command is often a unit."""
    if term != "command":
        missing = abs(factor) < thresholds.MISSING_TERM
        seems = "missing from the logged command" if missing else f"{factor:.3g} of the nominal one"
        return f"{_name(session, term)} seems to be {seems}"
    words = f"the logged command is about {factor:.4g} times the recomputed one"
    constant = session.stage.motor.force_constant
    for value, unit in ((constant, "an effort instead of a current"), (1e3, "mA"), (-1.0, "of the opposite sign")):
        if abs(factor / value - 1.0) < thresholds.SAME_UNIT:
            return f"{words}, as if it were {unit}"
    return f"{words}: check the scale and the unit of the column"


def _several(session: Session, comparisons: Sequence[Comparison]) -> Cause:
    """Factors on all terms at once."""
    parts, difference = _joined(comparisons)
    table = np.column_stack(list(parts.values()))
    size = np.sqrt(np.mean(table * table, axis=0))
    factors = np.linalg.lstsq(table / size, difference, rcond=thresholds.SINGULAR)[0] / size
    left = _rms(difference - table @ factors) / _rms(difference)
    moved = [
        f"{_name(session, term)} {1.0 + factor:.3g}"
        for term, factor in zip(parts, factors, strict=True)
        if abs(factor) > thresholds.LEAST_FACTOR
    ]
    words = f"several terms differ; as shares of the nominal ones: {', '.join(moved)}"
    return Cause("several", "command", float(np.abs(factors).max(initial=0.0)), left, words)


def _shifts(comparison: Comparison) -> Iterator[Cause]:
    """Reference, position or command shifted by some rows."""
    p, position, setpoints, own = comparison.law, comparison.log.position, comparison.setpoints, comparison.recomputed
    inside = np.isfinite(comparison.difference)
    inside[: thresholds.LARGEST_SHIFT] = inside[len(inside) - thresholds.LARGEST_SHIFT :] = False
    ahead = setpoints[:, law.SETPOINT_COLUMNS["feedforward"]] + setpoints[:, law.SETPOINT_COLUMNS["friction"]]
    for n in (n for n in range(-thresholds.LARGEST_SHIFT, thresholds.LARGEST_SHIFT + 1) if n):
        rows = f"{abs(n)} {'row' if abs(n) == 1 else 'rows'} {'later' if n > 0 else 'earlier'}"
        for column, acts, again in (
            ("reference", "the reference acts", _command(comparison, p, _shifted(setpoints, n), position)),
            ("position", "the position is seen", _command(comparison, p, setpoints, _shifted(position, n))),
            ("command", "the command is logged", _shifted(own, n)),
            ("feedforward", "feedforward and friction compensation act", own + _shifted(ahead, n) - ahead),
        ):
            words = f"{acts} {rows} than the description says"
            yield Cause("shift", column, n, _left(comparison, again, inside), words)


def _command(comparison: Comparison, p: law.Law, setpoints: Array, position: Array) -> Array:
    """(n,) A, before any limit, of another law or other signals that begin as the log does."""
    return recomputed(p, setpoints, position, comparison.log.carried)[:, law.OUTPUT_COLUMNS["command"]]


def _shifted(values: Array, n: int) -> Array:
    """Rows `n` later, the ends held."""
    return values[np.clip(np.arange(len(values)) - n, 0, len(values) - 1)]


def _poles(comparison: Comparison, dt: float) -> Iterator[Cause]:
    """Another pole of the derivative's filter."""
    p = comparison.law
    if p.cascaded or p.feedback.derivative == 0.0:
        return
    pole = 2.0 * (1.0 - p.feedback.decay) / (dt * (1.0 + p.feedback.decay))
    gain = p.feedback.derivative * (2.0 + pole * dt) / (2.0 * pole)
    for factor in thresholds.POLE_FACTORS:
        a = factor * pole
        other = p.feedback._replace(derivative=2.0 * gain * a / (2.0 + a * dt), decay=(2.0 - a * dt) / (2.0 + a * dt))
        again = _command(comparison, p._replace(feedback=other), comparison.setpoints, comparison.log.position)
        left = _left(comparison, again)
        words = f"the pole of the derivative's filter seems to be {factor:.2g} of the nominal one"
        yield Cause("pole", "derivative", factor, left, words)


def _reference_velocities(comparison: Comparison, dt: float) -> Iterator[Cause]:
    """A velocity of the reference that the controller takes from the differences of its values."""
    p = comparison.law
    if not p.cascaded or p.cascade.share == 0.0:
        return
    for kind in DIFFERENCES:
        again = _command(comparison, p, differenced(comparison.setpoints, kind, dt), comparison.log.position)
        words = f"the velocity of the reference seems to be its {kind}: say controller.reference_velocity: {kind}"
        yield Cause("reference_velocity", "velocity", 1.0, _left(comparison, again), words)


def _model_errors(session: Session, comparison: Comparison) -> Iterator[Cause]:
    """A feedforward or friction compensation of another model than is described."""
    reference = comparison.log.reference
    if reference is None:
        return
    p, dt = session.stage, session.dt
    velocity = np.gradient(reference, dt)
    force = np.zeros((len(reference), len(p.friction.operators.weight)))
    friction_path.operators(friction.Gms(p.friction.operators), reference, dt, force)
    rows = np.isfinite(comparison.difference)
    difference = comparison.difference[rows]
    for term, name, effort in (
        ("inertia", "the inertia of the feedforward", p.mechanics.inertia * np.gradient(velocity, dt)),
        ("viscous", "the viscous friction of the feedforward", p.mechanics.viscous * velocity),
        ("friction", "the friction compensation", force @ np.asarray(p.friction.operators.weight)),
    ):
        part = effort[rows] / p.motor.force_constant
        if np.any(part):
            share = _share(difference, part)
            left = _rms(difference - share * part) / _rms(comparison.difference)
            yield Cause("model", term, share, left, f"{name} seems to differ by {share:+.3g} of the model's")


def _limit(comparison: Comparison) -> Cause:
    """A limit that was active in the logged command."""
    counting = comparison.logged[np.isfinite(comparison.difference)]
    high, low = float(counting.max()), float(counting.min())
    words = f"a limit is active: the logged command stays within [{low:.4g}, {high:.4g}] A"
    return Cause("limit", "command", high, _left(comparison, np.clip(comparison.recomputed, low, high)), words)
