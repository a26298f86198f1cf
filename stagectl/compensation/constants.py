"""Numbers that decide something in the compensation of friction."""

ROUNDING = 1e-9  # of the largest speed: a slower reference is at rest; rounding
SMALLEST = 1e-6  # least divisor of the shape between two legs; avoids a division by zero
EFFECTS_SHARE = 0.5  # of the current limit, for the current against all effects; chosen: the rest moves the axis
EFFECT_SHARE = 0.3  # of the current limit that one effect may take.  Of the library at four times its typical size none
# demands more on the ball screw: `viscous_nonlinear` 0.29, `thermal_viscous` 0.27; but for `gravity`, which goes from
# one side to the other, 0.8, and `backlash`, whose pushes demand 0.23 at its typical size and 0.53 at four times that.
FADE_TIME = 0.05  # s in which a current that would begin with a step fades in: two periods of the papers' 40 Hz loop
INVERSE_STEPS = 4  # of a control period, for the inverse of the model along the reference; 16 change 1 nm of the error

# Compensators made from a friction law; chosen, so that the curve of Dahl's law is met within 1 % of T_c.
CURVE_ROWS = 24  # rows of a table, or elements of GMS, that a bristle becomes
ROWS_FROM = 0.05  # of the bristle's length: the first row
REACHED = 0.999  # of the way from -T_c to T_c: the last row of a law that only approaches it
FROM_FULL_SLIP = 1e4  # bristle's lengths behind which it slips fully, for exponents up to 2; 1e-4 is missing then
EXPONENTS = (1.05, 5.9)  # of the rheology model's spring, within its admissible interval
SPRING_EXPONENT, SPRING_STEP = 1.8, 1e-4  # where the search begins, and its step: near 2 the formula loses its digits
