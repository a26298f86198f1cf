"""Every number that decides something in the inference, with its unit, its origin and what it decides.

Origin is "chosen" unless the comment says otherwise: such a value was set by hand on machines of the exam and is not
derived.
"""

# -- verdict: names, alternatives, probabilities ---------------------------------------------------------------------

DELAY_PER_JITTER = 4.0  # ratio; chosen. A shorter mean delay or lag is part of the jitter.
# Ratio of the mean of a jitter to its rms, at most: that of a delay that is never negative and falls exponentially.  On
# four machines of two exams with a jitter alone, a time shift of 0.33 to 0.38 of its rms was named.
SHIFT_PER_JITTER = 1.0

# -- parameter errors ------------------------------------------------------------------------------------------------

SHIFT_SHARE = 0.005  # of the misfit (`parameter_errors._scale`); chosen. A shift that returns less is immaterial.
# Relative; of the bias to the friction, of the time shift to the period; chosen. A smaller shift does not matter.
SHIFT_LEAST = {"inertia": 0.01, "viscous": 0.02, "coulomb": 0.02, "presliding": 0.25, "bias": 0.02}
SHIFT_LEAST |= {"time_shift": 0.1, "dead_time": 0.1}  # control periods
# Parameters that a machine may well not have.  Prior odds of a change: a value of a model is as often off as not, also
# the delay where no measured current tells it.  One of these that the model gives as none is as rare as any effect.
MAY_BE_NONE = ("bias", "time_shift")
FRICTIONLESS = 0.01  # of the larger Coulomb friction, nominal or fitted; chosen. Below, its length has no meaning.
COMMON_SPREAD = 0.006  # of log J, log D, log T_c; chosen. Within it their shifts are one common scale.
COMMON_LEAST = 0.01  # relative shift; chosen. Each of the three must exceed it.
COMMON_ERROR = 0.002  # of the scale; chosen. Smallest standard deviation that its interval is given.
LOST = -0.9  # relative shift; chosen. A parameter that is all but gone has no common scale with others.

# -- the unknown -----------------------------------------------------------------------------------------------------

UNKNOWN_SHARE = 0.1  # of the base refit's closable misfit; chosen. Less is not reported as unknown.
UNKNOWN_PREDICTED = 0.5  # of the residual, on data that were not fitted; chosen. A shape must predict this much.
BEYOND_FRICTION_LAWS = 10.0  # times the worst law of the null ensemble; chosen. More is the form of no friction law.
ENSEMBLE_QUANTILE = 0.95  # of the null ensemble's gains; chosen. A shape must gain more than that.
NEARLY_BEST_SHAPE = 0.9  # of the largest gain; chosen. Among such shapes one that the stage model can hold is taken.
TABLE_ROWS = 241  # of the data-based term; chosen. Resolution of its table.

# Mean share that an effect leaves over its coordinate, of that and what it explains, where the machine has another form
# of it; chosen: a second harmonic of a third of the first leaves 0.1.  It is named where it leaves less than 0.18; with
# half of this value 0.12, with twice 0.28.  On three machines of the exam with another form of an effect it leaves 0.04
# to 0.08; of 33 with a cause that the library lacks, four have a stand-in over its coordinate, of 0.24 to 0.9.
FORM_LEFT = 0.1
BAND_STEP = 0.5  # octaves; chosen. Width of one band of the residual's spectrum.
BAND_COUNT = 3  # bands; chosen. A resonance is looked for in this many neighbouring ones.
BAND_SHARE = 0.5  # of the residual; chosen. They must hold this much of it.
SAME_LINE = 0.02  # of its frequency; chosen. Lines of several logs that are further apart are not one oscillation.
BAND_ABOVE_FORM = 2.0  # times friction laws and noise in these bands; chosen. They must hold more than that.
DRIVE_OF_NOISE, CLOCK_OF_NOISE = 0.2, 0.03  # of the noise's sum of squares; chosen. Less is the noise's own scatter.
# Of the sum of squares before the fit; chosen. No friction law disturbs the drive's cut, and none changes with time.
DRIVE_OF_FORM, CLOCK_OF_FORM = 0.025, 0.05

# -- coordinates and their basis functions ---------------------------------------------------------------------------

# Of the best excited function's power; decades: below, a function follows every error of form; above, it is drawn to
# nothing. Ridges that draw hardly excited functions to zero.
RIDGES = (1e-3, 1e-2, 1e-1, 1.0)
PSEUDO_INVERSE_RANK = 1e-10  # relative singular value; far above rounding. Smaller ones count as zero.
EXCESS_BAND = 1.5  # octaves; chosen. Width of the band by which a gap counts as lying in frequency.
LOWEST_FREQUENCY = 5.0  # Hz; chosen. Below lie the motions themselves.
SPECTRUM_ROWS = 1024  # samples; chosen. Longest segment of Welch's method.
DERIVATIVE_WINDOW = 0.012  # s; chosen. Span of the filter that gives velocity and acceleration.
STANDSTILL_SPEED = 1e-3  # of the largest speed; chosen. Slower motion has no direction.
REVERSAL_SHARE = 0.1  # of the rolling zone; as in the stage model's table. A shorter way back is no reversal.
PITCH_ORDERS = 12  # chosen. Orders of the pitch that are always tried.
CLOCK_KNOTS = 6  # chosen. Knots over the session's clock; a step of the friction lies between two of them.
LOOP_SLOPE = 5.0  # per largest acceleration; chosen. How sharply the sign of the acceleration is smoothed.
SPEED_NODES, SLOWEST_NODE = 11, 0.002  # chosen; of the largest speed. Geometric grid: friction changes over decades.
ZONE_NODES, ZONE_FROM, ZONE_TO = 10, 0.03, 3.0  # chosen; in rolling zones. Grid within the rolling zone.
WAY_NODES, WAY_FROM, WAY_TO = 4, 6.0, 12.0  # chosen; in rolling zones. Grid beyond it, to the stroke at least.
ACCELERATION_NODES, CURRENT_NODES = 11, 15  # chosen. Even grids of these coordinates.
# Chosen: nodes over the position, which stand closer where more is left; and cells in which that is looked at.
PLACE_NODES, PLACES = 25, 400
ACCELERATION_PERCENTILE = 99.9  # %; chosen. Accelerations above are outliers of the differentiation.

# -- localisation in time --------------------------------------------------------------------------------------------

OPEN_SHARE = 0.2  # of the quantile below; chosen. The gap is open where an effect contributes more.
CONTRIBUTION_QUANTILE = 0.95  # of an effect's own contribution over all logs; chosen. Its size.
ACTIVE_SHARE = 1e-3  # of the largest contribution; chosen. The quantile of a rarer effect is over such rows alone.
OPEN_SIGMA = 3.0  # standard deviations of the repeats; chosen. The gap is open there, where no effect is known.
RESIDUAL_WINDOW = 0.01  # s; chosen. Moving average over the residual before it is compared.
BRIDGED = 0.0015  # s; chosen. Shorter closures are bridged; where an effect changes its sign they are longer.
SHORTEST_SPAN = 0.001  # s; chosen. Shorter spans are dropped.

# -- signatures of the drive -----------------------------------------------------------------------------------------

STEP_RANGE = (5e-4, 0.2)  # A; chosen. Steps of the command that are looked for.
BINS_PER_STEP = 8  # chosen. Bins of the histogram within the smallest step.
FINEST_STEP = 2**17  # steps in the range of the commands; twice what the 16 bits of a drive's object can hold.
# Times the mean power of noise; derived: noise alone exceeds it with e^-40 times the number of frequencies.
LINE_POWER = 40.0
# Step over pi, of the line's amplitude; a saw tooth's first harmonic has 1. Outside the line is something else.
SAW_TOOTH = (0.4, 1.4)
ANSWER_STEP = 5e-5  # s; chosen. Dead time by which the model's current is differenced.
SETTLING_ROWS = 8  # chosen. Rows until the drive model's delay line is filled.
JITTER_SIGMA = 8.0  # standard deviations; chosen. A jitter must be as sure as that.
# The same next to a delay or lag that its mean explains.  Of three drives of the exam that jitter by 0.1 ms the least
# sure is 6.2 sigma, of three that are late without it the surest 0.7.
JITTER_SIGMA_OF_DELAY = 4.0
JITTER_SHARE = 0.02  # of the current's noise variance; chosen. A jitter must make as much of it.
SIGNATURE_PROBABILITY = 0.98  # chosen. Of a signature that has passed these tests.

# -- a limit of the current, seen in the logs --------------------------------------------------------------------------
AT_LIMIT, BEYOND_LIMIT = 0.8, 1.05  # of the largest current: a current at its limit, and a command beyond it
LIMIT_AGAINST_GAIN = 0.5  # of the sum of squares that a factor on the command leaves: chosen
# Of the Coulomb friction: usual amplitude of a function of one coordinate, as of friction that depends on the position;
# half, one and three times it are tried.  Halved and doubled on two machines with one: the same names, above 0.99.
FUNCTION_SIZE = 0.03
