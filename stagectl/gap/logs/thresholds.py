"""Numbers that decide which logs and rows a diagnosis uses.

Unless a line names another origin, a value was chosen and is not derived.
"""

from stagectl.recording.constants import ROWS_TO_USE

# -- control periods ---------------------------------------------------------------------------------------------------
SAME_PERIOD = 1e-3  # share by which the sampling periods of two logs may differ
SAME_STEP = 0.01  # share by which the steps of a log may differ from the control period and still be it
SCATTER = 0.02  # rms of the time stamps, of the period: above it rows are resampled
NOTED_SCATTER = 1e-3  # rms of the time stamps, of the period: above it a note reports the scatter
NOTED_DRIFT = 1e-4  # share by which two clocks may differ before a note reports it
SLOWER_LOG = 1.5  # control periods of the stage file in a row: from here on commands lie between two rows
GAP_STEPS = 3.5  # median steps: a longer step of a resampled column is a gap
LEAST_ROWS = ROWS_TO_USE  # of a log
LEAST_SPLINE = 6  # samples of a reference: a quintic spline needs as many
SAME_INSTANT = 1e-9  # s: instants that are closer are the same

# -- repeats -----------------------------------------------------------------------------------------------------------
SAME_SIGNAL = 1e-3  # share of its range by which a repeated reference or injection may differ
LEAST_LENGTH = 0.5  # of the longest repeat: a shorter one is left out, so that the others keep their rows

# -- rows that do not count --------------------------------------------------------------------------------------------
LOOP_SETTLED = 0.2  # s after a gap of the reference, until its effect on the loop has died out
BRIDGED = 0.02  # s: a spline through the reference bridges shorter gaps
SWITCHED_OFF = 0.05  # s at the end without current under a command: the drive is off
NO_CURRENT = 1e-3  # of the largest current: less is none
COMMANDED = 0.05  # of the largest command: this much, and no current
FROZEN = 0.1  # s of one and the same position while the reference moves
FROZEN_MOTION = 100.0  # encoder steps that the reference moves in that time
FROZEN_SPEED = 0.05  # of the largest speed, instead, where the encoder step is not known
RUN_AWAY = 5.0  # times the largest current: no drive follows such a command
PLATEAU = 5  # rows in a row at the limit
PLATEAU_CURRENT = 0.95  # of the largest current: at its limit, but for noise
PLATEAU_COMMAND = 1.05  # of the largest current: a command beyond it
KNOWN_LIMIT = 0.99  # of the drive's limit: a plateau there is the known limit

# -- measured current and command --------------------------------------------------------------------------------------
MOST_LEAD = 5  # control periods by which one of the two is tried earlier and later
# Of the largest command: what it moves by within so many rows, and how far the current is away; share of the rows.
# Chosen: a drive that follows was away by 1 % at most in 99 % of the rows of a log, one at its voltage limit by 80 %.
STEADY, STEADY_ROWS, UNFOLLOWED, UNFOLLOWED_ROWS = 0.05, 7, 0.1, 0.005
CURRENT_LEADS = 0.5  # of the mean square between the two as logged: what is left of it where the current comes first

# -- nominal model -----------------------------------------------------------------------------------------------------
NOTED_SUM = 0.02  # share by which `coulomb` may miss the sum of the weights before a note reports it
WRONG_SUM = 0.5  # the same, before one of the two must be wrong
# Displacement before slip of a model that gives no friction: of the travel, but no less than some encoder steps.  A
# tenth and ten times of it leave the Coulomb friction of six measured records within 3 %.
SLIP_OF_TRAVEL = 1e-3
SLIP_STEPS = 2.0
