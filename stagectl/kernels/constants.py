"""Numbers that decide something in the plant and its friction.  Chosen, not derived, unless a line says otherwise."""

# The drive.
FIRST_ORDER = 5.0  # damping ratio from which the current loop has one lag: the other is 1 % of it
EQUAL_POLES = 1e-6  # rad between the poles of a second order, below which they are equal; rounding
FOLDBACK_BEGINS = 0.8  # share of the heat at which the current limit begins to fall

# Integration of the mechanics.
LARGEST_ANGLE = 0.15  # rad of the fastest mode in one step; 0.1 % of its frequency (`transmission`)
STRAIGHT_BELOW = 1e-6  # rad/s | m/s below which a power of the speed goes over into a straight line
# rad of the vibration of the inertia on its sticking friction in one step; Verlet diverges at 2, and 0.5 is 1 % of the
# frequency.  Half as much changes no diagnosis; four times as much lets logs of 100 Hz diverge.
STICKING_ANGLE = 0.5
MOST_STEPS = 400  # of a period: a friction that needs more has no displacement before it slips that any log shows
SERIES_BELOW = 0.01  # y of a decay below which its mean is a series: as exact, and a fifth of the time
PHI2_SERIES_BELOW = 0.5  # z below which phi_2 is a series, as its difference would cancel; rounding

# Friction.
LEAST_LIMIT = 1e-9  # share of the bristle's limit that is always left: it divides by it
LEAST_FORCE = 1e-300  # N m | N, divisor of a friction that has no limit; avoids a division by zero
EXPONENT_OF_TWO = 1e-6  # exponents this near to 2 take the rheology's formula for 2; rounding
TURN_SHARE = 0.1  # of the mean slip: a way back that is shorter is no reversal

# The plant at rest.
READING_STEPS = 20  # towards a reading of the encoder, each as much nearer as its error is flat
LOAD_STEPS = (
    2  # towards where the load is, whose weight decides where it is: each as much nearer as the spring is stiff
)
CLOCK_ROUNDING = 1e-6  # s, of a clock that adds periods for hours; no period is as short
