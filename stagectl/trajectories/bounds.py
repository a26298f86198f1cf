"""Bounds of trajectories.  Chosen, not derived, unless a line says otherwise."""

SHORTEST = 1e-12  # m, of a move; a shorter one is a dwell, and its ramps would lose their digits
LONGEST = 86400.0  # s, of a trajectory: a longer one is a mistaken unit, and would fill the memory
MOST_LINES = 5000  # of a multisine
MOST_PERIODS = 2e5  # of a multisine's fastest line within its base: what one evaluation holds in memory
BLOCK = 65536  # samples that are evaluated at once
LEAST_ROWS = 6  # of a recorded motion: what a polynomial of degree 5 needs
LEAST_STEP = 1e-4  # shortest step of time over the longest; below, the spline's equations lose their digits
ROUNDING = 1e-9  # of a period: so much less than a whole one still counts as whole
SAMPLING = 0.25  # of a control period, between two samples that extremes are taken over
PEAK_POINTS = 32  # of a multisine to its shortest wave: they find every peak within half a per cent
PEAK_HEIGHT = 0.99  # of the highest of these points, from which Newton's rule climbs a peak
PEAK_STEPS = 3  # of Newton's rule
FAR_BELOW = 0.2  # of a velocity: a short move that is a triangle comes closer
