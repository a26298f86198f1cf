"""A limit of the current that the model lacks, seen in the logs: the current stays where the command goes on.

No fit is needed, and no evidence of half strokes: a pulse of milliseconds shows it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stagectl.gap.inference import thresholds
from stagectl.gap.logs.row_validity import stretches
from stagectl.gap.logs.session import Array, Log, Session
from stagectl.gap.logs.thresholds import KNOWN_LIMIT, PLATEAU


class Plateau(NamedTuple):
    """The current at which the logs end under larger commands."""

    current: float  # A, the largest: a limit is not below what was measured
    spread: float  # A, from the middle of the currents at the limit to the largest one
    gain: bool  # whether a factor on the command explains these logs as well: they hold one size of command


def plateau(session: Session) -> Plateau | None:
    """The limit that all logs with command and current share; None where they have none, or the model's own."""
    pairs = [pair for log in session.logs if (pair := _sizes(log)) is not None]
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


def _sizes(log: Log) -> tuple[Array, Array] | None:
    """Sizes (m,) A of command and current in the rows that count."""
    if log.command is None or log.current is None:
        return None
    return np.abs(log.command[log.valid]), np.abs(log.current[log.valid])


def _against_a_gain(command: Array, current: Array) -> float:
    """Sum of squares that one level of the current leaves under large commands, over that of a factor on these."""
    factor, level = float(command @ current) / float(command @ command), float(current.mean())
    return float(np.sum((current - level) ** 2)) / max(float(np.sum((current - factor * command) ** 2)), 1e-300)
