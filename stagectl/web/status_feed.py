"""The status as the page shows it, made once for all viewers within a tenth of a second."""

import collections
import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.drives.cycle_time import bus_load
from stagectl.drives.drive import Canopen
from stagectl.recording.ring import Ring
from stagectl.service.axis_controller import COLUMNS, AxisController
from stagectl.service.service import Service
from stagectl.web.channels import Channel, channels, described, side_by_side
from stagectl.web.limits import CYCLES_OVER, EDGES, FAULTS_SHOWN, KEPT, STATUS_AGE
from stagectl.web.virtual_faults import may_be_virtual

_COLUMN = COLUMNS.index("lateness")


class _Part(NamedTuple):
    rows: int
    counts: NDArray[np.intp]
    largest: float


class Lateness:
    """How late the periods of the last minute began, as a histogram; counted from the ring, when somebody asks."""

    def __init__(self, ring: Ring, dt: float) -> None:
        self.ring, self._most = ring, round(KEPT / dt)
        self._done, self._rows = 0, 0
        self._parts: collections.deque[_Part] = collections.deque()
        self._counts = np.zeros(len(EDGES) + 1, dtype=np.intp)  # of all parts: reported ten times a second

    def histogram(self) -> dict[str, Any]:
        """Counts below the first edge, between two edges, and from the last one on; largest (s); rows counted."""
        self._count()
        return {
            "edges": list(EDGES),
            "counts": self._counts.tolist(),
            "largest": max((part.largest for part in self._parts), default=0.0),
            "rows": self._rows,
        }

    def _count(self) -> None:
        first, raw = self.ring.read(self._done, self.ring.capacity)
        late = np.frombuffer(raw).reshape(-1, self.ring.width)[:, _COLUMN]
        self._done = first + len(late)
        if not len(late):
            return
        places = np.searchsorted(EDGES, late, side="right")
        part = _Part(len(late), np.bincount(places, minlength=len(EDGES) + 1), float(late.max()))
        self._parts.append(part)
        self._rows, self._counts = self._rows + part.rows, self._counts + part.counts
        while self._rows - self._parts[0].rows >= self._most:
            old = self._parts.popleft()
            self._rows, self._counts = self._rows - old.rows, self._counts - old.counts


class StatusFeed:
    """The status of one service."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._late: dict[str, Lateness] = {}
        self._rates: dict[str, tuple[float, float, float]] = {}  # time, cycles, cycles a second
        self._last: tuple[float, dict[str, Any]] = (0.0, {})

    def machine(self) -> dict[str, Any]:
        """What does not change while the service runs."""
        return {
            axis.name: {
                "name": axis.setup.file.name,
                "period": axis.setup.dt,
                "unit": axis.setup.file.axis.travel_unit,
                "ring": axis.ring.capacity * axis.setup.dt,
                "homing": axis.setup.file.homing.method,
                "bus": _wire(axis),
                "virtual": may_be_virtual(axis),
                "follows_sync": may_be_virtual(axis) and axis.setup.file.simulation.clock == "sync",
                "channels": described(self._seen_from(axis)),
            }
            for axis in self._service.axes.values()
        }

    def _seen_from(self, axis: AxisController) -> dict[str, Channel]:
        """The axis' own channels, then those of the others."""
        others = {name: other.setup for name, other in self._service.axes.items() if other is not axis}
        return {**channels(axis.setup), **side_by_side(others)}

    def status(self) -> dict[str, Any]:
        """The machine now."""
        now = time.monotonic()
        if now - self._last[0] > STATUS_AGE:
            self._last = now, self._status(now)
        return self._last[1]

    def _status(self, now: float) -> dict[str, Any]:
        service = self._service
        machine = service.machine_json()
        return {
            **machine,
            "axes": [{**shown, **self._extras(service.axes[shown["axis"]], now)} for shown in machine["axes"]],
            "faults": list(service.faults)[-FAULTS_SHOWN:],
        }

    def _extras(self, axis: AxisController, now: float) -> dict[str, Any]:
        """What the page shows in addition to the status: lateness, bus load, recording."""
        late = self._late.get(axis.name)
        if late is None or late.ring is not axis.ring:
            late = self._late[axis.name] = Lateness(axis.ring, axis.setup.dt)
        rate = self._rate(axis, now)
        return {
            "lateness": late.histogram(),
            "rate": rate,
            "bus_load": _load(axis, rate),
            "recording": self._service.recordings.status_json(axis),
        }

    def _rate(self, axis: AxisController, now: float) -> float:
        """Cycles a second, over a second or more."""
        cycles = axis.status.cycles
        when, before, rate = self._rates.get(axis.name, (now, cycles, 0.0))
        if now - when >= CYCLES_OVER:
            rate = max(cycles - before, 0.0) / (now - when)
            self._rates[axis.name] = now, cycles, rate
        else:
            self._rates.setdefault(axis.name, (when, before, rate))
        return rate


def _wire(axis: AxisController) -> str:
    wire = axis.setup.file.drive.wire
    return f"{wire.channel}, {wire.bitrate / 1e3:.0f} kbit/s" if isinstance(wire, Canopen) else ""


def _load(axis: AxisController, rate: float) -> float | None:
    """Share of the bus that this axis' cycles take, with worst-case bit stuffing."""
    wire = axis.setup.file.drive.wire
    return bus_load(rate, wire.bitrate) if isinstance(wire, Canopen) else None
