"""Numbers that decide something in the compensation of friction."""

ROUNDING = 1e-9  # of the largest speed: a slower reference is at rest; rounding
SMALLEST = 1e-6  # least divisor of the shape between two legs; avoids a division by zero
INVERSE_STEPS = 4  # of a control period, for the inverse of the model along the reference; 16 change 1 nm of the error
