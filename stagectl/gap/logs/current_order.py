"""Whether the measured current belongs to its command: no drive gives it earlier, or another one for long."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from stagectl.gap.logs.session import Array
from stagectl.gap.logs.thresholds import CURRENT_LEADS, MOST_LEAD, STEADY, STEADY_ROWS, UNFOLLOWED, UNFOLLOWED_ROWS
from stagectl.number_format import duration


def order_doubts(command: Array, current: Array, dt: float) -> list[str]:
    """What to say where the measured current (n,) A of a log leads its command by a control period `dt` (s) or more."""
    lead = periods_ahead(command, current)
    if not lead:
        return []
    return [
        f"the measured current comes {duration(lead * dt)} before the command, and a drive follows its command: "
        "exchange the two columns if they are swapped; else one of them was logged late"
    ]


def drive_doubts(command: Array, current: Array, dt: float) -> list[str]:
    """What to say where the current (n,) A of a log with rows every `dt` (s) stays away from a command that is steady.

    No delay of the drive does that, however many commands lie between two rows.
    """
    if len(command) <= STEADY_ROWS:
        return []
    largest = max(float(np.nanmax(np.abs(command))), 1e-300)
    steady = np.ptp(sliding_window_view(command, STEADY_ROWS), axis=1) < STEADY * largest
    rows = np.flatnonzero(steady) + STEADY_ROWS // 2
    away = rows[np.abs(command - current)[rows] > UNFOLLOWED * largest]
    if len(away) <= UNFOLLOWED_ROWS * max(len(rows), 1):
        return []
    size = float(np.abs(command - current)[away].max())
    return [
        f"the measured current stays up to {size:.3g} A away from a steady command (first at {away[0] * dt:.3f} s, "
        f"{duration(len(away) * dt)} in all): the drive does not give what it is asked for, as at a limit of its "
        "current or of its supply voltage; its effects need a log of every control period"
    ]


def periods_ahead(command: Array, current: Array) -> int:
    """Control periods by which `current` (n,) A leads `command` (n,) A; 0 where it does not by far fit better so."""
    apart = {k: _apart(command, current, k) for k in range(-MOST_LEAD, MOST_LEAD + 1)}
    best = min(apart, key=apart.__getitem__)
    return max(best, 0) if apart[best] < CURRENT_LEADS * apart[0] else 0


def _apart(command: Array, current: Array, lead: int) -> float:
    """Mean square (A^2) of the current less the command `lead` periods later, their means aside."""
    middle = slice(MOST_LEAD, len(command) - MOST_LEAD)
    later = np.roll(command, -lead)[middle]
    return float(np.nanvar(current[middle] - later)) if len(later) else np.inf
