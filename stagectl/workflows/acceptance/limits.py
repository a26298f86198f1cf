"""Every number that decides something in an acceptance, with unit, origin and effect; "chosen": by judgement."""

# How far, how fast and with how much current an axis is tried
CURRENT_FACTOR = 2.0  # of the model's breakaway current; chosen; the test current, where none is given
CURRENT_SHARE = 0.05  # of drive.current_limit; chosen; the same where the model has no friction
SPEED_SHARE, GUARD_SHARE = 0.02, 0.1  # of limits.speed; chosen; that of each test, and that at which the loop stops
WINDOW_SHARE = 0.05  # of the travel; chosen; room to either side of the start, beyond which the loop stops
NARROW_SHARE = 0.1  # of the window; chosen; the same while the polarity is not known; and the way to the test limits
RAMP_TIME, FALL_TIME = 4.0, 0.2  # s; chosen; in which the current rises to the test current, and falls again
POLARITY_COUNTS = 50  # encoder counts; chosen; more than any noise, less than any harm
CLIP_FACTOR, CLIP_TIME = 2.0, 0.4  # 1 and s; chosen; so much more than the limit is asked for, for so long
SPEED_TIME = 0.02  # s; chosen; over which the speed is taken

# What is right
OVERSHOOT = 1.2  # of the current limit; chosen; a current loop that overshoots more is not tuned
DELIVERED = 0.7  # of the current limit; chosen; a drive that gives less limits the current itself
COUNTS = 4  # counts of the current object; rounding, and its noise
LATENESS = 1.1  # of a time-out; chosen; clocks and polls of the drive
STOP_PERIODS = 3  # control periods; the order waits for one, acts with the next SYNC, and is seen with the one after
SETTLING_SHARE = 0.25  # of limits.following_error; chosen; friction's spring and the end of the drive's own loop
STILL_COUNTS, STILL_TIME = 2, 0.2  # encoder counts and s; chosen; an axis that stays within them stands
PATIENCE = 3.0  # s; chosen; beyond time-out and ramp: then the axis counts as not stopped, and its power is cut
LOOK = 0.005  # s; chosen; between two looks at ring or drive
LOOP_PATIENCE = 90.0  # s; chosen; for a loop to connect, get power and end: a busy computer starts Python slowly

# What is kept of each trial, signed and drawn
TRACE_POINTS = 400  # chosen; periods of one trial, evenly spaced: more than a figure resolves
TRACE_LEAD = 0.1  # s; chosen; before the event of a stop: enough to see the speed
TRACE_DIGITS = 6  # chosen; significant ones: 1 nm of 1 mm

LONGEST_NAME = 100  # characters; chosen; of the person
SHORTEST_KEY = 16  # bytes; chosen; 128 bits: a shorter key for the signature can be guessed
