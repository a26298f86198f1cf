"""Numbers that decide something in exported models.  Chosen; what follows from them stands in each export's page."""

CURVE_POINTS = 400  # of the friction's curve to which bristles are fitted; ten times as many change no limit by 1 %
CURVE_REACH = 5.0  # speeds of a Stribeck curve to which another shape is fitted, over its own speed
LADDER = 12  # slips that bristles may have; those of no use get no share
LADDER_REACH = 3.0  # shortest of them under the shortest slip of an operator
LAG_STEPS = 4  # steps of the other simulator within the lag of the current loop, at least
SOLVER_ITERATIONS = 4  # PhysX' default of position iterations; 20 change nothing, 1 the shipped axes by 2 % at most

# The round trip.
TRIED = 2.0  # Hz, of the commands' sines: slow enough that the friction decides, in the axes that are shipped
MOTION_PERIODS = 3.0  # periods of them; the amplitude rises over the first one
MOTIONS = {"within the rolling zone": 0.3, "close to break-away": 0.9, "sliding": 1.8}  # times what friction holds
