"""One record of a motion as an identification reads it: sound columns in axis units, and what is doubtful."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.units import StageError

Array = NDArray[np.float64]


class IdentificationError(StageError):
    """A record that does not tell the parameters: what is wrong with it, and what to record instead."""


class Capture(NamedTuple):
    """Columns (n,) of one record, equally spaced; a gap ends it."""

    name: str
    time: Array  # s, from 0
    position: Array  # rad | m, measured
    current: Array  # A, the best that there is, see `current_column`
    dt: float  # s, sampling time
    current_column: str = "measured_current"  # or current, command: what stands for the motor's current
    excitation: Array | None = None  # A, injected into the command: the instrument of a frequency response
    reference: Array | None = None  # rad | m
    encoder_step: float = 0.0  # rad | m, 0: not known
    steady: tuple[float, float] | None = None  # s, window of the steady part
    meta: Mapping[str, Any] = MappingProxyType({})  # of the recording
    notes: tuple[str, ...] = ()  # what is doubtful about it, in words
