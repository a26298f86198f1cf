"""Whether the measured current comes before its command: no drive does that, so the columns may be exchanged."""

from __future__ import annotations

import numpy as np

from stagectl.gap.logs.session import Array
from stagectl.gap.logs.thresholds import CURRENT_LEADS, MOST_LEAD
from stagectl.number_format import duration


def order_doubts(command: Array | None, current: Array | None, dt: float) -> list[str]:
    """What to say where the measured current (n,) A of a log leads its command by a control period `dt` (s) or more."""
    if command is None or current is None:
        return []
    lead = periods_ahead(command, current)
    if not lead:
        return []
    return [
        f"the measured current comes {duration(lead * dt)} before the command, and a drive follows its command: "
        "exchange the two columns if they are swapped; else one of them was logged late"
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
