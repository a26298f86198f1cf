"""Notes on an estimate: what it rests on, what it cannot separate, and what is left out of the stage file."""

import itertools
import math
from collections.abc import Iterator

import numpy as np

from stagectl.identification import thresholds
from stagectl.identification.result import Note, Topic
from stagectl.identification.simultaneous import laws
from stagectl.identification.simultaneous.estimate import NAMES, Estimate, over_position, turns
from stagectl.identification.simultaneous.regressors import controlled, repeats
from stagectl.number_format import duration, percent
from stagectl.units import ROTARY, unit_on

COLUMNS = {
    "measured_current": "the measured current",
    "current": "the current handed to the drive",
    "command": "the command before its limit",
}
_SHOWS = {  # what a motion needs, to show a parameter
    "inertia": "larger accelerations",
    "viscous": "higher speeds",
    "coulomb": "several speeds",
    "delay": "a position sine with its reference",
}
STAGE_KEYS = {"inertia": "mechanics.inertia", "viscous": "mechanics.viscous", "coulomb": "friction"}


def written(p: Estimate) -> tuple[Note, ...]:
    """The notes, the most general one first."""
    return (
        *_force_constant(p),
        *_offset(p),
        *_delay(p),
        *_contradicted(p),
        *_prior(p),
        *_tied(p),
        *_imprecise(p),
        *_bend(p),
        *_ripple(p),
        *_place(p),
        *_form(p),
    )


def withheld(p: Estimate) -> dict[str, Note]:
    """Parameters that are not known well enough for a stage file, by their key there, with a note on the reason.

    Parameters that this motion ties to each other are written together or not at all: their errors cancel in the
    force, while one of them beside the old value of the other would be wrong.  So each counts as known as well as it
    is beside the true values of the others, as long as these are written, too.
    """
    useless = {name for name, half in _halves_alone(p).items() if _is_useless(p, name, half)}
    out = set(useless)
    while further := {name for name in STAGE_KEYS if name not in out and _companions(p, name, out)}:
        out |= further
    kept_back: dict[str, Note] = {}
    for name in (name for name in STAGE_KEYS if name in out):
        if name in useless:
            most = f"±{100.0 * thresholds.USELESS:.0f} %"
            reason = f"it must be known within {most} beside the others' true values, its whole interval above 0"
        else:
            reason = f"it is tied to {' and '.join(_companions(p, name, out))}, and is not written alone"
        value, half = p.parameters[name].value, p.parameters[name].half
        text = f"{name}: {value:.3g} ± {half:.2g} is left out of the stage file's changes; {reason}"
        kept_back[STAGE_KEYS[name]] = Note(Topic.WITHHELD, text)
    return kept_back


def _companions(p: Estimate, name: str, out: set[str]) -> list[str]:
    """Those `out` of the stage file that `name` is tied to, or without which it is not known well enough."""
    leans = _is_useless(p, name, p.parameters[name].half)
    others = sorted(out - {name})
    return [other for other in others if leans or abs(_correlation(p, name, other)) >= thresholds.TIED]


def _halves_alone(p: Estimate) -> dict[str, float]:
    """Half of the interval of each parameter of the stage file if the others were known."""
    own = [NAMES.index(name) for name in STAGE_KEYS]
    covariance = p.covariance[np.ix_(own, own)]
    spread = np.sqrt(np.diag(covariance))
    size = np.where(spread > 0.0, spread, 1.0)
    correlation = covariance / np.outer(size, size) + thresholds.CORRELATION_RIDGE * np.eye(len(own))
    shares = np.sqrt(np.minimum(1.0 / np.diag(np.linalg.inv(correlation)), 1.0))
    return dict(zip(STAGE_KEYS, (thresholds.NORMAL_95 * spread * shares).tolist(), strict=True))


def _is_useless(p: Estimate, name: str, half: float) -> bool:
    parameter = p.parameters[name]
    return parameter.low <= 0.0 or half > thresholds.USELESS * abs(parameter.value)


def _correlation(p: Estimate, name: str, other: str) -> float:
    j, k = NAMES.index(name), NAMES.index(other)
    size = math.sqrt(p.covariance[j, j] * p.covariance[k, k])
    return float(p.covariance[j, k]) / size if size > 0.0 else 0.0


def _contradicted(p: Estimate) -> Iterator[Note]:
    stated = (p.file.mechanics.inertia, p.file.mechanics.viscous)
    for name, value, doubted in zip(("inertia", "viscous"), stated, p.problem.before.doubted, strict=True):
        if doubted:
            text = (
                f"{name}: the record contradicts the stage file's {value:.3g} {p.parameters[name].unit}, which counted "
                "as no knowledge; check the force constant and the units there, or write what was found"
            )
            yield Note(Topic.CONTRADICTED, text)


def _prior(p: Estimate) -> Iterator[Note]:
    for name, (value, half) in p.prior.items():
        if not p.rests_on_prior(name):
            continue
        text = (
            f"{name}: the motion says little of it, so it rests on the stage file's {value:.3g} ± {half:.2g} "
            f"{p.parameters[name].unit}: record {_SHOWS[name]}"
        )
        yield Note(Topic.NOT_IDENTIFIED, text)


def _form(p: Estimate) -> Iterator[Note]:
    best, *rivals = p.problem.laws
    behind = ", ".join(f"{laws.LAWS[law.name].words} {0.5 * (law.criterion - best.criterion):.3g}" for law in rivals)
    text = (
        f"friction: {laws.LAWS[best.name].words} explains it best (log evidence lower by: {behind}); "
        f"{percent(p.answer.form_share)} of the residual's variance is taken for an error of its form, which the "
        "intervals include"
    )
    yield Note(Topic.METHOD, text)


def _effort(p: Estimate) -> str:
    return unit_on(p.file.axis.kind, "N m | N")


def _percent(p: Estimate, name: str, half: float) -> str:
    return percent(half / max(abs(p.parameters[name].value), 1e-300))


def _force_constant(p: Estimate) -> Iterator[Note]:
    yield Note(
        Topic.FORCE_CONSTANT,
        f"force constant: not identified; {p.file.motor.force_constant:g} {_effort(p)}/A is the stage file's. An error "
        "of 1 % there is one of 1 % in inertia, viscous and Coulomb friction alike",
    )


def _offset(p: Estimate) -> Iterator[Note]:
    value, half = p.parameters["offset"].value, p.parameters["offset"].half
    if abs(value) <= half:
        text = (
            f"offset: none beyond its interval of ±{half:.2g} {_effort(p)}; gravity and a Coulomb friction that "
            "differs between the directions could only hide by cancelling each other"
        )
    else:
        text = (
            f"offset: {value:.3g} ± {half:.2g} {_effort(p)} is gravity, a Coulomb friction that differs between the "
            f"directions by {2.0 * abs(value):.3g} {_effort(p)}, or an offset of the current: one column for all three"
        )
    yield Note(Topic.OFFSET, text)


def _delay(p: Estimate) -> Iterator[Note]:
    value, half = p.parameters["delay"].value, p.parameters["delay"].half
    columns = {part.capture.current_column for part in p.problem.parts}
    current = " and ".join(COLUMNS.get(name, name) for name in sorted(columns))
    if not p.delay_fitted:
        change = abs(p.per_delay[0]) * 1e-4
        text = (
            f"delay: taken as {duration(value)} from {current} to the position; 0.1 ms more or less would change the "
            f"inertia by {_percent(p, 'inertia', change)}"
        )
        yield Note(Topic.DELAY, text)
        return
    negative = ", and is negative where the column itself is late" if value < 0.0 else ""
    yield Note(
        Topic.DELAY,
        f"delay: {1e3 * value:.3g} ± {1e3 * half:.2g} ms, from {current} to the position; it holds for that column "
        f"only{negative}",
    )
    moved = [part.capture for part in p.problem.parts if controlled(part.capture)]
    if any(capture.reference is None for capture in moved):
        text = (
            "reference: missing in at least one capture, and nothing else says what moved the axis there; a "
            "controller shifts delay and inertia together by its answer to noise, which the intervals allow for: "
            "record the reference or the injected current, or give --delay"
        )
        yield Note(Topic.REFERENCE, text)
    elif moved:
        text = (
            "reference: a controller moved the axis; its answer to noise is in current and acceleration alike, and "
            "counts as an error that the intervals include"
        )
        yield Note(Topic.REFERENCE, text)
    if len(columns) > 1:
        text = "delay: the captures hold different current columns with different delays; identify them separately"
        yield Note(Topic.DELAY, text)


def _tied(p: Estimate) -> Iterator[Note]:
    names = NAMES if p.delay_fitted else NAMES[:-1]
    for name, other in itertools.combinations(names, 2):
        correlation = _correlation(p, name, other)
        if abs(correlation) < thresholds.TIED:
            continue
        half = p.parameters[name].half
        alone = half * math.sqrt(max(0.0, 1.0 - correlation * correlation))
        advice = "; give --delay from a capture of a position sine" if other == "delay" else ""
        text = (
            f"{name} and {other}: tied to each other in this motion (correlation {correlation:+.2f}); with "
            f"{other} known, {name} would be known to ±{_percent(p, name, alone)} instead of "
            f"±{_percent(p, name, half)}{advice}"
        )
        yield Note(Topic.TIED, text)


def _imprecise(p: Estimate) -> Iterator[Note]:
    for name in ("inertia", "viscous", "coulomb"):
        if p.parameters[name].half > thresholds.UNSURE * abs(p.parameters[name].value):
            known = _percent(p, name, p.parameters[name].half)
            yield Note(Topic.PRECISION, f"{name}: known to ±{known} only; record longer, with {_SHOWS[name]}")
    viscous = p.parameters["viscous"].value
    if viscous < 0.0:
        text = (
            f"viscous: {viscous:.3g} is negative, which no bearing is; friction that falls with speed (Stribeck) "
            "looks like this"
        )
        yield Note(Topic.PRECISION, text)


def _bend(p: Estimate) -> Iterator[Note]:
    if p.bend is None:
        return
    rest, fast = p.bend
    speed = f"{p.problem.shapes.fastest:.3g} {unit_on(p.file.axis.kind, 'rad/s | m/s')}"
    text = (
        f"viscous: the friction bends with speed, from {rest:.3g} {p.parameters['viscous'].unit} at rest to {fast:.3g} "
        f"at {speed}; the value is that of the straight line nearest to it over the speeds of this motion, and holds "
        "for these only"
    )
    yield Note(Topic.BEND, text)


def _place(p: Estimate) -> Iterator[Note]:
    """A force over the position, which no column holds where no pitch is known."""
    if repeats(p.file) or (share := over_position(p)) < thresholds.PLACED:
        return
    text = (
        f"residual: the position explains {percent(share)} of it, as cogging or a cable would, and the intervals need "
        "not hold the truth; state the magnet or screw pitch (mechanics.pitch), and ask `stagectl gap diagnose`"
    )
    yield Note(Topic.RIPPLE, text)


def _ripple(p: Estimate) -> Iterator[Note]:
    if not (covered := turns(p.problem)):
        return
    turn = "revolution" if p.file.axis.kind == ROTARY else "pitch"
    way = f"{covered:.2g} {turn}{'es' if turn == 'pitch' else 's'}"
    if p.ripple is None:
        seen = f"none is seen over {way}"
        text = f"ripple: {seen}; the intervals include one that is too small to be seen"
    else:
        text = (
            f"ripple: {p.ripple:.3g} {_effort(p)} once per {turn}, found and taken out of the other parameters; "
            f"the motion covers {way}"
        )
    yield Note(Topic.RIPPLE, text)
