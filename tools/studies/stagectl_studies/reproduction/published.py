"""What the two papers state in numbers.  Their figures have no numbers beyond these in the text that we have."""

# Simultaneous Identification of Linear Parameters and Nonlinear Rolling Friction for Ball Screw Driven Stage.
FORCE_CONSTANT = 0.72  # N m/A, section IV.A.1
INERTIA = 0.010  # kg m^2, both routes
VISCOUS = 0.14  # N m s/rad, constant speed (Fig. 5) and proposed (section IV.B)
VISCOUS_CURVE_FIT = 0.10  # N m s/rad, Fig. 4 at R = 9
MISPRINT_INERTIA, MISPRINT_VISCOUS = 0.1, 0.01  # steps 3 and 2 of section IV.B
SPRING_CONVENTIONAL, SPRING_PROPOSED = 10e-6, 20e-6  # m after a reversal, Figs. 6 and 10(a)
BANDWIDTH = 40.0  # Hz

# The friction paper of the linear slider.
HOLDING_FORCE = 5.3  # N at zero velocity, Fig. 4
VIBRATION = 40.0  # Hz after the force is set to zero, Fig. 5
RELEASE_TRAVEL = (15e-6, 20e-6)  # m, Fig. 5
ERROR_NONE, ERROR_PROPOSED = -4.7e-6, -2.4e-6  # m at 10 mm/s, Fig. 10
POSITIVE_CONVENTIONAL = 1.5e-6  # m, Fig. 10
