"""How the rows of a recording are packed: what follows from other columns is not stored again.

::

    /samples     (n,)  float64: the columns that stand for themselves, in SI units, for any HDF5 program
    /counts      (n,)  int64: columns that come in whole steps; column = count * step, the steps are in its attributes
    /remainders  (n,)  uint64: bits of the value XOR bits of its prediction, of counts and of columns that follow from
                       others by the control law (`RULES`); 0 wherever the prediction is exact

No bit is lost whatever the rows hold: a wrong prediction, as after a change of gains, costs room and nothing else.
A prediction that is NaN counts as 0.  Before the first row all columns are 0.
"""

import json
import struct
from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from stagectl.recording.constants import BLOCK, LARGEST_COUNT, PACKING

Array = NDArray[np.float64]
Bits = NDArray[np.uint64]
Columns = Any  # (n,) values by name
_FLOAT, _BITS = struct.Struct("<d"), struct.Struct("<Q")


class Gains(NamedTuple):
    """What the control law's terms follow from, as numbers that JSON holds."""

    proportional: float = 0.0  # A/rad | A/m
    integral: float = 0.0
    derivative: float = 0.0
    decay: float = 0.0
    band: float = 0.0  # rad | m
    limit: float = 0.0  # A


class Prediction(NamedTuple):
    """A column by its last value x: ``decay x + added``; with a decay of 0 by `added` alone."""

    added: Array
    decay: float = 0.0


class Layout(NamedTuple):
    """Which columns are counted and which follow from others; all others stand for themselves."""

    steps: Mapping[str, float] = MappingProxyType({})
    gains: Gains | None = None

    @property
    def packed(self) -> tuple[str, ...]:
        """The columns that are stored as remainders."""
        return (*self.steps, *(RULES if self.gains else ()))


def layout(meta: Mapping[str, Any], columns: Collection[str]) -> Layout:
    """The layout for what a recording says about itself."""
    law, counted = meta.get("law"), meta.get("axis", {}).get("encoder_step")
    steps = {"time": meta.get("dt"), "measured": counted, "measured_current": meta.get("current_step")}
    if law is None or law["cascaded"] or not {*RULES, *_SOURCES} <= set(columns):
        gains = None
    else:
        band = 0.0 if law["observer"]["active"] else law["standstill_band"]
        gains = Gains(**law["feedback"], band=band, limit=law["current_limit"])
    stepped = {name: step for name, step in steps.items() if step and name in columns}
    if stepped.keys() >= set(columns):  # /samples needs a column
        del stepped["time"]
    return Layout(stepped, gains)


def _acting(p: Gains, c: Columns) -> Array:
    """The error that the feedback sees: `kernels.law.acted_on` over columns."""
    error = c["error"]
    beyond = np.maximum(error - p.band, 0.0) + np.minimum(error + p.band, 0.0)
    moving = (c["velocity"] != 0.0) | (c["injection"] != 0.0) | (p.band == 0.0)
    return np.asarray(np.where(moving, error, beyond))


def _before(values: Array) -> Array:
    return np.concatenate(([0.0], values[:-1]))


def _integral(p: Gains, c: Columns) -> Prediction:
    acting = _acting(p, c)
    return Prediction(p.integral * (acting + _before(acting)), 1.0)


def _derivative(p: Gains, c: Columns) -> Prediction:
    acting = _acting(p, c)
    return Prediction(p.derivative * (acting - _before(acting)), p.decay)


def _command(_: Gains, c: Columns) -> Prediction:
    known = c["feedforward"] + c["friction"] + c["learned"] + c["injection"]
    closed = c["proportional"] + c["integral"] + c["derivative"] + c["observer"] + known
    return Prediction(np.where(c["closed"] == 0.0, known, closed))


# In this order: each uses columns of those before it.
RULES: dict[str, Callable[[Gains, Columns], Prediction]] = {
    "error": lambda _, c: Prediction(np.where(c["closed"] == 0.0, 0.0, c["target"] - c["measured"])),
    "proportional": lambda p, c: Prediction(p.proportional * _acting(p, c)),
    "integral": _integral,
    "derivative": _derivative,
    "command": _command,
    "current": lambda p, c: Prediction(np.clip(c["command"], -p.limit, p.limit)),
}
_SOURCES = ("target", "measured", "velocity", "feedforward", "friction", "learned", "injection", "closed", "observer")


def _bits(values: Any) -> Bits:
    return np.ascontiguousarray(values, dtype="<f8").view("<u8")


def _counts(values: Array, step: float) -> NDArray[np.int64]:
    """The whole number of steps where that is the value to the last bit; elsewhere 0."""
    counts = np.round(values / step)
    counts[~(np.abs(counts) <= LARGEST_COUNT)] = 0.0
    counts[_bits(counts * step) != _bits(values)] = 0.0
    return counts.astype("<i8")


def _remainder(p: Prediction, values: Array) -> Bits:
    predicted = p.decay * _before(values) + p.added if p.decay else p.added
    return _bits(values) ^ _bits(np.where(np.isnan(predicted), 0.0, predicted))


def _restored(p: Prediction, remainders: Bits) -> Array:
    if p.decay:
        return _followed(p, remainders)
    return (_bits(np.where(np.isnan(p.added), 0.0, p.added)) ^ remainders).view("<f8")


def _followed(p: Prediction, remainders: Bits) -> Array:
    """Row after row, as each value needs the one before it."""
    x, values = 0.0, []
    for added, remainder in zip(p.added.tolist(), remainders.tolist(), strict=True):
        x = p.decay * x + added
        if x != x:
            x = 0.0
        if remainder:
            (x,) = _FLOAT.unpack(_BITS.pack(_BITS.unpack(_FLOAT.pack(x))[0] ^ remainder))
        values.append(x)
    return np.array(values, dtype="<f8")


class Packer:
    """The datasets of a recording that is being written."""

    def __init__(self, file: h5py.File, p: Layout, columns: tuple[str, ...]) -> None:
        self.p = p
        self._last = np.zeros(1, [(name, "<f8") for name in columns])  # the row before the next one
        plain = [name for name in columns if name not in p.packed]
        names = {"counts": (tuple(p.steps), "<i8"), "remainders": (p.packed, "<u8"), "samples": (plain, "<f8")}
        self._sets = {name: _created(file, name, of, kind) for name, (of, kind) in names.items() if of}
        self.samples = self._sets["samples"]
        self.samples.attrs["columns"] = json.dumps(columns)
        for name, value in (("counts", dict(p.steps)), ("remainders", p.gains and p.gains._asdict())):
            if name in self._sets:
                self._sets[name].attrs["from"] = json.dumps(value)

    @property
    def row(self) -> int:
        """Bytes of a row as it comes."""
        return self._last.nbytes

    def room(self, rows: bytes) -> int:
        """Bytes that these rows take at most: all of them, and the counts beside them."""
        return len(rows) + len(rows) // self.row * 8 * len(self.p.steps)

    def append(self, rows: bytes) -> None:
        """Add whole rows and push them to the disk's cache; the last dataset that grows is /samples."""
        block = np.frombuffer(rows, dtype=self._last.dtype)
        if not len(block):
            return
        size = self.samples.shape[0]
        with np.errstate(all="ignore"):
            parts = self._parts(block)
        for name, values in parts.items():
            self._sets[name].resize((size + len(block),))
            self._sets[name][size:] = values
            self._sets[name].flush()
        self._last = block[-1:].copy()

    def _parts(self, block: NDArray[Any]) -> dict[str, NDArray[Any]]:
        parts = {name: np.empty(len(block), each.dtype) for name, each in self._sets.items()}
        for name in self.samples.dtype.names:
            parts["samples"][name] = block[name]
        for name, step in self.p.steps.items():
            parts["counts"][name] = _counts(block[name], step)
            parts["remainders"][name] = _bits(parts["counts"][name] * step) ^ _bits(block[name])
        if self.p.gains:
            known: Any = np.concatenate((self._last, block))
            for name, rule in RULES.items():
                parts["remainders"][name] = _remainder(rule(self.p.gains, known), known[name])[1:]
        return parts


def _created(file: h5py.File, name: str, columns: Collection[str], kind: str) -> h5py.Dataset:
    packed = {"shuffle": True, "compression": "gzip", "compression_opts": PACKING}
    dtype = np.dtype([(column, kind) for column in columns])
    return file.create_dataset(name, (0,), dtype, maxshape=(None,), chunks=(BLOCK,), **packed)


class Packed:
    """The columns of a file, each restored when it is first asked for."""

    def __init__(self, file: h5py.File) -> None:
        self._sets = {name: file[name] for name in ("samples", "counts", "remainders") if name in file}
        self._columns: dict[str, Array] = {}
        samples = self._sets["samples"]
        self.names = tuple(json.loads(samples.attrs["columns"])) if "columns" in samples.attrs else samples.dtype.names
        self.rows = min(len(each) for each in self._sets.values())  # a writer that was killed leaves the last one short
        gains = self._attribute("remainders")
        self._p = Layout(self._attribute("counts") or {}, Gains(**gains) if gains else None)

    def _attribute(self, name: str) -> Any:
        return json.loads(self._sets[name].attrs["from"]) if name in self._sets else None

    def __getitem__(self, name: str) -> Array:
        if name not in self._columns:
            with np.errstate(all="ignore"):
                self._columns[name] = self._column(name)
        return self._columns[name]

    def _column(self, name: str) -> Array:
        if name not in self._p.packed:
            return np.asarray(self._stored("samples", name), dtype=np.float64)
        remainders = self._stored("remainders", name)
        if name in self._p.steps:
            return _restored(Prediction(self._stored("counts", name) * self._p.steps[name]), remainders)
        assert self._p.gains is not None
        return _restored(RULES[name](self._p.gains, self), remainders)

    def _stored(self, where: str, name: str) -> Any:
        return self._sets[where].fields(name)[: self.rows]

    def structured(self, only: Collection[str] = ()) -> NDArray[Any]:
        """(n,) rows with one float64 field per column; of the columns those named in `only`."""
        names = [name for name in self.names if not only or name in only]
        rows = np.empty(self.rows, [(name, "<f8") for name in names])
        for name in names:
            rows[name] = self[name]
        return rows
