"""Every number that decides something in the live twin, with its unit, its origin and what it decides.

Origin is "chosen" unless the comment says otherwise: such a value was set by hand on simulated runs and is not derived.
"""

# -- the model that runs along ---------------------------------------------------------------------------------------

SUBSTEPS = 4  # of a control period; measured: what rolling friction needs.
NUDGE = 0.01  # of a candidate's scale; chosen. Difference for its sensitivity: far from curved, far from rounding.
# s; chosen. Average over the corrections: effort noise shakes the axis, and faster than the loop it imitates inertia.
AVERAGED = 0.025
SETTLED_LENGTHS = 3.0  # friction lengths; chosen. After as much travel, the friction has forgotten how it began.
SETTLED_TIME = 0.2  # s; chosen. After as long, the tracker has forgotten where it began.
INFORMATIVE_LENGTHS = 2.0  # friction lengths; chosen. A block with less travel shows nothing of friction.
SPEED_PERIODS = 8  # control periods; chosen. Span of the speed by which a position is late.
NATURAL_RATE = 6.283  # 1/s; 1 Hz. Viscous friction per inertia, where the model has none to scale.
MISSING = 1.5  # control periods; chosen. A longer gap between rows means that some are missing.

# -- candidates, in units of their scale -----------------------------------------------------------------------------

MATERIAL, PRIOR = 0.03, 0.3  # chosen. Least size that matters; standard deviation of what is thinkable.
MATERIAL_FORM, PRIOR_FORM = 0.3, 1.0  # chosen. The same of the friction's form.
MATERIAL_SHIFT, PRIOR_SHIFT = 0.5, 1.0  # periods; chosen. The same of the time shift.
MATERIAL_GAIN = 0.01  # chosen. Of the current's gain.
MATERIAL_DEAD_TIME = 0.05  # periods; chosen. Of the dead time.

# -- names -----------------------------------------------------------------------------------------------------------

FEWEST_BLOCKS = 12  # informative blocks; chosen. With fewer, nothing is estimated.
CLUSTERS = 16  # groups of blocks; chosen. Independent pieces of the covariance.
NAME_SIGMA = 4.0  # standard errors; chosen. An effect must be as sure: a name is looked for every second, all day.
NEGLIGIBLE_SHARE = 0.03  # of what all candidates explain beyond the named ones; chosen. Less is no further name.
ALTERNATIVE_GAIN = 0.95  # of the best one's gain; chosen. From here on another candidate is an alternative.
DEPENDENT_POWER = 1e-3  # of a column's power; chosen. Below, other columns make it up.
DETERMINED = 0.3  # of the prior; chosen. A narrower error shows that the motion determined the parameter.

# -- the process -----------------------------------------------------------------------------------------------------

BLOCK = 0.25  # s of data in a block; chosen.
WINDOW = 60.0  # s of data; chosen. Of the live figures, and between two lines of the slow record.
SNAPSHOT_PERIOD = 1.0  # s of wall clock between two snapshots; chosen.
POLL_PERIOD = 0.1  # s; chosen. Between two looks at the ring.
TOO_FAR_BEHIND = 0.5  # of the ring's capacity; chosen. Further behind, rows are skipped and counted.
NICENESS = 5  # chosen. Priority below the loop's.
# A; derived: the ring holds what the law computed, unrounded, and both kinds of kernels give the same bits.
SAME_COMMAND = 1e-9

# -- drift over days -------------------------------------------------------------------------------------------------

FEWEST_LINES = 3  # a line and its scatter need as many.
MATERIAL_DRIFT = 0.03  # of the parameter's scale, over the record; chosen. Less is no drift.
RISK = 0.05  # chosen. Of an interval that misses the truth.
LEAST_ERROR = 1e-6  # of the scale; chosen. No line is more exact.
