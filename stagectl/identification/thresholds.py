"""Numbers that decide something in an identification: what each decides, its unit, and its origin.

"Chosen" means chosen on simulated and recorded captures, not derived.  A share has no unit.  A constant without its own
origin has that of the line above its group.
"""

from stagectl.recording.constants import ROWS_TO_USE

# Intervals of 95 %.
NORMAL_95 = 1.959964  # standard deviations either way; normal distribution, seven digits
QUANTILE_95 = 0.975  # two-sided quantile of Student's distribution
CORRELATION_RIDGE = 1e-12  # added to a correlation of 1: rounding
TIED = 0.9  # correlation from which two parameters are reported as tied; chosen

# Records: the least that is accepted, and how they are split.  Chosen.
CAPTURE_LEAST_ROWS = ROWS_TO_USE  # rows of a record or of a part between gaps
PART_LEAST_SHARE = 0.02  # of the longest part's rows: shorter parts are left out
GAP_STEPS = 3.5  # median steps that make a gap: one or two lost rows do not
JITTER = 1e-3  # of the mean step: digits of the time stamps, not irregular sampling
ROUNDED_STAMPS = 0.02  # of a step: largest deviation of rounded time stamps from equal spacing
LEAST_EXCITATION = 1e-6  # A, below it a current is constant
LEAST_ENCODER_STEPS = 10.0  # encoder steps of travel from which an axis has moved enough for a response

# Checks of a capture against the stage file.  Chosen; a nominal model may be wrong by a factor of three.
MOVED_STEPS = 2.5  # encoder steps: below, the axis did not move
BEYOND_LIMIT = 1.5  # times a limit of the stage file: more than any overshoot
COARSE_STEPS = 30.0  # encoder steps: coarser positions have lost digits
WHOLE = 0.02  # of a step: a count as an export rounds it; a wrong unit is off by a half in one of two rows
STEP_ROWS = 20000  # rows in which the step of the positions is looked for
FAR_FROM_NOMINAL = 30.0  # factor from the stage file's value, either way, that is reported
# A stage file has its inertia from a drawing, its frictions from runs and guesses: each may err by a factor of three,
# but not all three by the same one.  What they have in common is the scale of the force.
FORCE_SCALE = 3.0  # factor that all three are off by, either way: more than one nominal value errs by
ONE_FACTOR = 1.5  # largest over smallest of their factors that are one: intervals, and a friction of another day
CAUSE_DECADES = 1.0  # powers of ten by which a wrong unit may miss what was found, as the nominal values may be wrong
ALIKE_DECADES = 0.1  # of the same: wrong units that fit as well as the best one
CONTRADICTORY = 10.0  # % of the force that captures leave together, from which each is asked by itself: models leave 5
APART = 0.5  # of that share: what a capture that fits by itself leaves
JUMP = 10.0  # times the step of 99 % of the rows: a misread row
FROZEN_ROWS, PUSHED_ROWS = 0.05, 0.3  # of the rows: position without change, and of these with a current that moves
FROZEN_FRICTION = 2.0  # times the stage file's sliding friction: a current that moves the axis
AT_CURRENT_LIMIT = 0.999  # of the drive's current limit, from which a sample is at the limit

# Filter of the linear regressions; Gautier and Poignet 2001 (cut-off), the rest chosen.
FILTERED_LEAST_ROWS = 50  # rows after decimation; twelve for each parameter of the smallest model
FILTER_EDGE = 5.0  # periods of the cut-off frequency that are cut off at each end
CUTOFF_SHARE = 0.1  # cut-off over sampling rate
HIGHEST_CUTOFF = 0.8**-4  # times that share, of a slow log: the low-pass before the decimation is then at a tenth
USUAL_CUTOFF = 100.0  # Hz, of robots: no slow log needs more
CUT_MOTION = 0.1  # largest share of the acceleration's variance above that low-pass; a robot's slow joints have 0.02
LOWEST_CUTOFF_SHARE = 0.005  # cut-off over sampling rate below which nothing is tried
ACCELERATION_NOISE = 0.01  # largest share of the acceleration's variance that may be encoder noise
STIFFEST_SCORES = 0.97  # autocorrelation of the scores beyond which a record is a trend; bounds Andrews' bandwidth

# Least squares.  Chosen.
BOTH_DIRECTIONS = 0.05  # least share of the samples in the rarer direction
DIRECTION_SPEED = 0.01  # of the largest speed: slower has no direction
STANDING_SPEED = 0.003  # of the largest speed: slower, for long, is standstill
STANDING_PERIODS = 10.0  # periods of the cut-off frequency that a standstill must last
WORST_CONDITION = 1e4  # of the regressor with columns of unit length
AFTER_REVERSAL = 0.1  # of the way from one reversal to the next that counts as after a reversal
STROKE_LEAST_SHARE = 0.1  # of the longest way: shorter ones are noise around standstill
CONCENTRATED = 1.5  # rms after reversals over rms elsewhere; 1.0 where sgn(v) is right, up to 1.3 with a soft step
VISIBLE_RESIDUAL = 0.005  # of the Coulomb friction: a smaller residual is not reported
AFTER_REVERSAL_ROWS = 20  # rows after reversals and elsewhere that a comparison needs

# Constant speed.  Chosen.
SPEED_BLOCK = 0.02  # s, over which a speed is taken
SPAN_EVEN = 0.03  # largest relative deviation of a block's speed from the middle of its span's
SPEED_BLOCK_STEPS = 4.0  # encoder steps by which a block's length may err
SPAN_LEVEL = 0.01  # largest relative difference between the thirds of a span: excludes the peak of a sine
SHORTEST_SPAN = 0.1  # s
SPAN_SETTLING = 0.1  # s at the start of a span in which the force still settles; at most a quarter of it
SPEEDS_APART = 0.05  # relative difference of two speeds
SPAN_INERTIAL = 0.02  # share of the force that may be inertial over a span
RIPPLES = 4  # harmonics of a revolution that are removed before a mean's deviation is taken
SPAN_BATCHES = 10  # batches of a span, for the deviation of its mean
SPAN_CLIPPED = 0.01  # largest share of a span's samples at the current limit
LINE_SCATTER = 3.0  # scatter of the means about the line, over their own deviation, that is reported

# Low speed.  Chosen on the paper's motion, 50 um at 0.05 Hz.
STROKE_BLOCK = 0.01  # s, longest block over which position and force are averaged
STROKE_BLOCKS = 1000.0  # least number of blocks of a stroke
STROKE_TURN = 0.25  # of the whole range: return that makes a reversal
STROKE_APPROACH = 0.45  # of a stroke: way before its first reversal that brings the friction into its direction
STROKE_USED = 0.95  # of a stroke that is used: near its end the axis is so slow that noise shakes the friction loose
STROKE_STEPS = 100.0  # least encoder steps of a stroke
FINEST_SLIP = 8.0  # encoder steps: slip of the stiffest element
WIDEST_SLIP = 0.4  # of a stroke: slip of the softest element; its bend is at twice that
SLIPS_PER_DECADE = 10
LATE_DOUBTFUL, LATE_REFUSED = 0.05, 0.3  # of the force that still rises over the last half of the stroke
FAST_DOUBTFUL, FAST_REFUSED = 0.01, 0.2  # of the force that is viscous and inertial
STROKE_BATCHES = 5  # batches of a stroke's end, for the intervals
TABLE_POINTS, STROKE_POINTS = 256, 500  # rows of the table; points of a stroke that the figure gets
CARRYING = 1e-6  # of the sum of weights: below it an element has no weight; rounding

# Frequency response.  Chosen, but for those with a source.
IMAGES = 200  # of the staircase, either way, whose sum is taken; converged
COHERENT = 0.9  # least coherence of a line that is used
WELCH_SEGMENTS = 12  # least number of Welch's half overlapping segments
WELCH_NEIGHBOUR = 0.3  # of the strongest of five bins: weaker ones are leakage
WELCH_FLOOR = 1e-4  # of the strongest bin's power: weaker ones were not excited
WELCH_LOWEST = 4.0  # bins: lower ones hold leakage of the mean
HIGHEST_LINE = 0.4  # of the sampling frequency: highest line that is used
DWELL_PERIODS = 3  # least number of equal periods that are a dwell of a stepped sine
DWELL_NOISE, DWELL_FLOOR = 5.0, 0.03  # of the noise, and of the largest value: further from zero is not about it
DWELL_LENGTH, DWELL_ROWS = 0.015, 1.5  # relative difference of two periods, and rows, within which they are equal
DWELL_SIZE = 0.15  # relative difference of their peak to peak values
DWELL_SETTLING = 0.25  # of a dwell's periods, one at least: until the motion has settled
DWELL_LEFT = 0.2  # of the variance: what a sine may leave of a dwell; a square wave leaves 0.19
DWELL_BEND = 0.1  # rad by which the phase of a dwell may bend: more is a sweep
DWELL_POWER = 0.4  # of the record's excitation, least share in dwells: else it is no stepped sine
SINE_SAMPLES = 12  # least samples of a stretch that a sine is fitted to
HARMONICS = 9  # harmonics of a sine that are fitted with it, to keep the friction's out of it
STEADY_SIGN = 0.999  # least share of the velocities in one direction of an axis that is kept moving
FOLLOWING_SIGN = 0.95  # the same, in the direction of a reference that moves both ways
HANN_OVERLAP = 11.0 / 9.0  # variance of a mean over half overlapping Hann segments, times their number; Welch 1967
RESPONSE_ELEMENTS = 24  # stop operators of the fit with friction
LINE_ACCURACY = 0.005  # relative deviation that no line is taken to be better than: that of a describing function
SHORTEST_RESPONSE_SLIP, LONGEST_RESPONSE_SLIP = 0.1, 0.1  # of the smallest and of the largest displacement
EARLIEST_DELAY, LATEST_DELAY = -2e-3, 5e-3  # s, delays that are searched
PAPER_LAG = 0.25e-3  # s, left in the response: it explains why the paper's curve fit errs downwards
LEAST_LINES = 3  # of a fit: inertia, damping, delay
BEYOND_PRESLIDING = 15.0  # mean slips: displacement amplitude from which a line is out of presliding
LINE_AMPLITUDES = 3  # amplitudes at one frequency that a straight line over 4/(pi W) needs

# Reversals (zero crossing).  Chosen on simulations of the slider of the friction paper.
REVERSAL_CUTOFF = 150.0  # Hz of the low-pass
SLOWEST_REVERSAL_SAMPLING = 4e-3  # s, sampling time with which a reversal of some 20 ms is still resolved
SPAN_STEADY = 0.03  # relative deviation from the steady speed
SPAN_TRIM = 0.25  # of a span, cut off at either end
SHORTEST_TRIMMED = 0.02  # s, of a trimmed span
SETTLED_SPAN = 0.1  # relative change of the friction along a span
STANDING_BAND, LEAST_LEG_SPEED = 2e-3, 0.1  # of the largest speed: slower is standstill; a leg has more than that
MOST_REVERSALS, MOST_REVERSAL_ROWS = 12, 2000  # of all captures together: more do not change the result
GENERATIONS, POPULATION, SEARCH_TOLERANCE = 150, 10, 1e-6  # of the differential evolution
STATIC_ALLOWANCE = 1.05  # times the largest force seen: the low-pass and the thinning reduce a peak
STATIC_DIP = 1e-3  # times the constant friction: lower bound of the search without physical bounds
STATIC_FREE = 4.0  # times the largest force seen: its upper bound
FASTEST_SPANS = 0.9  # of the largest speed: spans that give the constant parts
AT_BOUND = 1e-3  # relative distance from a bound
DERIVATIVE_STEP = 1e-4  # of a parameter, for derivatives
SINGULAR = 1e-6  # of the largest singular value: smaller ones are not inverted

# Friction family.  Chosen on the EMPS record.
FASTEST_ROWS = 0.75  # of the largest speed: faster rows are held out
IDENTIFIED_FACTOR = 30.0  # a searched parameter whose interval is wider than this factor is not identified
COULOMB_STEPS = 20.0  # encoder steps over which a model's jump of Coulomb friction happens in simulation
FRICTION_ELEMENTS, SLIP_SPREAD = 6, 30.0  # stop operators, and largest over smallest slip
TABLE_ROWS = 8  # of the data-based table
SHORTEST_RANGE, LONGEST_RANGE = 2.0, 0.2  # encoder steps, of the stroke: bounds of a presliding range
SLOWEST_STRIBECK, FASTEST_STRIBECK = 0.003, 0.5  # of the largest speed: bounds of Stribeck's velocity
SEARCH_GRID = {0: 1, 1: 9, 2: 5, 3: 3}  # points of the grid along each of so many searched parameters
SEARCH_STARTS = 3  # points of the grid that a search with a delay begins at: it makes local minima
# Evaluations from the grid, twice as many with a delay, and from a fit of nearly the same rows.
SEARCH_STEPS, REFIT_STEPS = 10, 3
SEARCH_DERIVATIVE, SENSITIVITY_STEP = 1e-3, 1.02  # relative step of a derivative; factor of one
REPEATING, NOT_REPEATING = 0.999, 0.5  # autocorrelation a period later, and what it falls below before
ERROR_CUTOFF = 100.0  # Hz, of the filter of the closed loop's errors; Janot, Gautier, Brunot 2019
UNSTABLE_STROKES = 10.0  # times the record's stroke: a run that reaches further is unstable
SERVO_SUBSTEPS = 20  # of the integration in a sampling time; half the step changes no figure

# Simultaneous: what a record must contain.  Chosen.
SHORTEST_RECORD = 0.2  # s
REVERSAL_TRAVEL = 0.05  # of the stroke, travel on both sides of a reversal
SLOW_MOTION, WEAK_ACCELERATION = 0.02, 0.05  # of the largest: below it a velocity or an acceleration has no sign
SIGNIFICANT_ACCELERATION = 4.0  # standard deviations of its noise that an acceleration must exceed
SAME_SIGN_ROWS = 10  # rows with velocity and acceleration of one sign
BRAKED = -0.3  # least correlation of current and velocity
LONGEST_WINDOW, WINDOW_SHARE = 0.12, 0.4  # s; of the mean time between reversals: acceleration averaged over either
LOST_ACCELERATION = 0.1  # of the acceleration that may be noise
FAST_SAMPLING = 2e-3  # s, a sampling time that the message recommends

# Simultaneous: columns and windows.
SHORTEST_KNOTS = 1.5e-3  # s, knot distance: the window passes 125 Hz; chosen
LONGEST_KNOTS = 0.03  # s; chosen
LEAST_KNOT_ROWS = 3.0  # samples in the longest knot distance; fewer, and the sampling is to blame; chosen
NOISE_DIFFERENCES = 8  # order of the differences that show the position's noise: of a motion next to nothing is left
BEYOND_ROUNDING = 2.0  # times rounding's deviation: an axis that dithers between two counts shows 3**0.5 times it
SLOWEST_ROWS = 0.1  # share of the rows, by travel, that shows the noise of reversals; chosen
WINDOWED_NOISE = 0.01  # noise that the encoder may leave in the acceleration, relative to its rms: biases it by 1e-4
WINDOW_BAND = 0.197  # of one over the knot distance: the window's bandwidth for white noise
WINDOW_CORRELATION = 3.0  # rows of the window's noise that count as one before the noise is known; chosen
WHITENING_ORDER, WHITENING_ROWS = 24, 20  # rows that a filter looks back at most: twice the window's; rows for each
WINDOW_PASSES = 0.5  # of the noise's power, least that a window passes below its cut-off; what is beyond is as below
# s, knot distance where the encoder's noise is seen: the window must pass what a controller answers to, else the rest
# of that answer bends the delay by milliseconds; about a period of fast loops; chosen
STEPPED_KNOTS = 0.5e-3
STEPPED_WIDE = 2  # shortest knot distances that would hide it, at least; chosen
CORNERS, CORNERS_TRIED = (0.02, 1.5), 12  # rad per row, from and to: where noise becomes that of rounding; chosen
CORNER_SETTLES, CORNER_SHARE = 4.0, 8.0  # over the corner: rows to settle; least number of such lengths in a capture
WHITENING_RIDGE, WHITE_LEAVES = 1e-9, 1.1  # of the residual's power: rounding; of the rms of plain rows; chosen
MOST_ROWS = 120000  # of long captures
FORGOTTEN = 0.1  # of the stroke: travel, there and back, after which the friction has forgotten how it began
COLUMN_RIDGE = 1e-10  # of a column's squared length: two elements that never differed share their weight
FIT_LEAST_ROWS = 20  # of all captures together
DRAWN_ROWS = 4000  # that the figures get

# Simultaneous: friction columns.  Chosen on simulated axes of five laws.
# Below them no slip is looked for: encoder steps; share of the acceleration times the knot distance squared.
SLIP_STEPS, SLIP_TIME = 4.0, 0.25
# The same where the measured path is coarse.  With those above no column was as stiff as the friction of axes
# with 4,096 and 20,000 counts: its reversal came too late in the model, and the delay was up to 3 ms too long.
FOLLOWED = (0.25, 0.02)
SLIP_STROKE = 0.1  # of a motion: the longest slip
SLIP_SPAN = 300.0  # longest slip over the shortest that is seen, at most
SLIPS, BRISTLES = 20, 5  # stop operators, lengths of bristles
STRIBECK_OPERATORS = (3, 8, 14)  # stop operators that have Stribeck columns
# Of the largest speed, from and to; their number.  The columns reach as far as the laws.  What is faster looks like
# viscous friction: on 68 machines of another hand D was off by 1.4, 1.1 and 1.0 of its standard deviations (rms) with
# columns up to 0.3, 0.5 and 1.0; the interval of Tc was 4.3, 5.6 and 7.4 times that of the known law (median).
STRIBECK_SPEEDS, STRIBECK_COLUMNS = (0.01, FASTEST_STRIBECK), 6
MEMORIES = (5e-3, 20e-3, 80e-3)  # s, after which friction follows its Stribeck curve; source in `friction_columns`
PATH_STEP = 1e-3  # s: a friction law follows a motion that is sampled at least as fast

# Simultaneous: what is known before the data.  Doubts are standard deviations.
INERTIA_DOUBT, VISCOUS_DOUBT = 0.3, 0.5  # of the stage file's values; as in the diagnosis of the gap
NATURAL_DAMPING = 0.5  # 1/s times the inertia, added to the doubt of the viscous friction: the stage file's may be 0
DELAY_PERIODS, DELAY_DOUBT = 2.0, 1e-3  # control periods, and s at least
FRICTION_SCALES = (  # of ripple, bend, operators, bristles, Stribeck and lag, in Coulomb frictions
    (0.0, 0.05),
    (0.0, 0.3),
    (0.0, 0.01, 0.03, 0.1, 0.4),
    (0.0, 0.01, 0.1, 0.4),
    (0.0, 0.01, 0.03, 0.1, 0.3),
    (0.0, 0.01, 0.1, 0.3),
)
# The same where the encoder's noise is seen: an error of form, and not the path's, which longer ones take up with the
# inertia: on foreign axes it fell by up to 90 %.
STEPPED_SCALES = ((0.0, 0.05), (0.0, 0.3), (0.0, 0.01, 0.03), (0.0, 0.01, 0.03), (0.0, 0.01, 0.03), (0.0,))
FIRST_SCALES = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # with which the search begins: the simplest law
NO_SCALE = 1e-4  # in Coulomb frictions: a group that is left out
LEAST_FRICTION = 0.1  # of the rms force: the least scale of friction; smaller friction is a small scale of it

# Simultaneous: search.  Chosen.
SCALE_ROUNDS = 1  # along one group after the other, before and after the acceleration's noise is known
INERTIA_SPAN = 10.0  # deviations of its logarithm before the data, either way; no bound, but a number
MOST_NOISE = 0.8  # of what no other column explains of the acceleration, which may be noise
LEAST_INERTIA = 1e-3  # of the stage file's: below it an inertia is not positive
DELAY_SPAN = 3.0  # standard deviations of the prior, either way
DELAY_NODES, DELAY_ROUNDS = 25, 3  # delays at a time; how often they are put closer
DELAYS_ENOUGH = 6  # delays that are not improbable
DELAY_ROOM = 1.5  # times the longest delay of the search: samples that are left at the ends
DELAY_STEP = 1e-5  # s, of a derivative
UNLIKELY, UNLIKELY_DELAY = 6.0, 12.0  # of the log evidence below the best
NOISE_ROUNDS, NOISE_AGREES = 5, 0.02  # until the residual has the variance assumed; relative
ROUGH_RESIDUAL = 0.1  # of the rms force: the residual of the rough fit that scales the friction
FIRST_VARIANCE, LEAST_RESIDUAL = 1e-4, 1e-6  # of the force's mean square; of its rms: rounding

# Simultaneous: temper.
FORM_ERROR = 2e-3  # of the Coulomb friction: what the columns leave of a law, at least; chosen
OTHER_LOOP = 3.0**-0.5  # of the answer of the stage file's loop to noise: deviation of a share from 0 to 2, evenly
FORM_VALUES = 16.0  # values that an error of form is worth; calibrated on simulated axes of five laws
BANDS, LEAST_FREEDOM = 8, 1e-3  # of frequency that must agree, the last shows noise; least of a variance that they tell
BEYOND_NOISE = 3.0 / 0.6745  # of the residual's median size: three standard deviations of normal noise
FAR_ROWS = 30  # rows over which the window and a slow residual correlate
SHORT_FORM_SHARE = 0.3  # of the residual, in a record too short to tell; chosen

# Simultaneous: doubts.  Chosen, but for RIPPLE.
RIPPLE = 12.0  # Wald's statistic above which a ripple is reported; by chance once in four hundred
RIPPLE_ORDERS = 12  # periods a turn up to which a ripple is looked for: pole pairs, slots
RIPPLE_PERIODS, HIGHER_RIPPLE = 2.0, 0.3  # periods of an order in the travel; its scale over that of the first order
GRAVITY = 100.0  # in Coulomb frictions: scale of gravity's terms in the angle; loose
RIPPLE_TRAVEL = 1.5  # rad, least travel that separates a ripple from the rest
PLACES, PLACED = 100, 0.3  # parts of the travel; share of the residual that their means explain, from which it is said
UNSURE, USELESS = 0.05, 0.2  # half of an interval over its value: reported; left out of the stage file
NOT_EXCITED = 0.5  # half of an interval over that of the prior: the value rests on the stage file

# Simultaneous: laws that are refined.  Chosen on simulated axes of six laws.
LEAST_SMOOTHING, MOST_SMOOTHING = 5e-4, 0.05  # of the largest speed: width of a static law's step
DAMPING_SPEED = 0.05  # of the largest speed: unit of a bristle's rate
GMS_OPERATORS = 12  # operators of the GMS law
TANGENT = 1.0  # standard deviation of a step along the logarithm of a law's parameter
LAW_WEIGHT = 2.0  # standard deviation of a weight of a law over its mean: none is far below zero
LAW_EXTRA = 1.0  # in Coulomb frictions: scale of a law's columns that are no friction of unit size
ROUGH_NOISE = 0.02  # of the Coulomb friction: the residual that a search assumes
LAW_STEPS, LAW_STARTS = 12, 1  # evaluations of the derivatives, and points of the grid that they begin at
LAW_RIVALS = 3  # laws that are refined again once the path is known better
LAW_DERIVATIVE = 1e-3  # relative step of a derivative
LAW_ROWS, LAW_STEPPED_ROWS = 4000, 12000  # rows that the search looks at; the same where the encoder's noise is seen
LAW_GRID = {  # points of the grid, as shares of the way between the logarithms of the bounds
    "range": (0.15, 0.4, 0.65, 0.85),
    "exponent": (0.52,),
    "rise": (0.77,),
    "stribeck": (0.15, 0.4, 0.65, 0.85),
    "elastic": (0.85,),
    "smoothing": (0.15, 0.4, 0.65, 0.85),
}
