"""What a drive does to single commands: seen in the signature of the missing current, not in any mean force.

A command in steps leaves a saw tooth over the command itself, whatever the axis does.  A delay that jitters leaves
noise that grows with the slope of the current.  Neither moves the axis by much, and no column predicts either.  A limit
of the current that the model lacks is seen in the logs, too: the current stays where the command goes on.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from stagectl.gap.effects.library import EFFECTS
from stagectl.gap.effects.stage_changes import put
from stagectl.gap.inference import thresholds
from stagectl.gap.logs.session import Array, Session
from stagectl.gap.logs.thresholds import KNOWN_LIMIT, PLATEAU
from stagectl.gap.residuals import sensitivities
from stagectl.gap.residuals.gram_matrices import NORMAL
from stagectl.gap.residuals.half_strokes import Run
from stagectl.gap.residuals.model_tracking import MeasuredPath
from stagectl.gap.residuals.sensitivities import TrackedModel
from stagectl.gap.result.diagnosis import FoundEffect, Value
from stagectl.gap.selection import constants
from stagectl.gap.selection.baseline_fit import is_measured
from stagectl.gap.selection.drive_alikes import delay
from stagectl.gap.selection.refine import Evidence, Fitted
from stagectl.kernels.stage import Drive, Stage
from stagectl.parallel import in_parallel
from stagectl.recording.true_rows import stretches


class MissingCurrent(NamedTuple):
    """One log's missing current along its command, (n,) each."""

    command: Array  # A
    current: Array  # A, measured less that of the drive's model
    answer: Array  # A/s, of the model's current to a longer dead time


class Jitter(NamedTuple):
    """What repeats say of a jitter of the delay."""

    rms: float  # s
    most: float  # s, upper end of the 95 % interval of `rms`
    sigma: float  # standard deviations by which its square is above none
    share: float  # of the variance of the current


class Signatures(NamedTuple):
    """What single commands show."""

    found: tuple[FoundEffect, ...]
    most_jitter: float  # s, that the delay may have; inf where that is not known


def signatures(session: Session, e: Evidence, now: Fitted, excluded: tuple[str, ...]) -> Signatures:
    """The drive's effects on single commands; none where no current is measured along with the command."""
    clipped = any(valued.effect.name in constants.CLIPPING for valued in now.effects)  # which holds the current, too
    candidates, most = [] if clipped else [_saturated(session)], math.inf
    if is_measured(e.runs) and all(log.exact for run in e.runs for log in run.logs):
        runs = missing_currents(now.equipped, e)
        logs = [log for run in runs for log in run]
        delays = [delay(valued) for valued in now.effects if valued.effect.name in constants.TIMING]
        jitter = jitter_of(runs)
        candidates += [quantised(session.stage.drive, logs), jittered(jitter, delays)]
        most = math.inf if jitter is None else jitter.most
    return Signatures(tuple(each for each in candidates if each and each.name not in excluded), most)


def put_in(p: Stage, found: Sequence[FoundEffect]) -> Stage:
    """`p` with these signatures."""
    for place, value in (field for signature in found for field in signature.fields):
        p = put(p, place, value)
    return p


def _saturated(session: Session) -> FoundEffect | None:
    """A limit at which the current stays under larger commands."""
    found = plateau(session)
    if found is None:
        return None
    value = Value(found.current, found.current, found.current + found.spread, "A")
    return _signature("current_saturation", "current_limit", value, ("torque_path",) if found.gain else ())


def missing_currents(p: TrackedModel, e: Evidence) -> list[list[MissingCurrent]]:
    """The missing current of every run and repeat, where its rows count."""
    later = p._replace(stage=put(p.stage, "drive.dead_time", p.stage.drive.dead_time + thresholds.ANSWER_STEP))

    def of(run: Run) -> list[MissingCurrent]:
        keep = np.logical_and.reduce([log.valid[: run.rows] for log in run.logs])
        keep[: thresholds.SETTLING_ROWS] = False
        return [_along(p, later, path, keep) for path in run.paths]

    return in_parallel(of, e.runs)


def _along(p: TrackedModel, later: TrackedModel, path: MeasuredPath, keep: NDArray[np.bool_]) -> MissingCurrent:
    plain, moved = sensitivities.model_residual(p, path).current, sensitivities.model_residual(later, path).current
    return MissingCurrent(
        *(column[keep] for column in (path.rows[:, 0], plain, (plain - moved) / thresholds.ANSWER_STEP))
    )


def quantised(drive: Drive, logs: list[MissingCurrent]) -> FoundEffect | None:
    """Steps of the command, by the spectrum of the missing current over the command; not those of the modelled `drive`.

    Its delay in samples and up to two more are tried.  The first harmonic of a saw tooth is ``step / pi``.  One
    histogram of the missing current over the command, and its Fourier transform, try all steps at once.  Where the
    machine has no such steps as the model, the model's own are found: they are no effect of the machine.
    """
    first = drive.delay_samples
    lines = [line for shift in range(first, first + 3) if (line := _line(logs, shift)) is not None]
    if not lines:
        return None
    _, step, width = max(lines, key=lambda line: line[0])
    if abs(step - drive.current_quantum) <= width:
        return None
    return _signature("current_quantisation", "step", Value.around(step, width, "A"))


def _signature(name: str, parameter: str, value: Value, alternatives: tuple[str, ...] = ()) -> FoundEffect:
    known = EFFECTS[name]
    return FoundEffect(
        name,
        alternatives,
        thresholds.SIGNATURE_PROBABILITY,
        0.0,
        {parameter: value},
        known.block,
        ((known.places[-1], value.value),),
        coordinate=known.coordinate,
    )


def _line(logs: list[MissingCurrent], shift: int) -> tuple[float, float, float] | None:
    """The strongest line: its power over that of noise, its period (A) and half its width (A).

    None where none stands out.  `shift` rows lie between a command and its current.
    """
    command = np.concatenate([log.command[: len(log.command) - shift] for log in logs])
    current = np.concatenate([log.current[shift:] for log in logs])
    current = current - np.polynomial.Polynomial.fit(command, current, 3, full=True)[0](command)
    low, high = float(command.min()), float(command.max())
    smallest = max(thresholds.STEP_RANGE[0], (high - low) / thresholds.FINEST_STEP)
    width = smallest / thresholds.BINS_PER_STEP
    place = np.round((command - low) / width).astype(np.int64)
    count = fft.next_fast_len(4 * (int(place.max()) + 1), real=True)
    squares = float(np.sum(current**2))
    power = np.abs(fft.rfft(np.bincount(place, current, count))) ** 2 / max(squares, 1e-300)
    per_ampere = np.arange(len(power)) / (count * width)
    within = (per_ampere >= 1.0 / thresholds.STEP_RANGE[1]) & (per_ampere <= 1.0 / smallest)
    best = int(np.argmax(np.where(within, power, 0.0)))
    step = 1.0 / float(per_ampere[best])
    amplitude = 2.0 * math.sqrt(float(power[best]) * squares) / len(current)
    if (
        not _stands_out(power, best)
        or not thresholds.SAW_TOOTH[0] < amplitude * math.pi / step < thresholds.SAW_TOOTH[1]
    ):
        return None
    return float(power[best]), step, step * step * 0.5 / (count * width)


def _stands_out(power: Array, best: int) -> bool:
    """Whether the line `best` stands out of noise, and of its neighbours: a gain's error falls off with frequency."""
    neighbours = np.median(power[int(0.8 * best) : int(1.25 * best) + 1])
    return not power[best] < thresholds.LINE_POWER * max(1.0, neighbours)


def jittered(found: Jitter | None, delays: Sequence[float] = ()) -> FoundEffect | None:
    """The jitter that was `found`, where it is sure.

    Next to a delay or lag (of `delays`, s) no longer than its mean would be, less is enough: it is the cause of both.
    """
    if found is None:
        return None
    twice = any(delay <= thresholds.DELAY_PER_JITTER * found.rms for delay in delays)
    least = thresholds.JITTER_SIGMA_OF_DELAY if twice else thresholds.JITTER_SIGMA
    if found.sigma < least or found.share < thresholds.JITTER_SHARE:
        return None
    return _signature("jitter", "rms", Value.around(found.rms, 0.5 * NORMAL * found.rms / found.sigma, "s"))


def jitter_of(runs: list[list[MissingCurrent]]) -> Jitter | None:
    """A random part of the delay: differences between repeats grow with the current's answer to a delay.

    ``var = noise^2 + jitter^2 answer^2``, the answer in A/s, least squares over all rows.  None without repeats: an
    error of the mean delay would pass for a jitter.
    """
    repeated = [run for run in runs if len(run) > 1]
    if not repeated:
        return None
    answer = np.concatenate([log.answer for run in repeated for log in run])
    current = np.concatenate([deviation for run in repeated for deviation in _deviations(run)])
    x, y = answer * answer, current * current
    spread = x - x.mean()
    total = float(spread @ spread)
    if total == 0.0:
        return None
    slope = float(spread @ y) / total
    rest = y - y.mean() - slope * spread
    deviation = max(math.sqrt(float((spread * rest) @ (spread * rest))) / total, 1e-300)
    return Jitter(
        math.sqrt(max(slope, 0.0)),
        math.sqrt(max(slope + NORMAL * deviation, 0.0)),
        slope / deviation,
        slope * float(x.mean()) / max(float(y.mean()), 1e-300),
    )


def _deviations(run: list[MissingCurrent]) -> list[Array]:
    """Of each repeat's missing current from the mean of all, with the variance of a single one."""
    mean = np.mean([log.current for log in run], axis=0)
    return [math.sqrt(len(run) / (len(run) - 1)) * (log.current - mean) for log in run]


class Plateau(NamedTuple):
    """The current at which the logs end under larger commands."""

    current: float  # A, the largest: a limit is not below what was measured
    spread: float  # A, from the middle of the currents at the limit to the largest one
    gain: bool  # whether a factor on the command explains these logs as well: they hold one size of command


def plateau(session: Session) -> Plateau | None:
    """The limit that all logs with command and current share; None where they have none, or the model's own.

    No fit is needed, and no evidence of half strokes: a pulse of milliseconds shows it.
    """
    logs = [(log.command, log.current, log.valid) for log in session.logs]
    pairs = [(np.abs(x[rows]), np.abs(y[rows])) for x, y, rows in logs if x is not None and y is not None]
    if not pairs:
        return None
    command, current = (np.concatenate(part) for part in zip(*pairs, strict=True))
    largest = float(current.max(initial=0.0))
    held = (current > thresholds.AT_LIMIT * largest) & (command > thresholds.BEYOND_LIMIT * largest)
    rows = sum(end - begin for begin, end in stretches(held) if end - begin >= PLATEAU)
    if not rows or largest > KNOWN_LIMIT * session.stage.drive.current_limit:
        return None
    against = _against_a_gain(command[held], current[held])
    if against > 1.0 / thresholds.LIMIT_AGAINST_GAIN:
        return None
    spread = largest - float(np.median(current[held]))
    return Plateau(largest, spread, against > thresholds.LIMIT_AGAINST_GAIN)


def _against_a_gain(command: Array, current: Array) -> float:
    """Sum of squares that one level of the current leaves under large commands, over that of a factor on these."""
    factor, level = float(command @ current) / float(command @ command), float(current.mean())
    return float(np.sum((current - level) ** 2)) / max(float(np.sum((current - factor * command) ** 2)), 1e-300)
