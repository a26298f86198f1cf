"""A scope over the rows of a ring: it waits for its trigger on every row, and takes what lies before and behind it.

::

        level ----------------------/----      rising: the row before lies below the level, this one does not
                   before          / |  after
        |-------------------------/--|----------------|
      first                     trigger             first + rows

The trigger is sought at full rate, whatever is shown later.
"""

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.recording.joined_rings import Source

Array = NDArray[np.float64]
Edge = Literal["rising", "falling", "both"]
Mode = Literal["auto", "normal", "single"]


_NOTHING = (math.inf, -math.inf)  # bounds of no value


class Trigger(NamedTuple):
    """What the scope waits for."""

    column: int  # of the ring
    level: float
    edge: Edge = "rising"
    scale: float = 1.0  # from the ring's number to the channel's unit


class Settings(NamedTuple):
    """How a scope takes its captures."""

    rows: int  # of a capture
    before: int  # rows of it that lie before the trigger
    trigger: Trigger | None = None  # without one, whatever comes
    mode: Mode = "auto"  # auto: without a trigger it takes what there is, after `patience`
    patience: int = 0  # rows
    dead: int = 0  # rows from one capture's trigger to where the next is sought, at least


class Capture(NamedTuple):
    """What was taken."""

    first: int  # number of its first row
    at: int  # row of the trigger, from `first`
    rows: Array  # (n, width)
    triggered: bool  # False: nothing came, auto mode took what there was


class Scope:
    """Looks at a ring again and again; settings do not change."""

    def __init__(self, settings: Settings, written: int) -> None:
        self.settings = settings
        self._sought = max(written - settings.rows, 0) + settings.before  # first row that may be the trigger
        self._armed = self._sought
        self._found: int | None = None
        self.seen = _NOTHING  # lowest and highest value of the trigger's channel since the last capture
        self.done = False  # a single capture has been taken

    def look(self, ring: Source) -> Capture | None:
        """The next capture, once it is whole."""
        if self.done:
            return None
        if self._found is None:
            self._seek(ring)
        trigger, s = self._found, self.settings
        if trigger is not None and ring.written >= trigger - s.before + s.rows:
            return self._taken(ring, trigger, s.trigger is not None)
        waited = ring.written - self._armed
        if trigger is None and s.mode == "auto" and waited >= s.rows + s.patience:
            return self._taken(ring, ring.written - s.rows + s.before, False)
        return None

    def _seek(self, ring: Source) -> None:
        """The first row from `_sought` on that is a trigger."""
        trigger = self.settings.trigger
        if trigger is None:
            if ring.written > self._sought:
                self._found = self._sought
            return
        start = max(self._sought - 1, 0)
        first, raw = ring.read(start, ring.written - start)
        values = np.frombuffer(raw).reshape(-1, ring.width)[:, trigger.column]
        if np.isfinite(values).any():
            self.seen = min(self.seen[0], float(np.nanmin(values))), max(self.seen[1], float(np.nanmax(values)))
        hits = crossings(values, trigger.level, trigger.edge)
        if len(hits):
            self._found = first + int(hits[0])
        self._sought = max(first + len(values), self._sought)

    def _taken(self, ring: Source, trigger: int, triggered: bool) -> Capture | None:
        s = self.settings
        wanted = max(trigger - s.before, 0)
        first, raw = ring.read(wanted, trigger - s.before + s.rows - wanted)
        self._found, self.seen = None, _NOTHING
        self._armed = self._sought = max(trigger + max(s.dead, s.rows - s.before, 1), 1)
        if not raw or first > trigger:
            return None  # overwritten while it waited: the next one
        self.done = s.mode == "single" and (triggered or s.trigger is None)
        return Capture(first, trigger - first, np.frombuffer(raw).reshape(-1, ring.width), triggered)


def crossings(values: Array, level: float, edge: Edge) -> NDArray[np.intp]:
    """Indices where `values` (n,) cross the level; NaN crosses nothing."""
    before, after = values[:-1], values[1:]
    rising, falling = (before < level) & (after >= level), (before > level) & (after <= level)
    crossed = rising if edge == "rising" else falling if edge == "falling" else rising | falling
    return np.flatnonzero(crossed) + 1
