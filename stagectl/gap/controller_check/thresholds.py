"""Numbers that decide whether a logged command is that of the deployed controller.

Unless a line names another origin, a value was chosen and is not derived.
"""

# -- agreement ---------------------------------------------------------------------------------------------------------
AGREEMENT = 1e-4  # of the command's rms: largest difference where no column is rounded
DIGITS = 1e-6  # of the command's rms: what the digits of a log leave; between the two, a wrong gain may hide
DECIMALS = range(3, 13)  # of a position column, to any of which it may have been rounded
ROUNDED = 1e-4  # of a decimal: deviation of positions that were rounded to it
ENCODER_ALIGNED = 1e-6  # of a decimal: an encoder step that is a multiple of it is no rounding of the log
POSITION_SAMPLES, COMMAND_SAMPLES = 2000, 5000  # values that are looked at for rounding
SAME_STEP = 1e-12  # of the largest value: smaller differences are rounding of the arithmetic
STEPPED = 0.99  # share of the values that must be multiples of a step
STEP_ERROR, STEP_ERROR_EACH = 0.01, 1e-3  # of a step: allowed deviation from a multiple, and for each step of the value
STEPS_COUNTED = 100.0  # steps up to which that deviation grows
LIMIT_ROUNDED = 1e-6  # of the controller's limit, by which the digits of a log may put a command beyond it

# -- rows in which a difference is harmless ----------------------------------------------------------------------------
FORGOTTEN = 0.05  # s after a gap, until the derivative's filter has forgotten it
BEGINNING = 0.2  # of a log, within which the controller's stored state may die out
CORNER = 20  # rows around a corner of the reference, where a spline deviates from the motion's formula
SHARP = 30.0  # fourth difference of the reference, in medians of its neighbourhood: above, a corner
REFERENCE_NOISE = 1.6e-14  # of the largest reference: rounding of its fourth difference

# -- causes ------------------------------------------------------------------------------------------------------------
EXPLAINED = 0.1  # rms that is left, as a share of the difference: below it a cause is named
EXPLAINED_WITHIN = 0.05  # the same for a difference that is within the limit
LEAST_FACTOR = 0.01  # factor on a term, less one, that counts then, and among several terms
NOISE = 0.9  # share of noise that every cause leaves
ALONE = 0.5  # share of what a single cause leaves that several causes must undercut
LARGEST_SHIFT = 8  # rows that a column may be shifted
POLE_FACTORS = (0.25, 0.5, 0.7, 0.8, 0.9, 1.1, 1.25, 1.5, 2.0, 4.0)  # on the pole of the derivative's filter
MISSING_TERM = 0.02  # factor on a term below which it counts as missing
SAME_UNIT = 0.01  # relative error of a factor that is taken for a unit
SINGULAR = 1e-10  # relative singular value below which factors of several terms are not determined
