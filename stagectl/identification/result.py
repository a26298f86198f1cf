"""The result of an identification, the same for every method: screen, JSON, figures and stage file read it."""

import enum
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from stagectl.units import unit_on

Progress = Callable[[int, int], object]  # (steps done, steps in all)
NOTHING: Mapping[str, Any] = MappingProxyType({})
UNITS = {  # SI unit of a parameter on a rotary and on a linear axis; by the first word of its name
    "inertia": "kg m^2 | kg",
    "viscous": "N m s/rad | N s/m",
    "coulomb": "N m | N",
    "gravity": "N m | N",
    "offset": "N m | N",
    "delay": "s",
}


def unit_of(name: str, kind: str) -> str:
    """SI unit of the parameter `name` on an axis of this `kind`."""
    return unit_on(kind, UNITS[name.split("_")[0]])


class Parameter(NamedTuple):
    """A value with its 95 % interval, in `unit` (SI)."""

    value: float
    low: float
    high: float
    unit: str

    @classmethod
    def around(cls, value: float, half: float, unit: str) -> Self:
        """A value whose interval reaches as far, `half`, either way."""
        return cls(value, value - half, value + half, unit)

    @classmethod
    def named(cls, name: str, kind: str, value: float, half: float) -> Self:
        """The same in the unit of the parameter `name` on an axis of this `kind`."""
        return cls.around(value, half, unit_of(name, kind))

    @property
    def half(self) -> float:
        """Half of the interval."""
        return 0.5 * (self.high - self.low)


class Characteristic(NamedTuple):
    """Rolling friction: stop operators, and the reversal table they make.

    ``force(s) = sum_j clip(-weight_j + weight_j / slip_j s, -weight_j, weight_j)``, s from a reversal on.
    """

    displacement: NDArray[np.float64]  # (m,) rad | m, from 0 up
    force: NDArray[np.float64]  # (m,) N m | N, from -T_c to +T_c
    weight: NDArray[np.float64]  # (j,) N m | N
    slip: NDArray[np.float64]  # (j,) rad | m

    @classmethod
    def over(cls, displacement: NDArray[np.float64], weight: NDArray[np.float64], slip: NDArray[np.float64]) -> Self:
        """The table of operators (j,) at these displacements (m,) since a reversal."""
        return cls(displacement, np.clip(displacement[:, None] / slip - 1.0, -1.0, 1.0) @ weight, weight, slip)

    @property
    def block(self) -> dict[str, Any]:
        """The friction block of a stage file with these operators."""
        return {"law": "stop-operators", "weight": self.weight.tolist(), "slip": self.slip.tolist()}


class Topic(enum.StrEnum):
    """What a note is about."""

    AT_REST = "at rest"
    ACCELERATION_BOUND = "acceleration bound"  # a form of friction that holds for one acceleration only
    AFTER_REVERSALS = "after reversals"  # a residual concentrated there
    BEND = "bend"  # of the viscous friction, over the speed
    CLIPPED = "clipped"
    CONSTANT_CURRENT = "constant current"
    COHERENCE = "coherence"
    CONTRADICTED = "contradicted"  # a value of the stage file that the record denies
    DELAY = "delay"
    FORCE_CONSTANT = "force constant"
    FROZEN = "frozen"  # a position that does not change
    GAPS = "gaps"
    JUMP = "jump"  # of the position
    LATE = "late"  # a force that is not of the position's instant
    LEFT_OUT = "left out"
    LIMIT = "limit"  # of the stage file, exceeded
    METHOD = "method"  # how the data were treated
    MODEL_CHOICE = "model choice"
    NOT_IDENTIFIED = "not identified"
    OFFSET = "offset"
    PERIODIC = "periodic"  # the reference repeats
    PRECISION = "precision"  # an interval is wide
    REFERENCE = "reference"
    RESAMPLED = "resampled"
    RESIDUAL = "residual"
    REVOLUTION = "revolution"  # a span shorter than one
    RIPPLE = "ripple"
    STANDSTILL = "standstill"
    STAND_IN = "stand-in"  # another column serves as the motor's current
    TIED = "tied"  # two parameters that the motion does not separate
    TOO_FAST = "too fast"
    UNSETTLED = "unsettled"
    UNITS = "units"  # a wrong factor or sign of a column
    WITHHELD = "withheld"  # left out of the stage file's changes


BIASING = frozenset({Topic.AFTER_REVERSALS, Topic.LATE, Topic.REVOLUTION, Topic.TOO_FAST, Topic.UNSETTLED})
"""Notes on an error that no interval holds: what stands beside one is written only where that is asked for."""


class Note(str):
    """A sentence for the user, with a topic that a program can read."""

    topic: Topic
    __slots__ = ("topic",)

    def __new__(cls, topic: Topic, text: str) -> Self:
        """A note on `topic`."""
        note = super().__new__(cls, text)
        note.topic = topic
        return note


class IdentificationResult(NamedTuple):
    """What one method found from all captures together."""

    parameters: dict[str, Parameter]  # inertia, viscous, coulomb, offset, delay, ...
    table: Characteristic | None = None
    details: Mapping[str, Any] = NOTHING  # JSON values: correlations, residuals, curves that the figures draw
    notes: tuple[str, ...] = ()  # for the user: what cannot be separated, what is doubtful
    changes: Mapping[str, Any] = NOTHING  # of the stage file, by dotted key, SI: {"mechanics.inertia": 0.0101}


def biases(notes: tuple[str, ...]) -> list[str]:
    """Those of the `notes` that tell of a bias."""
    return [note for note in notes if isinstance(note, Note) and note.topic in BIASING]


def topics(notes: tuple[str, ...]) -> set[Topic]:
    """Topics of all `notes` that have one."""
    return {note.topic for note in notes if isinstance(note, Note)}
