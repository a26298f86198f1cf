"""One effect: what is known about it before any data are seen.  The records stand in effects.toml.

An effect is written as amplitudes, which enter almost linearly and are zero when it is absent, and shapes, which do not
and come from a grid.  It changes the stage model and nothing else: the same fields play it in the virtual drive and are
written into the stage file.
"""

import enum
import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from stagectl.kernels.stage import Stage
from stagectl.units import unit_on

Values = Mapping[str, float]
CONTROLLER, DRIVE, MECHANICS, SENSOR = "controller", "drive", "mechanics", "sensor"  # blocks of the signal chain
FAMILIES = (
    "parameters",
    "friction over speed",
    "friction with memory",
    "over position",
    "over the session",
    "structure",
    "drive",
    "encoder and record",
    "controller",
)


class Data(enum.Flag):
    """Data that show two effects alike."""

    ALL = enum.auto()  # all logs of one axis, whatever it does
    WITHOUT_CURRENT = enum.auto()  # logs without a measured current
    ONE_SPEED = enum.auto()  # logs of one speed
    IN_OPERATION = enum.auto()  # a minute of ordinary operation: few motions, a warm machine
    FEW_MOTIONS = enum.auto()  # a battery without the motions that separate them


class Scales(NamedTuple):
    """Sizes of one machine and its session, from which typical values and grids follow."""

    coulomb: float  # N m | N
    viscous: float  # N m s/rad | N s/m
    force_constant: float  # N m/A | N/A
    length: float  # rad | m, of the rolling zone
    speed: float  # rad/s | m/s, largest in the logs
    centre: float  # rad | m, middle of the travel in the logs
    stroke: float  # rad | m, half of that travel
    current: float  # A, largest in the logs
    pitch: float  # rad | m
    dt: float  # s
    session: tuple[float, ...] = ()  # s, session clock of each log's first row
    voltage: float = 0.0  # V, largest that the motor needed; 0: resistance or back-EMF not known
    modes: tuple[float, ...] = ()  # Hz, of the resonances in the residual
    periods: float = 0.0  # encoder periods per pitch; 0: not known
    delay: float = 0.0  # s, from command to current in the nominal model, without the current loop
    lag: float = 0.0  # s, of the nominal current loop
    commanded: bool = True  # whether a command was logged: else the current is what was measured
    measured: bool = True  # whether a current was
    rotates: bool = False  # whether the position is an angle of what moves, so that gravity goes with it
    orders: Mapping[str, tuple[float, ...]] = MappingProxyType({})  # of each harmonic effect, seen in the residual


class Amplitude(NamedTuple):
    """A parameter that is zero when the effect is absent, and enters almost linearly around its typical sizes."""

    name: str
    unit: str  # rotary | linear
    typical: tuple[float, ...]  # sizes at which its column is taken; several where the effect is far from linear
    low: float = -math.inf
    high: float = math.inf


class Shape(NamedTuple):
    """A parameter that does not enter linearly: searched on a grid, then refined between its limits."""

    name: str
    unit: str
    grid: tuple[float, ...]
    refined: bool = True  # False: a choice
    low: float = 0.0
    high: float = math.inf
    share: bool = False  # of something that two parts have: nothing and all are values like any other
    width: float = math.inf  # a change by which its column becomes another one


class TimeVariation(NamedTuple):
    """How an effect runs on the session clock: a factor on what a scaled parameter does, as slow as it is."""

    of: Mapping[str, str]  # parameter that each amplitude scales: coulomb | viscous
    factor: Callable[[Values, Any], Any]  # of the shapes and of the session clock (n,) s


class Parameters(NamedTuple):
    """The parameters of an effect on one machine, and what they do to its model."""

    amplitudes: tuple[Amplitude, ...]
    shapes: tuple[Shape, ...]
    apply: Callable[[Stage, Values], Stage]
    time_variation: TimeVariation | None = None  # runs on the session clock: repeats differ by it
    resonant: bool = False  # so sharp in its shapes that a fit must begin near: every place on their grid is tried
    nonlinear: bool = False  # its columns hold at their typical sizes only


ParametersOf = Callable[[Scales], Parameters | None]  # None: the effect is not searched for on this machine


class Effect(NamedTuple):
    """One effect, or one parameter of every model, on any machine."""

    name: str  # as commands, JSON and stage files have it
    label: str  # as texts have it; unless given, the name with blanks
    family: str  # of FAMILIES, by which results are summed up
    coordinate: str  # over which its residual is drawn; unless given, the first of `seen_over`
    block: str = MECHANICS  # of the signal chain
    seen_over: tuple[str, ...] = ()  # coordinates that may order its residual, this or another one
    places: tuple[str, ...] = ()  # fields of the stage model that it changes
    experiments: tuple[str, ...] = ()  # that excite it: their names or their families
    parameters: ParametersOf | None = None  # unless given, it is not searched for on any machine
    look_alikes: Mapping[str, Data] = MappingProxyType({})  # other effects, and the data that show both alike
    generalisations: tuple[str, ...] = ()  # effects of which this one is a special case
    extends: str = ""  # effect that this one replaces and adds something to
    nominal: bool = False  # every model has it: a change of it is an error of a parameter
    force_scaled: bool = False  # an error of the force constant scales its fitted value
    in_stage_file: bool = True  # the stage file has entries for its `places`
    answer: str = "current"  # of the controller: current | map (in the target) | design (loop, look-ahead) | none


class Definition(NamedTuple):
    """An effect as the search has it on one machine."""

    name: str
    block: str
    coordinate: str
    amplitudes: tuple[Amplitude, ...]
    shapes: tuple[Shape, ...]
    apply: Callable[[Stage, Values], Stage]
    time_variation: TimeVariation | None = None
    resonant: bool = False
    nonlinear: bool = False


def definition(effect: Effect, scales: Scales) -> Definition | None:
    """The effect on a machine of these sizes; None where it has no parameters there."""
    parameters = effect.parameters(scales) if effect.parameters else None
    return None if parameters is None else Definition(effect.name, effect.block, effect.coordinate, *parameters)


def units_of(effect: Definition, kind: str) -> dict[str, str]:
    """The unit of each parameter on an axis of this `kind`."""
    declared: list[Amplitude | Shape] = [*effect.amplitudes, *effect.shapes]
    return {parameter.name: unit_on(kind, parameter.unit) for parameter in declared}
