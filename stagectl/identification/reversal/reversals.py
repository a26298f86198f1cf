r"""What a capture shows of the friction around its reversals: the constant parts, and the stretch between them.

::

    friction = Kt i - M a - D v          position and current through the same zero-phase low-pass

        _______ ,---.                        the constant parts are spans of steady speed, trimmed at both ends;
         span        \                       the window of a reversal reaches from one span to the next
                      \_______
              |window|  span

The mass and the viscous part come from the stage file.  What the filter takes from a corner of the friction
(150 Hz: a millisecond) lies far below the time constants sought.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import signal

from stagectl.compensation.legs import Array, Legs, measured_legs
from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Capture, IdentificationError

CUTOFF = 150.0  # Hz
SLOWEST = 4e-3  # s, sampling time with which a reversal of some 20 ms still shows
FEWEST = 100  # rows
STEADY = 0.03  # deviation from the steady speed, relative
TRIM = 0.25  # of a span, cut off at either end
SHORTEST = 0.02  # s, of a trimmed span
SETTLED = 0.1  # change of the friction along a span, relative to the friction
BAND, LEAST = 2e-3, 0.1  # of the largest speed: slower is standing; a leg that is never faster is none
COMMANDED = ("command", "current")


class Motion(NamedTuple):
    """A capture, smoothed: columns (n,) in axis units."""

    position: Array
    velocity: Array
    friction: Array  # N m | N
    cut: Legs
    dt: float  # s


class Span(NamedTuple):
    """A steady part of a leg: rows first ... last, without the trimmed ends."""

    leg: int
    first: int
    last: int
    speed: float  # rad/s | m/s
    force: float  # N m | N, opposing the motion
    change: float  # of the force along the span, relative

    @property
    def settled(self) -> bool:
        """Whether the friction is constant here."""
        return self.force > 0.0 and self.change <= SETTLED


class Reversal(NamedTuple):
    """The rows between two settled spans, and the leg that begins there."""

    leg: int
    first: int
    last: int


class Reversals(NamedTuple):
    """All that one capture shows."""

    name: str
    motion: Motion
    spans: list[Span]
    reversals: list[Reversal]
    notes: tuple[str, ...] = ()


def reversals(capture: Capture, file: StageFile) -> Reversals:
    """Spans and reversals of `capture`.

    Raises IdentificationError where it is too short or too slowly sampled, has no reversal, or none between
    two spans in which the friction has become constant.
    """
    _check(capture)
    motion, notes = _smoothed(capture, file)
    spans = [span for leg in range(1, len(motion.cut.way)) if (span := _span(motion, leg)) is not None]
    settled = {span.leg: span for span in spans if span.settled}
    turned = [int(leg) for leg in motion.cut.reversals()]
    pairs = [(leg, settled[leg - 1], settled[leg]) for leg in turned if leg - 1 in settled and leg in settled]
    if not pairs:
        raise IdentificationError(_without(capture, motion, spans, len(turned)))
    if len(pairs) < len(turned):
        left = f"{capture.name}: {len(turned) - len(pairs)} of {len(turned)} reversals left out: "
        notes = (*notes, left + "before or after them the friction does not become constant")
    found = [Reversal(leg, before.last, after.first) for leg, before, after in pairs]
    return Reversals(capture.name, motion, list(settled.values()), found, notes)


def _check(capture: Capture) -> None:
    if not 0.0 < capture.dt <= SLOWEST:
        raise IdentificationError(
            f"{capture.name}: sampling time = {capture.dt * 1e3:g} ms; must lie in (0, {SLOWEST * 1e3:g}] ms: "
            "a reversal is over in some 20 ms; record at a higher rate"
        )
    if len(capture.position) < FEWEST:
        raise IdentificationError(
            f"{capture.name} has {len(capture.position)} samples; must have at least {FEWEST}: record longer"
        )
    for name, column in (("position", capture.position), ("current", capture.current)):
        if not np.all(np.isfinite(column)):
            row = int(np.argmin(np.isfinite(column)))
            raise IdentificationError(
                f"{capture.name}: {name}[{row}] = {column[row]}; must be finite: cut the record to a part without gaps"
            )


def _smoothed(capture: Capture, file: StageFile) -> tuple[Motion, tuple[str, ...]]:
    dt, cutoff = capture.dt, min(CUTOFF, 0.2 / capture.dt)
    current, notes = _acting(capture, file)
    b, a = signal.butter(2, cutoff, fs=1.0 / dt)
    x, i = (np.asarray(signal.filtfilt(b, a, column), dtype=np.float64) for column in (capture.position, current))
    v = np.gradient(x, dt)
    mechanics = file.mechanics
    friction = file.motor.force_constant * i - mechanics.inertia * np.gradient(v, dt) - mechanics.viscous * v
    fastest = float(np.max(np.abs(v)))
    rounding = capture.encoder_step / np.sqrt(12.0) * 2.0 * np.pi * cutoff * np.sqrt(2.0 * cutoff * dt / 3.0)
    cut = measured_legs(x, v, dt, max(BAND * fastest, 4.0 * rounding), LEAST * fastest)
    return Motion(x, v, friction, cut, dt), notes


def _acting(capture: Capture, file: StageFile) -> tuple[Array, tuple[str, ...]]:
    """The motor's current (n,) A; a command acts later, by the stage file's delay."""
    if capture.current_column not in COMMANDED:
        return capture.current, ()
    late = file.drive.current_lag + (file.drive.delay_samples + 0.5) * capture.dt  # the middle of the period it acts in
    t = capture.dt * np.arange(len(capture.current))
    note = (
        f"{capture.name}: no measured current; the {capture.current_column} column, taken to act {late * 1e3:.3g} ms "
        "later (drive.current_lag and delay_samples of the stage file, and half a period)"
    )
    return np.interp(t - late, t, capture.current), (note,)


def _span(motion: Motion, leg: int) -> Span | None:
    """The steady part of `leg`; None where there is none."""
    rows = np.flatnonzero((motion.cut.leg == leg) & (motion.cut.until > 0.0))
    if not len(rows):
        return None
    speed = np.abs(motion.velocity[rows])
    level = float(np.percentile(speed, 90.0))
    inside = rows[np.abs(speed - level) <= STEADY * level]
    first, last = int(inside[0]), int(inside[-1])
    trim = int(TRIM * (last - first))
    first, last = first + trim, last - trim
    if (last - first) * motion.dt < SHORTEST:
        return None
    force = motion.cut.way[leg] * motion.friction[first : last + 1]
    half = len(force) // 2
    mean = float(np.mean(force))
    change = abs(float(np.mean(force[half:]) - np.mean(force[:half]))) * 2.0 / max(abs(mean), 1e-300)
    return Span(leg, first, last, level, mean, change)


def _without(capture: Capture, motion: Motion, spans: list[Span], turned: int) -> str:
    """Why no reversal serves, and what to record instead."""
    instead = "record a trapezoid there and back that keeps a constant speed for at least 0.1 s each way"
    if not turned:
        moved = "moves one way only" if np.any(motion.cut.way) else "does not move"
        return f"{capture.name} has no reversal of the velocity, it {moved}; {instead}"
    if not spans:
        return (
            f"{capture.name} has {turned} reversals, but keeps no speed within {100.0 * STEADY:g} % for "
            f"{SHORTEST * 1e3:g} ms between them: the constant parts of the friction are not seen; {instead}"
        )
    wrong = sum(span.force <= 0.0 for span in spans)
    if wrong > len(spans) // 3:
        return (
            f"{capture.name}: in {wrong} of {len(spans)} spans of steady speed the force that is left does not oppose "
            "the motion; check motor.force_constant, the sign of the current, and mechanics.bias of the stage file"
        )
    settled = sum(span.settled for span in spans)
    if settled:
        return (
            f"{capture.name} has {turned} reversals, but none with constant friction on both sides: only {settled} of "
            f"{len(motion.cut.way) - 1} legs keep a steady speed long enough to see it; {instead}"
        )
    least = min(span.change for span in spans)
    return (
        f"{capture.name} has {turned} reversals, but none between two spans of constant friction: it still changes by "
        f"{100.0 * least:.3g} % or more along each, must be at most {100.0 * SETTLED:g} %: the motion is too short; "
        f"{instead}"
    )
