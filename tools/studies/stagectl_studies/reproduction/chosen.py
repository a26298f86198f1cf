"""What the two papers leave open and this study chose; each with its unit and what it decides.

What decides whether a figure agrees is in `published.py`; nothing here was fitted to a figure but the one value that
says so.
"""

# Ball-screw paper, Fig. 3(a): its equation has Tc, Ts and alpha, and no values.
STRIBECK_RISE, STRIBECK_VELOCITY = 0.6, 1.0  # (Ts - Tc)/Tc; 1/alpha in rad/s, 2 mm/s: "ultra low"
STRIBECK_SPEEDS = (0.2, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 60.0)  # mm/s of the table, a decade either side
STRIBECK_SPAN, STRIBECK_STROKE = 1.5, 40e-3  # s and m: the shorter of the two is moved at each speed
STRIBECK_RAMP, STRIBECK_REST = 0.4, 0.1  # m/s^2 and s between the speeds

# Ball-screw paper, section IV.A.1: "identification using step response is also influenced", without a figure.
STEPS = (2.0, 3.0, 5.0, 9.0)  # A, from just above friction (1.4 A) to the largest R of Fig. 2
STEP_START, STEP_LENGTH = 0.05, 0.25  # s: the rise takes J/D = 0.071 s

# Slider paper, Figs. 3 to 5: friction that follows the speed late.
FRICTION_LAG = 30e-3  # s: the lag of the velocity in Stribeck's factor
FRICTION_RISE = 0.235  # with that lag the stage stands at 5.3 N after 5 and 10 mm/s: fitted to Fig. 4, nothing else
LAGS = (0.0, 30e-3, 100e-3)  # s, compared with each other

# Slider paper, section 3.2: a genetic algorithm, of which the text gives no more than the name.
POPULATION, GENERATIONS = 30, 50  # 1500 costs, as many as the optimiser of today takes
BITS = 16  # of a parameter, over the logarithm of its range
CROSSOVER = 0.8  # share of the pairs that exchange the ends of their strings
TOURNAMENT = 2  # strings of which the better one is a parent
