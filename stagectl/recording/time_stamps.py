"""Times that a log writes as stamps, dates or clock times of ISO 8601, as seconds since its first row.

Arrow reads them as it reads numbers, in 8 bytes a row: a long log has no room for a Python object in each.
"""

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl.extras import arrow

_NANO = 1e-9  # s, of one unit of what Arrow reads
_DAY = 86400.0  # s
_STAMP = re.compile(
    r"(?P<date>\d{4}-\d{2}-\d{2}[T ])?\d{2}:\d{2}:\d{2}(?:[.,]\d{1,9})?(?P<zone>(?<=\d)(?:Z|[+-]\d{2}(?::?\d{2})?))?",
    re.ASCII,
)
_LOOSE = re.compile(r"\d+(?:[-:/.]\d+){2,}[-+:.,\dTZ APMapm]*", re.ASCII)  # of any country
ADMISSIBLE = (
    "a number (s)",
    "a date such as 2024-03-05T09:12:00.123",
    "one with its zone, 2024-03-05 09:12:00.123+01:00",
    "a clock time such as 09:12:00.123",
)


def is_stamp(text: str) -> bool:
    """Whether a cell is a stamp that can be read; a zone needs a date."""
    match = _STAMP.fullmatch(text)
    return match is not None and bool(match["date"] or not match["zone"])


def is_date(text: str) -> bool:
    """Whether a cell looks like a date or a clock time, readable or not: it stands where numbers stand."""
    return _LOOSE.fullmatch(text) is not None


def arrow_type(text: str) -> Any:
    """What Arrow reads a column as whose first cell is `text`: all its stamps have a date, all a zone, or none."""
    match = _STAMP.fullmatch(text)
    if match is None or not is_stamp(text):
        return arrow().float64()
    if not match["date"]:
        return arrow().time64("ns")
    return arrow().timestamp("ns", tz="UTC" if match["zone"] else None)


def numbers(column: Any) -> NDArray[np.float64]:
    """A column (n,) as Arrow read it, stamps in seconds since the first; an empty cell is NaN."""
    if column.type == arrow().float64():
        return np.require(column.to_numpy(), np.float64, "W")
    clock = column.type == arrow().time64("ns")
    counts = column.cast(arrow().int64())
    first = next((value.as_py() for value in counts if value.is_valid), 0)
    since = arrow().compute.subtract(counts, arrow().scalar(first, arrow().int64()))  # exact, as no float of a date is
    seconds = _NANO * np.asarray(since.cast(arrow().float64()).to_numpy())
    if clock:  # they run on across midnight: one that falls by more than half a day is of the next
        seconds[1:] += _DAY * np.cumsum(np.diff(seconds) < -0.5 * _DAY)
    return seconds
