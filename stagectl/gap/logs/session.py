"""What a diagnosis starts from: the logs of a session, and what its owner believes of machine and controller.

Everything is in the axis' units (rad and N m, or m and N) and SI; rows of a log are those of the control period.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.kernels import law, stage
from stagectl.units import StageError

Array = NDArray[np.float64]


class GapError(StageError):
    """Logs that a diagnosis cannot use, or a question that they cannot answer."""


class Log(NamedTuple):
    """One repeat of one experiment; position and currents are those of the instant of the row."""

    name: str  # file, as the folder names it
    experiment: str  # logs of one experiment share reference and injection
    repeat: int
    held_out: bool  # for checking what was found, never for finding it
    start: float  # s, session clock of the first row: temperature and wear run on it
    position: Array  # (n,) rad | m
    command: Array | None  # (n,) A, before any limit
    current: Array | None  # (n,) A, reported by the drive
    reference: Array | None  # (n,) rad | m
    injection: Array | None  # (n,) A, added to the command
    valid: NDArray[np.bool_]  # (n,) False in gaps, saturation and faults
    setpoints: Array | None = None  # (n, 8) of kernels.law.Setpoint; None: controller or reference not known
    exact: bool = True  # rows are the control periods themselves; else resampled onto them

    @property
    def rows(self) -> int:
        """Control periods in the log."""
        return len(self.position)


class Session(NamedTuple):
    """All logs of one machine in one state, with the model that they are compared with."""

    place: Path
    kind: str  # rotary | linear
    travel_per_unit: float  # m of table per rad; 1 on a linear axis and on one without a lead
    travel_unit: str  # m | rad, of what the user sees as travel
    dt: float  # s, control period
    stage: stage.Stage  # nominal
    law: law.Law | None  # deployed controller; None: not known
    logs: tuple[Log, ...]
    notes: tuple[str, ...] = ()  # what was done to the data, and what is doubtful
    cannot_tell: tuple[str, ...] = ()  # what is missing, and what cannot be told because of it
    trusted: frozenset[str] = frozenset()  # nominal values that are said to be right, e.g. force_constant
    nominal: Any = None  # nominal.yaml as read, for what only a report needs
