"""What a diagnosis starts from: the logs of a session, and the nominal model of machine and controller.

All values are in SI and in the axis' units (rad and N m, or m and N); rows of a log are control periods.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.kernels import law, stage
from stagectl.units import StageError

Array = NDArray[np.float64]


class GapError(StageError):
    """Logs that a diagnosis cannot use, or a question that they cannot answer."""


class LogError(GapError):
    """Logs that cannot be used: which, and why."""

    def __init__(self, reason: str, logs: tuple[str, ...], words: str) -> None:
        super().__init__(words)
        # none | empty | short | duplicate | period | axis | mixed | machine | signal | unit | entry | model
        self.reason = reason
        self.logs = logs  # their names


class NominalValueError(GapError):
    """A value of a nominal.yaml that is missing, of the wrong type, or outside its range."""

    def __init__(self, place: Path, key: str, value: Any, rule: str) -> None:
        shown = "is missing" if value is None else f"= {value!r}"
        super().__init__(f"{place}: {key} {shown}; {rule}")
        self.place = place
        self.key = key  # dotted, as in the file
        self.value = value  # as in the file; None: missing
        self.rule = rule  # what the value must be, with range and unit


class Log(NamedTuple):
    """One repeat of one experiment; position and currents are those of the instant of the row."""

    name: str  # file, as the folder names it
    experiment: str  # logs of one experiment share reference and injection
    repeat: int
    held_out: bool  # for checking results, never for finding them
    start: float  # s, session clock of the first row; temperature and wear run on this clock
    position: Array  # (n,) rad | m
    command: Array | None  # (n,) A, before any limit
    current: Array | None  # (n,) A, reported by the drive
    reference: Array | None  # (n,) rad | m
    injection: Array | None  # (n,) A, added to the command
    valid: NDArray[np.bool_]  # (n,) False in gaps, saturation and faults
    setpoints: Array | None = None  # (n, 8) of kernels.law.Setpoint; None: controller or reference not known
    exact: bool = True  # rows are the control periods themselves; else resampled onto them
    held: bool = True  # a command holds until the next row; else the loop is faster than the log
    carried: float = 0.0  # A, under which the axis stands before the first row: a brake was released with it

    @property
    def rows(self) -> int:
        """Control periods in the log."""
        return len(self.position)

    @property
    def commanded(self) -> bool:
        """Whether the command is what moves the axis, through the drive's model; else it is the measured current."""
        return self.command is not None and (self.held or self.current is None)

    @property
    def driving(self) -> Array:
        """The current (n,) A that moves the axis, held from each row to the next.

        A measured current is not held: it is taken as straight between two rows, by its mean there.
        """
        if self.command is not None and self.commanded:
            return self.command
        assert self.current is not None  # the loader refuses logs without both
        return 0.5 * (self.current + np.append(self.current[1:], self.current[-1:]))


class Session(NamedTuple):
    """All logs of one machine in one state, with the nominal model."""

    place: Path
    kind: str  # rotary | linear
    travel_per_unit: float  # m of table per rad; 1 on a linear axis and on one without a lead
    travel_unit: str  # m | rad, of the travel that the user sees
    dt: float  # s, control period
    stage: stage.Stage  # nominal
    law: law.Law | None  # deployed controller; None: not known
    logs: tuple[Log, ...]
    notes: tuple[str, ...] = ()  # what was done to the data, and what is doubtful
    cannot_tell: tuple[str, ...] = ()  # what is missing, and what cannot be determined because of it
    nominal: Any = None  # nominal.yaml as read, for what only a report needs
    doubts: tuple[str, ...] = ()  # what makes the data themselves doubtful, and so every answer
