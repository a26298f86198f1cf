r"""Friction of a capture around its reversals: the constant parts, and the stretch between them.

::

    friction = Kt i - M a - D v          position and current through the same zero-phase low-pass

        _______ ,---.                        the constant parts are spans of steady speed, trimmed at both ends;
         span        \                       the window of a reversal reaches from one span to the next
                      \_______
              |window|  span

The mass and the viscous part come from the stage file.  The filter smooths a corner of the friction over about a
millisecond (150 Hz), which lies far below the time constants sought.
"""

from typing import NamedTuple

import numpy as np
from scipy import signal

from stagectl.compensation.legs import Array, Legs, measured_legs
from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Capture, IdentificationError, Refusal
from stagectl.identification.result import Note, Topic

COMMANDED = ("command", "current")


class SmoothedMotion(NamedTuple):
    """A capture, smoothed: columns (n,) in axis units."""

    velocity: Array
    friction: Array  # N m | N
    cut: Legs
    dt: float  # s


class SteadySpan(NamedTuple):
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
        return self.force > 0.0 and self.change <= thresholds.SETTLED_SPAN


class Reversal(NamedTuple):
    """The rows between two settled spans, and the leg that begins there."""

    leg: int
    first: int
    last: int


class Reversals(NamedTuple):
    """All spans and reversals of one capture."""

    name: str
    motion: SmoothedMotion
    spans: list[SteadySpan]
    reversals: list[Reversal]
    notes: tuple[str, ...] = ()


def reversals(capture: Capture, file: StageFile) -> Reversals:
    """Spans and reversals of `capture`.

    Raises IdentificationError where it is too short or too slowly sampled, has no reversal, or none between
    two spans in which the friction has become constant.
    """
    _check_sampling(capture)
    motion, notes = _smoothed(capture, file)
    spans = [span for leg in range(1, len(motion.cut.way)) if (span := _span(motion, leg)) is not None]
    settled = {span.leg: span for span in spans if span.settled}
    turned = [int(leg) for leg in motion.cut.reversals()]
    pairs = [(leg, settled[leg - 1], settled[leg]) for leg in turned if leg - 1 in settled and leg in settled]
    if not pairs:
        raise _refusal(motion, spans, len(turned))
    if len(pairs) < len(turned):
        text = (
            f"{capture.name}: {len(turned) - len(pairs)} of {len(turned)} reversals left out: before or after them "
            "the friction does not become constant"
        )
        notes = (*notes, Note(Topic.LEFT_OUT, text))
    between = [Reversal(leg, before.last, after.first) for leg, before, after in pairs]
    return Reversals(capture.name, motion, list(settled.values()), between, notes)


def _check_sampling(capture: Capture) -> None:
    slowest = thresholds.SLOWEST_REVERSAL_SAMPLING
    if not 0.0 < capture.dt <= slowest:
        text = (
            f"sampling time = {capture.dt * 1e3:g} ms; must lie in (0, {slowest * 1e3:g}] ms: "
            "a reversal is over in some 20 ms; record at a higher rate"
        )
        raise IdentificationError(text, Refusal.SAMPLING, value=capture.dt, unit="s", admissible=f"(0, {slowest:g}]")


def _smoothed(capture: Capture, file: StageFile) -> tuple[SmoothedMotion, tuple[str, ...]]:
    dt, cutoff = capture.dt, min(thresholds.REVERSAL_CUTOFF, 0.2 / capture.dt)
    current, notes = _acting(capture, file)
    b, a = signal.butter(2, cutoff, fs=1.0 / dt)
    x, i = (np.asarray(signal.filtfilt(b, a, column), dtype=np.float64) for column in (capture.position, current))
    v = np.gradient(x, dt)
    mechanics = file.mechanics
    friction = file.motor.force_constant * i - mechanics.inertia * np.gradient(v, dt) - mechanics.viscous * v
    fastest = float(np.max(np.abs(v)))
    rounding = capture.encoder_step / np.sqrt(12.0) * 2.0 * np.pi * cutoff * np.sqrt(2.0 * cutoff * dt / 3.0)
    cut = measured_legs(
        x, v, dt, max(thresholds.STANDING_BAND * fastest, 4.0 * rounding), thresholds.LEAST_LEG_SPEED * fastest
    )
    return SmoothedMotion(v, friction, cut, dt), notes


def _acting(capture: Capture, file: StageFile) -> tuple[Array, tuple[str, ...]]:
    """The motor's current (n,) A, and notes; a command acts later, by the stage file's delay."""
    if capture.current_column not in COMMANDED:
        return capture.current, ()
    late = file.drive.current_lag + (file.drive.delay_samples + 0.5) * capture.dt  # the middle of the period it acts in
    t = capture.dt * np.arange(len(capture.current))
    text = (
        f"{capture.name}: no measured current; the {capture.current_column} column, taken to act {late * 1e3:.3g} ms "
        "later (drive.current_lag and delay_samples of the stage file, and half a period)"
    )
    return np.interp(t - late, t, capture.current), (Note(Topic.STAND_IN, text),)


def _span(motion: SmoothedMotion, leg: int) -> SteadySpan | None:
    """The steady part of `leg`; None where there is none."""
    rows = np.flatnonzero((motion.cut.leg == leg) & (motion.cut.until > 0.0))
    if not len(rows):
        return None
    speed = np.abs(motion.velocity[rows])
    level = float(np.percentile(speed, 90.0))
    inside = rows[np.abs(speed - level) <= thresholds.SPAN_STEADY * level]
    first, last = int(inside[0]), int(inside[-1])
    trim = int(thresholds.SPAN_TRIM * (last - first))
    first, last = first + trim, last - trim
    if (last - first) * motion.dt < thresholds.SHORTEST_TRIMMED:
        return None
    force = motion.cut.way[leg] * motion.friction[first : last + 1]
    half = len(force) // 2
    mean = float(np.mean(force))
    change = abs(float(np.mean(force[half:]) - np.mean(force[:half]))) * 2.0 / max(abs(mean), 1e-300)
    return SteadySpan(leg, first, last, level, mean, change)


def _refusal(motion: SmoothedMotion, spans: list[SteadySpan], turned: int) -> IdentificationError:
    """Why no reversal can be used, and what to record instead."""
    instead = "record a trapezoid there and back that keeps a constant speed for at least 0.1 s each way"
    wrong, settled = sum(span.force <= 0.0 for span in spans), sum(span.settled for span in spans)
    if not turned:
        moved = "moves one way only" if np.any(motion.cut.way) else "does not move"
        reason, text = Refusal.NO_REVERSAL, f"it has no reversal of the velocity, it {moved}; {instead}"
    elif not spans:
        reason = Refusal.NO_STEADY_SPEED
        text = (
            f"it has {turned} reversals, but keeps no speed within {100.0 * thresholds.SPAN_STEADY:g} % for "
            f"{thresholds.SHORTEST_TRIMMED * 1e3:g} ms between them: the constant parts of the friction are not seen; "
            f"{instead}"
        )
    elif wrong > len(spans) // 3:
        reason = Refusal.OPPOSITE_SIGN
        text = (
            f"in {wrong} of {len(spans)} spans of steady speed the remaining force does not oppose the motion; "
            "check motor.force_constant, the sign of the current, and mechanics.bias of the stage file"
        )
    elif settled:
        reason = Refusal.NO_STEADY_SPEED
        text = (
            f"it has {turned} reversals, but none with constant friction on both sides: only {settled} of "
            f"{len(motion.cut.way) - 1} legs keep a steady speed long enough to see it; {instead}"
        )
    else:
        reason = Refusal.FRICTION_UNSETTLED
        least = min(span.change for span in spans)
        text = (
            f"it has {turned} reversals, but none between two spans of constant friction: it still changes by "
            f"{100.0 * least:.3g} % or more along each, must be at most {100.0 * thresholds.SETTLED_SPAN:g} %: the "
            f"motion is too short; {instead}"
        )
    return IdentificationError(text, reason, value=turned)
