"""Every number that decides something in the design of experiments, with its unit, its origin and what it decides.

Origin is "chosen" unless the comment says otherwise: such a value was set by hand and is not derived.  Amplitudes and
durations of single motions are part of the experiments and stand with them.
"""

# -- the scale of a stage --------------------------------------------------------------------------------------------

FRICTION_BACK = 0.95  # of friction after a reversal; definition of the presliding length.
LEAST_REACH = 0.02  # of the stroke; chosen. Both ends must be farther away from the initial position.
LEAST_REACH_LENGTHS = 8.0  # presliding lengths; chosen. The same, for stages with long presliding.
WORKING_EFFORT = 0.5  # of the largest effort; chosen. Friction and bias must take less, or the axis hardly moves.
RESOLVED_STEPS = 100.0  # encoder steps; chosen. A shorter presliding length cannot be seen and counts as this long.
LEAST_EFFORT = 0.05  # of the largest effort; chosen. What a motion may always use, whatever friction takes.
# Of stroke; presliding lengths; of reach; chosen.  Short stroke.
SHORT_SHARE, SHORT_LENGTHS, SHORT_REACH = 0.01, 4.0, 0.2

# -- motions ---------------------------------------------------------------------------------------------------------

REST = 0.1  # s; chosen. Standstill between two parts.
PRECONDITIONING_TIME = 0.15  # s; chosen. One way of the reversal that brings friction into a known state.
GENTLE, FIRM = 0.3, 0.7  # of limits and current; chosen. Two intensities of use.
LONGEST_MOVE = 0.8  # of the stroke; chosen. Longest move of the stairs.
FEWEST_PERIODS = 40  # control periods; chosen. A step takes at least as long: what the sampled loop can follow.
SHORTEST_STEP = 0.02  # s; chosen. The same, for fast loops.
RESERVE = 1.25  # ratio; chosen. Inertia, damping and friction that an experiment must bear without a fault.
CARRIER_WAY = 0.25  # of the stroke; chosen. Travel over which a multisine is carried.
CARRIER_SETTLE = 0.2  # s; chosen. Constant speed before and after a multisine.

# -- operating range of a session ------------------------------------------------------------------------------------

SPEED_WINDOW = 0.01  # s; chosen. Span over which a position is differenced.
# Ratio; derived: the experiments approach their places at half the limit, so twice what was seen brings no more.
BEYOND_SEEN = 2.0
ONE_SIDED = 0.2  # of the stroke; chosen. A start nearer to an end leaves no room, and the middle is taken.
LEAST_TRAVEL = 10.0  # presliding lengths; chosen. A shorter travel leaves no room for any experiment.
CURRENT_RESERVE = 1.2  # ratio; chosen. Current beyond what friction and bias need.
STAND_IN_BANDWIDTH = 0.5  # of the tracker's; chosen. Of the loop that stands in for an unknown controller.
GOES_FARTHER = 1.01  # ratio; chosen. A travel beyond that of the logs by this much is mentioned.

# -- coverage --------------------------------------------------------------------------------------------------------

SPEED_COUNT = 5  # chosen. With fewer speeds, curvature of viscous friction and a Stribeck rise look alike.
HELD_TIME = 0.1  # s; chosen. A speed that is held as long counts.
HELD_SPREAD = 0.05  # of the speed; chosen. It may change by as much meanwhile.
DISTINCT_SPEEDS, DISTINCT_DWELLS = 1.25, 2.0  # ratios; chosen. Closer speeds, or dwells, count as one.
SLOWEST_MOVING = 1e-3  # of the largest speed; chosen. Slower is standstill.
SLOW_SCAN = 0.25  # of the largest speed; chosen. A scan is slower.
WIDE_SCAN = 0.8  # of the travel; chosen. A scan covers as much.

# -- predictions and their distances ---------------------------------------------------------------------------------

SUBSTEPS = 2  # of a control period; chosen. Coarse: what resonates divides its steps further by itself.
LEAST_NOISE = 1e-4  # of the rms of a signal; chosen. A lower noise is not believed.
LEAST_DENSITY = 1e-6  # of the largest density; chosen. The noise has no deeper gap.

REFIT_STEPS = 8  # chosen. Gauss-Newton steps of the refit.
FARTHEST_STEP = 0.5  # of a nuisance, mostly a logarithm of the ratio; chosen. Bound of one step.
WEIGHT_GROUPS = 8  # chosen. Groups of elements of the friction law that are refitted together.
HIDDEN_SHARE = 0.02  # of a distance; chosen. A refit that leaves less has hidden all of it.
SHORTENED = 0.3  # ratio; chosen. A step that leads nowhere is shortened by it.
OUT_OF_LOOP = 100.0  # times the distance; chosen. A prediction so far off is that of an axis that has left its loop.
SETTLED = 0.98  # of the distance; chosen. A step that leaves more of it is the last one.
DIFFERENCE_STEP, LENGTH_STEP = 0.02, 0.05  # of a nuisance; chosen. Steps of the differences; of the length.

# -- the proposal ----------------------------------------------------------------------------------------------------

PROMISING = 12  # chosen. Experiments that are simulated at most.
FINALISTS = 3  # chosen. Experiments that are refitted at most.
SIMULATED_MOTION, REFITTED_MOTION = 90.0, 30.0  # s of machine time; chosen. What these may take together.
LONGEST_EXPERIMENT = 60.0  # s; chosen. Longer ones are not simulated.
CLEAR_SIGMA = 10.0  # sigma; chosen. Separation that one run of the experiment should give.
HIDDEN_SIGMA = 1.0  # sigma; chosen. Below, all motions look alike, and a change by hand is proposed.
MENTIONED = 1.1  # ratio; chosen. What goes beyond the logs by this much is mentioned.
MOST_REPEATS = 999  # chosen. Largest number of repeats that is named.
