"""Parameters and state of the plant, block by block; `stage` moves it.

Every field after the first ones of a block is an effect: neutral by default, and then it vanishes bit for bit.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

from stagectl.kernels import effects, friction, friction_bristle
from stagectl.kernels.effects import TURN, Harmonic, Step, Warming
from stagectl.units import Quantity

# A delay line of whole control periods, newest first.
Line = tuple[float, float, float, float, float, float, float, float]

# Fields that a stage file has in other blocks, too: declared here, once.
DeadTime = Annotated[
    float, Quantity("s", "[0, 0.1]", "further delay after nd Ts; both together are at most 7 control periods")
]
Jitter = Annotated[float, Quantity("s", "[0, 0.01]", "rms of a random part of that delay")]
CurrentOffset = Annotated[float, Quantity("A", "[-1e3, 1e3]", "current that is added to the motor current")]
Gain = Annotated[float, Quantity("", "[-0.9, 10]", "g of (1 + g + a sgn c) c + o sgn c, what a command c gives")]
GainAsymmetry = Annotated[float, Quantity("", "[-0.9, 0.9]", "a of that current: positive against negative commands")]
DirectedOffset = Annotated[float, Quantity("A", "[-1e3, 1e3]", "o of that current: an offset with the command's sign")]
LoopDamping = Annotated[
    float, Quantity("", "[0.1, inf]", "damping ratio of the current loop; from 5 on it is of first order")
]
Continuous = Annotated[float, Quantity("A", "(0, inf]", "current to which the limit folds back; inf: never")]
FoldbackTime = Annotated[float, Quantity("s", "(0, 1e5]", "time for which the drive gives its largest current")]
Voltage = Annotated[
    float, Quantity("V", "(0, inf]", "supply voltage U, which |R i + Ke v| does not exceed; inf: no limit")
]
Resistance = Annotated[float, Quantity("ohm", "(0, 1e6]", "resistance of the winding, R")]
BackEmf = Annotated[float, Quantity("V s/rad | V s/m", "[0, 1e6]", "back-EMF constant of the motor, Ke")]
Lag = Annotated[float, Quantity("s", "[0, 10]", "lag of the velocity in Stribeck's factor")]
Asymmetry = Annotated[float, Quantity("", "[-1, 1]", "e of T_c (1 + e sgn v)")]
LoadShare = Annotated[float, Quantity("", "[0, 10]", "friction per motor effort, mu")]
Lead = Annotated[Harmonic, Quantity("", "[-1, 1]", "share of T_c that goes with the lead")]
BallPass = Annotated[Harmonic, Quantity("", "[-1, 1]", "share of T_c that goes with the balls that pass")]
Eccentricity = Annotated[Harmonic, Quantity("rad | m", "[-1, 1]", "error once a turn")]
Interpolation = Annotated[Harmonic, Quantity("rad | m", "[-1, 1]", "error once a signal period")]
InterpolationSecond = Annotated[Harmonic, Quantity("rad | m", "[-1, 1]", "error twice a signal period")]


class Reported(NamedTuple):
    """From the motor current to the one the drive reports: ``i(t - late) (1 + gain) + offset``."""

    gain: Annotated[float, Quantity("", "[-0.9, 10]", "error of the scale")] = 0.0
    offset: Annotated[float, Quantity("A", "[-1e3, 1e3]", "added to the report alone")] = 0.0
    late: Annotated[float, Quantity("s", "[0, 0.1]", "age of the current in the report, up to a control period")] = 0.0


class Drive(NamedTuple):
    """The servo drive between command and motor current."""

    current_quantum: Annotated[float, Quantity("A", "[0, 10]", "step of the command; 0: none")]
    delay_samples: Annotated[int, Quantity("", "[0, 7]", "control periods between command and action, nd")]
    current_limit: Annotated[float, Quantity("A", "(0, inf]", "largest current the drive gives")]
    current_lag: Annotated[float, Quantity("s", "[0, 0.1]", "time constant of the current loop")]
    dead_time: DeadTime = 0.0
    jitter: Jitter = 0.0
    offset: CurrentOffset = 0.0
    continuous_current: Continuous = math.inf
    foldback_time: FoldbackTime = 1.0
    voltage_limit: Voltage = math.inf
    resistance: Resistance = 1.0
    back_emf: BackEmf = 0.0
    telemetry: Reported = Reported()
    gain: Gain = 0.0
    gain_asymmetry: GainAsymmetry = 0.0
    directed_offset: DirectedOffset = 0.0
    current_damping: LoopDamping = math.inf


class Motor(NamedTuple):
    """From current to effort."""

    force_constant: Annotated[float, Quantity("N m/A | N/A", "(0, 1e6]", "effort of one ampere, Kt")]
    cogging: Annotated[Harmonic, Quantity("N m | N", "[-1e6, 1e6]", "effort without current")] = Harmonic()
    cogging_second: Annotated[Harmonic, Quantity("N m | N", "[-1e6, 1e6]", "effort without current")] = Harmonic()
    cogging_third: Annotated[Harmonic, Quantity("N m | N", "[-1e6, 1e6]", "effort without current")] = Harmonic()
    cogging_fourth: Annotated[Harmonic, Quantity("N m | N", "[-1e6, 1e6]", "effort without current")] = Harmonic()
    ripple: Annotated[Harmonic, Quantity("", "[-1, 1]", "share of the current's effort")] = Harmonic()
    ripple_second: Annotated[Harmonic, Quantity("", "[-1, 1]", "share of the current's effort")] = Harmonic()
    ripple_third: Annotated[Harmonic, Quantity("", "[-1, 1]", "share of the current's effort")] = Harmonic()


class Cable(NamedTuple):
    """A cable that pulls towards its centre, and drags: ``k (x - centre) + hysteresis s``.

    ``ds/dx = (1 - s sgn(dx))^exponent / slip`` (Dahl): an exponent of 0 is a spring that slips at once, a Maxwell
    element; 1 bends towards its force as cables in a chain do.
    """

    stiffness: Annotated[float, Quantity("N m/rad | N/m", "[0, 1e9]", "k; 0 is neutral")] = 0.0
    centre: Annotated[float, Quantity("rad | m", "[-1e6, 1e6]", "position at which it does not pull")] = 0.0
    hysteresis: Annotated[float, Quantity("N m | N", "[0, 1e6]", "force of the part that drags; 0 is neutral")] = 0.0
    slip: Annotated[
        float, Quantity("rad | m", "(0, 1e3]", "length over which it drags: its force over its stiffness at rest")
    ] = 1.0
    exponent: Annotated[float, Quantity("", "[0, 4]", "how it goes over into slip; 0: at once, 1: Dahl")] = 0.0


class Transmission(NamedTuple):
    """Motor and load with a spring, a damper and a gap between them; rigid without share or resonance."""

    load_share: Annotated[
        float, Quantity("", "[0, 0.99]", "share of the inertia that is behind the spring; 0: rigid")
    ] = 0.0
    resonance: Annotated[float, Quantity("Hz", "[0, 5000]", "resonance of motor against load, both free; 0: rigid")] = (
        0.0
    )
    damping: Annotated[float, Quantity("", "[0, 2]", "damping ratio of that resonance")] = 0.03
    backlash: Annotated[float, Quantity("rad | m", "[0, 1]", "full gap between motor and load")] = 0.0
    load_friction: Annotated[float, Quantity("", "[0, 1]", "share of friction at the load; the rest at the motor")] = (
        1.0
    )


class Base(NamedTuple):
    """The machine's base on its feet, pushed back by the motor."""

    ratio: Annotated[float, Quantity("", "[0, 10]", "moving mass over that of the base, mu; 0 is neutral")] = 0.0
    frequency: Annotated[float, Quantity("Hz", "(0, 1000]", "natural frequency of the base on its feet")] = 20.0
    damping: Annotated[float, Quantity("", "[0, 2]", "damping ratio of that mode")] = 0.02


class SpeedPower(NamedTuple):
    """Friction by a power of the speed, next to the linear one: ``effort (|v| / speed)^exponent sgn v``.

    Below 1 it is what bearings and grease have (two thirds: A. Palmgren, Ball and Roller Bearing Engineering, 1959), 2
    is drag.  A negative effort bends the other way; with an exponent above 1 it takes at most all of the linear part.
    """

    effort: Annotated[float, Quantity("N m | N", "[-1e6, 1e6]", "friction at `speed`; 0 is neutral")] = 0.0
    speed: Annotated[float, Quantity("rad/s | m/s", "(0, 1e4]", "speed at which it is `effort`")] = 1.0
    exponent: Annotated[float, Quantity("", "[0.1, 4]", "power of the speed")] = 2.0


class Mechanics(NamedTuple):
    """All that moves, seen at the motor."""

    inertia: Annotated[float, Quantity("kg m^2 | kg", "(0, 1e6]", "moving inertia J or mass M")]
    viscous: Annotated[float, Quantity("N m s/rad | N s/m", "[0, 1e6]", "viscous friction D")]
    bias: Annotated[float, Quantity("N m | N", "[-1e6, 1e6]", "constant effort on the axis, e.g. gravity")] = 0.0
    pitch: Annotated[
        float, Quantity("rad | m", "(0, 1e6]", "travel over which the angle of the harmonics turns once")
    ] = TURN
    viscous_power: SpeedPower = SpeedPower()
    viscous_asymmetry: Annotated[float, Quantity("", "[-1, 1]", "e of D (1 + e sgn v)")] = 0.0
    viscous_warming: Warming = Warming()
    viscous_step: Step = Step()
    cable: Cable = Cable()
    transmission: Transmission = Transmission()
    base: Base = Base()
    gravity: Annotated[Harmonic, Quantity("N m | N", "[-1e6, 1e6]", "effort against the motion by the angle")] = (
        Harmonic()
    )


class Dwell(NamedTuple):
    """Ageing of the contact at rest: a factor ``1 + rise ln(1 + t_d / time)``, removed by slip."""

    rise: Annotated[float, Quantity("", "[0, 10]", "rise per e-fold of the time at rest; 0 is neutral")] = 0.0
    time: Annotated[float, Quantity("s", "(0, 1e6]", "time at rest from which it grows")] = 0.1
    length: Annotated[
        float, Quantity("rad | m", "[0, 1e3]", "slip after which it is gone; 0: mean slip of the friction")
    ] = 0.0


class Along(NamedTuple):
    """A factor over the stroke, ``1 + slope (x - centre) + bow (x - centre)^2``, never below 0."""

    slope: Annotated[float, Quantity("1/rad | 1/m", "[-1e6, 1e6]", "linear part; 0 is neutral")] = 0.0
    bow: Annotated[float, Quantity("1/rad^2 | 1/m^2", "[-1e9, 1e9]", "quadratic part; 0 is neutral")] = 0.0
    centre: Annotated[float, Quantity("rad | m", "[-1e6, 1e6]", "position at which the factor is 1")] = 0.0


class Friction(NamedTuple):
    """What depends on displacement and on the sign of the motion: a bundle of stop operators, a bristle, or both."""

    operators: friction.StopOperators
    stribeck: friction.Stribeck  # of the operators
    bristle: friction_bristle.Bristle = friction_bristle.NEUTRAL
    lag: Lag = 0.0
    asymmetry: Asymmetry = 0.0
    dwell: Dwell = Dwell()
    load: LoadShare = 0.0
    along: Along = Along()
    lead: Lead = Harmonic()
    lead_second: Lead = Harmonic()
    ball_pass: BallPass = Harmonic()
    warming: Warming = Warming()
    step: Step = Step()


class Encoder(NamedTuple):
    """From true to measured position."""

    step: Annotated[float, Quantity("rad | m", "[0, 1]", "one count; 0: continuous")]
    delay_samples: Annotated[int, Quantity("", "[0, 7]", "control periods from latch to controller, nm")]
    eccentricity: Eccentricity = Harmonic()
    interpolation: Interpolation = Harmonic()  # offsets of the sine and cosine signals
    interpolation_second: InterpolationSecond = Harmonic()  # their unequal gains, and an angle that is not square


class Stage(NamedTuple):
    """Parameters of the whole plant, in physical order."""

    drive: Drive
    motor: Motor
    mechanics: Mechanics
    friction: Friction
    encoder: Encoder
    residual: effects.Table = effects.NO_TABLE


class Contact(NamedTuple):
    """Friction at one instant, of one of two bodies as if all of it were there."""

    force: float  # N m | N
    bristle: float  # rad | m, its deflection
    lagged: float  # rad/s | m/s, velocity in Stribeck's factor
    rested: float  # s, age of the contact


class Memory(NamedTuple):
    """What the effects remember; untouched where they are neutral."""

    time: float  # s, session clock
    begun: Line  # s, session clock of the last commands, newest first
    acting: float  # s, session clock of the command that acts
    before: float  # A, motor current at the last command
    heat: float  # A^2, of the drive's foldback
    load: float  # rad | m, position of the load behind the transmission
    load_velocity: float  # rad/s | m/s
    base: float  # rad | m, position of the base
    base_velocity: float  # rad/s | m/s
    lagged: float  # rad/s | m/s, velocity in Stribeck's factor
    rested: float  # s, age of the contact
    cable: float  # share of the force with which it drags, in [-1, 1]
    turned: float  # rad | m, last reversal
    furthest: float  # rad | m, since then
    direction: float  # of the motion since then: -1, 0 before any, 1
    rate: float  # A/s, of the motor current
    behind: Contact  # friction at the load behind the transmission
    stops: Any  # (n,) operators of the rolling friction there, changed in place


class State(NamedTuple):
    """The plant at the start of a control period."""

    commands: Line  # A
    latched: Line  # rad | m, true positions at the starts of the last periods
    current: float  # A, in the motor
    position: float  # rad | m
    velocity: float  # rad/s | m/s
    force: float  # N m | N, friction at the motor, as if all of it were there; not kept where all is at the load
    stops: Any  # (n,) operators of the rolling friction, changed in place
    bristle: float  # rad | m, deflection of the bristle
    memory: Memory  # of the effects


class Noise(NamedTuple):
    """One period's random numbers, drawn outside."""

    current: float  # A, added to the motor current during the period
    position: float  # rad | m, added before the encoder rounds
    delay: float  # s, added to the dead time during the period


SILENT = Noise(0.0, 0.0, 0.0)
NO_COMMANDS: Line = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
