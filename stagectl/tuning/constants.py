"""Numbers that decide something in the tuning: what each decides, its unit, and its origin."""

SENSITIVITY_PEAK = 2.0  # Ms where no bandwidth is given: guarantees 6 dB and 29 deg; Skogestad, Postlethwaite, 2.4.4

# Ratios of a cascade: symmetric optimum with a = 4 (Kessler 1958); the filter's corner five times above is chosen.
SEPARATION = 4.0  # velocity bandwidth over that of the position loop
INTEGRAL = 4.0  # integral time over 1/(2 pi fv)
FILTERING = 5.0  # corner of the force filter over fv

# Search for a bandwidth.  Chosen.
SLOWEST, FASTEST = 2e-4, 0.25  # bandwidths that are tried: shares of the sampling frequency
GRID_STEPS, HALVINGS = 40, 12  # bandwidths of the grid; halvings of an interval between two of them
BEYOND = 1.01  # times the fastest bandwidth: where the binding margin is looked for
MOST_PID, MOST_VELOCITY = 2000.0, 1e4  # Hz, largest bandwidths that a stage file takes: of a PID, of a velocity loop

# Robustness.
LOWEST, POINTS = 1e-5, 1500  # of the sampling frequency, lowest frequency of the grid; number of frequencies; chosen
FAINTEST = 1e-4  # a lower gain margin beyond -80 dB is none: rounding near z = 1 would be read as one

# Step response.  Settled within 2 %: the usual definition; the rest chosen.
SETTLED = 0.02  # of the step
STEP_PERIODS = 20.0  # periods of the bandwidth over which settling is looked for
LONGEST = 200_000  # samples of a step response
