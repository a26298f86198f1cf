"""The result of a diagnosis: the page, the JSON and the patch all read it."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.gap.effects.effect import CONTROLLER, DRIVE, MECHANICS, SENSOR
from stagectl.identification.result import Parameter
from stagectl.number_format import Travel

Array = NDArray[np.float64]

VERDICTS = ("none", "parameters", "effects", "effects+unknown", "unknown", "controller", "not-identifiable")
BLOCKS = (CONTROLLER, DRIVE, MECHANICS, SENSOR)  # of the signal chain, in its order
PARAMETERS = "parameters"  # all shifted parameters together, among the shares
FORM = "form of the rolling friction"  # among the shares: the curve of the law, whatever its size
UNEXPLAINED, NOISE = "repeatable but unexplained", "not repeatable"  # names among the shares
NAMED = 0.5  # probability from which an effect counts as named: more likely there than not

Setting = float | str | tuple[float, ...]  # a value of the stage file, in SI; a word; a list
Fields = tuple[tuple[str, Setting], ...]  # (dotted place in the stage file, its new value)
Value = Parameter  # of an effect, with its 95 % interval


class FoundEffect(NamedTuple):
    """An effect, or a parameter error, by its name in the library."""

    name: str
    alternatives: tuple[str, ...]  # effects that explain these data as well
    probability: float  # that it is this one; >= 0.5: named
    share: float  # of the closable gap
    parameters: dict[str, Value]
    block: str = "mechanics"  # of BLOCKS
    fields: Fields = ()  # of the stage file; with "friction.law" among them that block is replaced as a whole
    parameter: bool = False  # every model has it: an error of its value
    coordinate: str = "none"
    choices: tuple[tuple[str, Fields], ...] = ()  # alternatives in its place, with their fields


FLOORS = 2.0  # times the floor: a larger gap is not closed; from the issue that asked for it


class Gap(NamedTuple):
    """A root mean square gap on the held-out runs, before and after."""

    before: float
    after: float
    floor: float  # repeat to repeat
    unit: str
    closure: float  # 1 - (after^2 - floor^2) / (before^2 - floor^2)
    low: float  # 95 % interval of the closure, by cluster bootstrap over half strokes
    high: float
    predicted: float | None = None  # closure expected beforehand, on the data that chose the effects
    effort: float | None = None  # N m | N, root mean square of the effort itself, where the gap is one of effort

    @property
    def shrinks(self) -> bool:
        """Whether it decreases: significantly, where its interval is known."""
        return self.after < self.before if math.isnan(self.low) else self.low > 0.0

    def at_floor(self, size: float) -> bool:
        """Whether a gap of `size` lies at what repeats differ by; a gap that is not known says nothing."""
        return not size > FLOORS * self.floor


def closable(shares: Mapping[str, float]) -> float:
    """Share of the squared gap that is no noise."""
    return max(1.0 - shares.get(NOISE, 0.0), 1e-9)


class Coordinate(NamedTuple):
    """How much of the gap a smooth function of one coordinate explains."""

    name: str  # speed, acceleration, direction, displacement_since_reversal, position, position_mod_pitch, ...
    share: float


class Spans(NamedTuple):
    """When the gap is open in one log."""

    file: str
    spans: tuple[tuple[float, float], ...]  # s
    duration: float = 0.0  # s, of the log


class Part(NamedTuple):
    """Who holds a share of the gap: a named effect, `PARAMETERS`, or `UNEXPLAINED` of one block."""

    name: str
    block: str  # of BLOCKS
    coordinate: str
    share: float  # of what the nominal model leaves above the floor of repeats


class UnknownTerm(NamedTuple):
    """The unexplained part of the residual, as a function of the coordinate that orders it best."""

    coordinate: str
    grid: Array  # of that coordinate
    force: Array  # N m | N
    predicted: float  # share of the residual that it predicts on data it has not seen
    fields: Fields = ()  # its data-based term in the stage file
    block: str = "mechanics"  # "drive": `force` is a current (A)
    line: float | None = None  # Hz, of one line that holds it


UNORDERED = UnknownTerm("none", np.zeros(0), np.zeros(0), 0.0)  # repeats, and follows no coordinate


class Trace(NamedTuple):
    """One held-out run, measured against simulated."""

    file: str
    time: Array  # s
    reference: Array  # rad | m
    before: Array  # simulated minus measured, rad | m
    after: Array
    floor: float


class NextExperiment(NamedTuple):
    """The experiment that separates ambiguous effects, or shows what no run has shown."""

    name: str
    trajectory: str  # file that `run` takes; empty for an experiment by hand
    separates: tuple[str, ...]
    separation_sigma: float
    duration: float  # s of machine time
    words: str = ""  # what it does, and what the user does by hand
    text: str = ""  # YAML of the trajectory


HELD_OUT = "held-out runs"
UNFITTED = "blocks left out of the fit"  # of the runs that the answer comes from, where none is held out


class DiagnosisResult(NamedTuple):
    """All of it."""

    verdict: str
    sentence: str
    effects: tuple[FoundEffect, ...]
    gap: Gap  # of the measured position; of the effort where no controller is known
    gaps: dict[str, Gap]  # the same for tracking error, effort, current
    blocks: dict[str, float | None]  # excess share of each of BLOCKS; None: not judged
    coordinates: tuple[Coordinate, ...]
    captures: tuple[Spans, ...]
    shares: tuple[tuple[str, float], ...]  # parameters | FORM | each effect | UNEXPLAINED | NOISE; together 1
    parts: tuple[Part, ...] = ()  # whose the gap is
    next_experiment: NextExperiment | None = None
    unknown: UnknownTerm | None = None
    traces: tuple[Trace, ...] = ()
    doubts: tuple[str, ...] = ()  # what makes the data themselves doubtful: said first
    notes: tuple[str, ...] = ()
    cannot_tell: tuple[str, ...] = ()
    kind: str = "rotary"
    travel_per_unit: float = 1.0
    force_constant: float = 0.0  # N m/A | N/A, of the nominal model; 0: not known
    travel_unit: str = "m"
    seconds: tuple[tuple[str, float], ...] = ()  # of each step
    reason: str = ""  # a sentence: the fault of the controller, or why nothing is identifiable
    impossible: tuple[tuple[str, str], ...] = ()  # (one of BLOCKS, why it could not be judged)
    judged_on: str = HELD_OUT  # what the gaps are of
    friction: Fields = ()  # the law of the improved model; empty where its form takes nothing of the gap

    @property
    def travel(self) -> Travel:
        """How positions of this axis are shown."""
        return Travel(self.travel_per_unit, self.travel_unit, self.kind == "rotary")

    @property
    def writes(self) -> bool:
        """Whether a stage file can hold anything of it."""
        return bool(self.friction) or any(effect.fields for effect in self.named)

    @property
    def named(self) -> tuple[FoundEffect, ...]:
        """The effects that count as named, in their order."""
        return tuple(effect for effect in self.effects if effect.probability >= NAMED)
