"""Numbers that decide how residuals are formed, filtered and fitted.

Unless a line names another origin, a value was chosen and is not derived.
"""

# -- tracking the model along a measured path --------------------------------------------------------------------------
# Share of the tracker's own rate: its bandwidth, 40 Hz at 2 kHz.  A faster tracker holds the model closer to the path
# but excites every candidate that has a resonance.
TRACKER_BANDWIDTH = 0.02
# s: tick of the tracker in a slower log, as its motion is no slower.  With a tracker of 5 Hz on a robot's joint at
# 64 Hz, friction held the model on the spot where the joint moved by 3 mrad/s.  Halved: the joint's answer is the
# same, and of a motor polled at 431 Hz the cogging is found without its multiples, as noise grows with the bandwidth.
TICK = 1e-3
# s in which the bristle of a standing axis takes over what the tracker has to hold: four time constants of the tracker.
# Of a Dahl stage with its true law, what is left unexplained is a fifth of that without; 0.9 and 1.2 times as much with
# half and twice the time.
YIELD_TIME = 0.01
SUBSTEPS = 4  # integration steps per period; effects stiffer than rolling friction take more by themselves
# Integration steps per period for sensitivities: both simulations of a difference share their integration error, so
# that half as many suffice.
SENSITIVITY_SUBSTEPS = 2
LEAST_TRACKED = 0.1  # of the tracker's response; chosen. Frequencies that it follows less are not divided out.
DIVERGED = 1e8  # standard deviations of noise: a larger column comes from a simulation that diverged

# -- whitening ---------------------------------------------------------------------------------------------------------
BAND = 0.2  # share of the sampling frequency: upper end of the band, 400 Hz at 2 kHz
BAND_EDGE = 0.1  # share of the band over which the filter falls to zero at its upper end
# Share of the sampling frequency, 40 Hz at 2 kHz: above it the weight of an effort falls with the frequency, as a servo
# axis attenuates it.  Impacts ring there, and no model predicts their instants.  The current has no such roll-off.
ROLL_OFF = 0.02
UNJUDGED = 0.25  # of the variance of the currents above it, which is said; noise alone has no such share; chosen
KEPT = 2  # every second sample is kept: the band lies below half of the remaining sampling frequency
LOWEST_BAND_LINES = 40  # lines of all periodograms in the lowest band, so that each band above it holds ten; chosen
BANDS_PER_OCTAVE = 3  # of the noise; chosen
LEAST_DENSITY = 1e-6  # share of the largest noise density: a lower density means missing data, not low noise

# -- half strokes and standstills --------------------------------------------------------------------------------------
SHORTEST_STROKE = 0.1  # s: faster reversals belong to one half stroke
LONGEST_STROKE = 1.0  # s: a longer half stroke is divided, so that a slow scan is not a single cluster
LONGEST_PERIOD = 0.5 * LONGEST_STROKE  # s between rows: beyond it a half stroke has less than two
STROKE_WINDOW = 0.02  # s over which the position is averaged before its direction is taken
STROKE_SPEED = 1e-3  # share of the largest speed: below it the axis has no direction
ZONES_TRAVELLED = 3.0  # lengths of the rolling zone in one direction, after which every friction element slips
SHORTEST_REST = 0.04  # s: a shorter standstill does not count as one
REST_WINDOW = 0.01  # s over which a change of the position counts as motion
REST_CHANGE = 1e-3  # share of the largest change within that window: below it the axis stands
NOISE_WINDOW = 0.02  # s to either side, over which a signal of a standing axis is averaged
NOISE_WIDTHS = 5.0  # medians of what departs from that mean, in size: more of it is ringing, and stays
FILTER_EDGE = 0.02  # s at both ends of a run that do not count: the whitening filter has no neighbours there

# -- the family of friction laws ---------------------------------------------------------------------------------------
ELEMENTS = 9  # stop operators on the grid of the family
SHORTEST_SLIP, LONGEST_SLIP = 0.4, 3.0  # of the nominal law's shortest and longest slip: range of that grid
DISTINCT_SLIPS = 0.4  # logarithm of the ratio of two slips: below it they count as one element
BRISTLE_EXPONENTS = (0.5, 1.0, 2.0)  # of Dahl's law
BRISTLE_LENGTHS = (0.04, 0.12, 0.35)  # share of the rolling zone: Coulomb force over stiffness of a bristle
BRISTLE_DAMPING = 0.3  # of critical damping, of the bristles of LuGre; chosen
UNLOADED_CURRENT = 0.01  # A: its force replaces the friction as a unit where the model has no friction
REVERSED = 0.95  # share of the friction that has reversed at the end of the rolling zone

# -- least squares on Gram matrices ------------------------------------------------------------------------------------
FLAT = 1e-9  # smallest eigenvalue of the correlation matrix that counts as determined
RIDGE = 1e-10  # share added to each diagonal element: columns that the data cannot separate stay finite
# Share of a column's sum of squares: what others leave of it below that is rounding, as its rows have single precision.
# A constant force next to a bias: 1.6e-9.
EXPLAINED = 1e-8
SINGULAR = 1e-14  # relative singular value below which a direction is left out of a fit

# -- orders of the pitch and resonances --------------------------------------------------------------------------------
# Largest order of the pitch that is searched: always, and where the rows resolve it.  Cogging has the least common
# multiple of slots and poles: 84 for 12 and 14, 252 for 36 and 42.
ORDERS = (60, 400)
FAST_ROWS = 0.99  # share of the rows whose speed is no larger than the one that must be resolved; chosen
BINS_PER_PERIOD = 16  # of the position, in a periodogram: 0.6 % of a line at the highest order is lost
PEAKS = 3  # strongest orders or resonances of each kind that become candidates
ORDERS_PER_WHOLE = 20  # steps between two whole orders, for effects whose order need not be whole
APART_FROM_LEAD = 2  # of these steps that an order of a ball pass lies off those of the lead
LOWEST_FRACTIONAL, HIGHEST_FRACTIONAL = 26, 600  # of these steps, orders of a ball pass: 1.3 to 30
ORDERS_APART = 0.5  # orders between two ball-pass candidates
LEAD_ORDERS = (1.0, 2.0)  # orders at which the friction of a lead varies: once and twice a turn, one effect
COVERED = 0.9  # of a pitch: a run that covers less does not show its orders
# Where the pitch is not known: steps of a period over the travel; from how many periods, and to how many such steps,
# always and where the rows resolve them.
STEPS_PER_TRAVEL, FEWEST_PERIODS, STEPS = 4, 4, (1200, 4800)
ORDER_SURROUNDINGS = 41  # of these steps, whose median a line must exceed; odd
MOVING = 0.02  # share of the largest speed: slower samples do not enter a periodogram over the angle
LOWEST_MODE, HIGHEST_MODE = 6.0, 75.0  # Hz: range in which a machine base rings
MODES_TRIED = 128  # frequencies in that range: each 2 % above the last, less than the width of a ring
MODE_DAMPING = 0.03  # of the rings that are tried; chosen
MODES_APART = 2.0  # Hz between two modes
# Relative eigenvalue of the nuisances' correlations below which a direction is left out.
SINGULAR_NUISANCE = 1e-10

# -- errors of parameters ----------------------------------------------------------------------------------------------
# Experiments, or parts of them, that are left out in turn; chosen: with fewer, Student's factor is above 1.4.
LEAST_BLOCKS = 5
# Of the data along a coordinate; chosen: with five, an end of the speeds holds all of a delay.  Halved and doubled on
# four development machines: one probability of ten moved, from 0.91 to 0.56 and to 0.87, and no name.
COORDINATE_PARTS = 10
# Hz; chosen. Half of it ends the lowest part of the frequencies; above, half octaves are parts.  Halved and doubled on
# the same machines: one probability moved from 0.91 to 0.87, or none.
LOWEST_OCTAVE = 1.25
