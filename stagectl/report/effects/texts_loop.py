"""What changes with time, the masses, the drive, the sensor and the controller, in words."""

from __future__ import annotations

from stagectl.report.effects.effect_text import Group, Told

TIME = Group(
    "Over time",
    "What changes from repeat to repeat. The clock is that of the session; repeats of one session share their warmth.",
    (
        Told(
            "thermal_viscous",
            "Grease that warms up: viscous friction falls from cold to warm.",
            "20 to 60 % from cold to warm",
            "viscous friction, where all data are warm (exactly so)",
            "repeats over 30 minutes from cold",
        ),
        Told(
            "thermal_coulomb",
            "Preload that changes with warmth: Coulomb friction drifts.",
            "5 to 20 %",
            "presliding and Coulomb friction, in a short run",
            "repeats over 30 minutes from cold",
        ),
        Told(
            "friction_step",
            "Something happened: friction jumps at one instant of the session, such as a lost seal or new grease.",
            "5 to 30 %",
            "warming",
            "repeats before and after: a change point instead of a drift",
        ),
    ),
)
MECHANICS = Group(
    "Motor, load and base",
    "What is between the motor and the table, and below both.",
    (
        Told(
            "backlash",
            "A gap between motor and load: after a reversal the load is missing at first, then hits.",
            "0.5 to 20 µm",
            "presliding; Stribeck friction",
            "micro-sines, smaller and smaller: play is dead first and stiff then, rolling friction the opposite",
        ),
        Told(
            "compliance",
            "A spring between motor and load: an antiresonance and a resonance.",
            "80 to 1500 Hz, damping 1 to 5 %",
            "vibration of the base; a dead time",
            "a multisine of 20 to 500 Hz at three positions",
        ),
        Told(
            "base_vibration",
            "A machine that rocks on its feet: it rings after every acceleration, while the axis stands.",
            "8 to 60 Hz, mass ratio 0.01 to 0.2",
            "compliance",
            "step and settle; an accelerometer on the base",
        ),
    ),
)
DRIVE = Group(
    "The drive",
    "Seen in cut B, the measured current less that of the drive model. Without a measured current they cannot be told.",
    (
        Told(
            "dead_time",
            "The current acts later than the model says: what is missing is the delay times the slope of the command.",
            "0.5 to 3 ms",
            "the mean of a jitter; a slower current loop",
            "the slope of the phase over frequency, by a multisine",
        ),
        Told(
            "current_loop",
            "The drive's current loop is slower or faster than the model's: what is missing grows with the frequency.",
            "0.1 to 1 ms",
            "dead time",
            "its gain at high frequencies, by a multisine",
        ),
        Told(
            "jitter",
            "The command acts at a time that varies: noise that grows with the slope of the command.",
            "0.01 to 0.5 ms",
            "dead time (its mean)",
            "timestamps: read them",
        ),
        Told(
            "current_quantisation",
            "The command in steps: 0x6071 counts thousandths of the rated current. A saw tooth over the command.",
            "1 to 50 mA",
            "noise",
            "the drive's object dictionary; the spectrum at rest",
        ),
        Told(
            "current_gain",
            "The drive's ampere is not the model's ampere, in what it reports.",
            "0.5 to 3 %",
            "the force constant, exactly",
            "nothing in the logs: it is declared, not guessed; a clamp meter tells",
        ),
        Told(
            "current_offset",
            "The current sensor's zero: the same missing current everywhere.",
            "5 to 100 mA",
            "bias, where no current is measured",
            "a reading with the power stage off",
        ),
        Told(
            "current_saturation",
            "The drive gives less than it is asked for, at its peak or folded back to its continuous current.",
            "1 to 3 times the rated current",
            "voltage saturation",
            "the statusword's bit 11",
        ),
        Told(
            "voltage_saturation",
            "No voltage is left for the current at speed, `|R i + Ke v| <= U`.",
            "near the base speed",
            "current saturation",
            "its slope over the speed",
        ),
    ),
)
SENSOR = Group(
    "Sensor and time",
    "An encoder that errs is followed by the loop: its errors appear as efforts that grow with the speed squared.",
    (
        Told(
            "encoder_eccentricity",
            "The encoder's disc off its centre: an error once a turn, whose force grows with the speed squared.",
            "20 to 170 arcsec",
            "friction once per revolution; cogging of order 1; an error of the lead, which a motor-side encoder does "
            "not see at all",
            "two speeds, or a second sensor",
        ),
        Told(
            "encoder_interpolation",
            "Sine and cosine of unequal size: an error once a signal period.",
            "1 to 20 arcsec",
            "quantisation",
            "a slow creep",
        ),
        Told(
            "time_shift",
            "Current and position are logged at different instants: half a sample is enough to look like inertia.",
            "0.5 to 1 sample",
            "inertia, viscous friction, compliance",
            "always fitted along with the base",
        ),
    ),
)
CONTROLLER = Group(
    "The controller",
    "Seen in cut A, before anything else: where it does not agree, nothing else is looked for.",
    (
        Told(
            "controller",
            "The controller that ran is not the one that is described: the logged command, less the one recomputed "
            "from reference and position, is no rounding error. Shown: a proportional gain of 5 % more.",
            "any",
            "nothing: the command is recomputed to one count",
            "recomputing it; the diagnosis names gain, sign, delay or unit where it can",
        ),
    ),
)
