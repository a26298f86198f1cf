"""Numbers that decide something in recordings, imports and exports.  Chosen, not derived."""

# The recording file.
BLOCK = 1024  # rows of a chunk, and what a crash costs at most: 0.5 s at 2 kHz; half of it takes 9 instead of 6 ms/s
PACKING = 1  # gzip's level, behind a shuffle of the bytes: 4 saves 1 % more and costs a seventh more time
LARGEST_COUNT = 2.0**53  # that float64 counts up to without a gap
GAPS = 32  # gaps that a file can mark; further ones are added to the last
ROOM_AT_ONCE = 1 << 14  # bytes reserved for what HDF5 keeps apart from the rows
ROOM_PER_BLOCK = 256  # bytes of the same, for each block
LONGEST_REASON = 480  # bytes of the reason of the end
LOCK_TRIES = 20  # attempts to lock a file: a process that discards one holds its lock for a moment
LOCK_PAUSE = 0.01  # s between them

# The recorder and the rings.
POLL = 0.1  # s between two looks at the ring, which holds 16 s at 2 kHz
LOOKS = 5  # periods in which two rings are compared before they are joined; rows that one may be ahead
LOOK_PAUSE = 3e-4  # s between looks: all of them are less than a period, and more than one axis needs after another
LOOK_TRIES = 200  # looks at two rings at most
REJOIN = 1.0  # s after which rings may be joined anew

# Logs of other programs.
HEADER_LINES = 100  # lines of a CSV in which its header and first numbers are looked for
TAIL_BYTES = 1 << 16  # end of a CSV in which lines that are no rows are looked for
TAIL_LINES = 3  # such lines, at most: one that was cut off, a closing word, an empty one
SHOWN_CELLS = 40  # characters of such a line that a note shows
ROWS_TO_USE = 100  # of a log, to identify or diagnose from it
EARLY = 0.5  # of a row's duration: a row belongs to the value that begins up to this much after it
EMPS_STEP = 5e-8  # m a count, of the motor's encoder seen at the load (from the EMPS benchmark)


# Repair of logs.
JUDGED_ROWS = 50  # rows from which a log shows what is usual in it; a shorter one is taken as it is
EVEN_STEPS = 0.05  # of the usual step: stamps this close to equal spacing are not rounded
CLOCK_DIGITS = 0.02  # of a clock's step: stamps this close to its multiples were rounded to it
CLOCK_BLOCK = 256  # rows over which the spacing behind rounded stamps is first taken
CLOCK_GAP = 1.5  # spacings beyond a clock's step: a longer step of rounded stamps is a gap
LOST_ROWS = 1e-3  # of the steps: fewer longer ones are lost rows between exact stamps, not the beat of a rounded clock
CLOCK_ERROR = 0.75  # of a clock's step: rounding errs by a half, beyond three quarters the rows were not equally spaced
USUAL = 0.99  # quantile that is the usual size of a column's changes
QUANTILE_ROWS = 1_000_000  # rows from which a quantile is taken
STEP_LOOK = 20_000  # rows in which the smallest step of a column is looked for
SPIKE = 10.0  # times the usual distance of a value from the middle of its neighbours
SPIKE_FORM = 0.2  # of a spike: what its neighbours may differ by from minus half of it
SPIKE_EFFORT = 2.0  # times the usual size of an effort: a smaller spike may be real
ANSWER_ROWS = 3  # within which a current follows a spike of its command: such a spike is real; chosen
MOST_MISREAD = 0.005  # of the rows: more are no misread values or stamps, but what machine and clock do
SHOWN_ROWS = 3  # instants that a note names
WRAP_JUMP = 0.7  # of the range of the positions: a larger change is a wrap or a misread value
WRAP_STEP = 0.25  # of the same range: largest ordinary change beside wraps
MOST_WRAPS = 0.2  # of the rows
WRAP_DIGITS = 1e-3  # of a counter's range: digits of its jumps

# Guesses about the columns of a log.
GUESS_BYTES = 1 << 25  # of a text that a guess looks at
GUESS_BLOCKS = 400  # blocks in which columns are compared: noise and encoder steps matter little there
GUESS_SLOW = 0.02  # of the largest speed: below it friction changes its sign smoothly
DERIVATIVE = 0.9  # share of a position's changes that a velocity explains
SAME_SPEED = 0.05  # spread of a speed over its size: below it every ramp would be its integral
FOLLOWS = 0.9  # share of a position's variance that its reference explains one to one
FOLLOWS_BY_NAME = 0.5  # the same of one that is called a reference: a loop may lag behind it
LEAST_DRIVE = 0.15  # share of a column that the motion explains, of one that drives it
CLEARLY_MORE = 0.3  # difference of two shares that decides between columns
NEARLY_AS_LONG = 0.9  # of the longest vector of a MAT file: from here on a vector is a column of the same log
PROPORTIONAL = 0.9999  # correlation of a current and its torque: one measurement, twice
LEAD_ROWS = 4  # rows by which one column may run ahead of another
LEADS = 0.01  # relative difference of two correlations that says which one is ahead
GOES_WITH = 0.4  # correlation of a command and a current
SAME_UNIT = 0.1  # relative difference of a ratio from that of two units
LEAST_CONSTANT = 0.005  # N m/A: a smaller factor between two columns is one of raw units
LEAST_AXES, LEAST_QUANTITIES = 2, 3  # axes side by side, and quantities of each, that make a file one of several axes
GRAVITY_DEGREE = 3  # of the polynomial in the position that is no part of what drives
FAST_IN_RADIANS = 150.0  # rad/s: a number beyond it is a speed in rev/min
TINY = 1e-9  # a ratio of two efforts that is nothing
USUAL_STEPS = (0.9e-4, 0.011)  # s between rows of a log: 10 kHz to just under 100 Hz
MANY_RADIANS = 1000.0  # a longer travel is in counts
LONG_TRAVEL = 1.0  # a longer travel is more likely in radians, a shorter one in metres: no more than a proposal
LEAST_TRAVEL = 0.02  # of the stage's travel: a log that moves less shows no unit by it
USUAL_SPEED = 10.0  # turns a second, of a motor in a log
USUAL_COUNTS = (12, 24)  # powers of two of an encoder's counts a turn
SURE_BY_NAME, SURE_BY_PHYSICS, SURE_BY_MAGNITUDE, SURE_BY_DEFAULT = 0.95, 0.9, 0.5, 0.3  # how sure a guess is
LEAST_SURE = 0.5  # a guess that is less sure is not imported unasked

# Logs in wrong units.
CONFUSED = {  # units that are taken for each other: every pair, in both directions
    "time": (("s", "ms", "us"),),
    "position": (("rad", "deg", "rev"), ("m", "mm", "um")),
    "current": (("A", "mA"),),
}
LEAST_RATIO = 10.0  # of two units: a smaller one may be a model that is wrong by a factor of three, twice
SAME_RATIO = 1e-6  # relative difference of two ratios that are one, but for rounding
SAME_STEP = 5e-3  # relative difference of a step from the one that a wrong unit makes of the encoder's or the period
RARE_ROWS = 0.1  # s between rows: rarer ones hold no reversal, and are more likely in another unit of time
MODEL_FITS, MODEL_DIFFERS = 0.5, 0.8  # share of the force that the model leaves unexplained: right units, wrong units
MUCH_BETTER = 0.45  # times the unexplained share as recorded: a ratio of two units is not found by chance
NOMINAL_OFF = 3.0  # factor by which each nominal value may be wrong, either way
MOTION_BAND = 0.02  # cycles a sample: the motion is below, noise above
CHECKED_ROWS = 50_000  # rows that are looked at; longer logs are averaged in blocks
UNIT_SLOW = 1e-3  # of the largest speed: below it the model's friction changes its sign smoothly
LEAST_EXCESS = 10.0  # times a log's largest effort: measured records with a guessed inertia reach 1.05

# Currents that are cut off at a limit.
CLIPPED_SIDE = 0.5  # of the largest current: a limit on the other side may be lower
CLIPPED_RUN = 5  # consecutive equal rows at the largest current
CLIPPED_SHARE = 0.005  # of the rows: fewer clipped ones do no harm
CLIPPED_RISE = 0.01  # of the largest current, in the last fifth of a rise
CLIPPED_CORNER = 0.38  # rise in the last tenth over that in the last fifth: a flank has 0.5, a rounded top 0.25

# Exports.
RUN = 0.3  # s, run-up and run-out of an exported trajectory that begins or ends in motion
AT_REST = 1e-3  # of the largest speed: slower is at rest

# Learned currents.
NEAR = 0.01  # encoder counts by which a reference may differ: another computer's rounding
ALIKE = 1e-6  # of the largest current: by so much feedforward and friction compensation may differ
