"""Numbers that decide which effects explain the residuals.

Unless a line names another origin, a value was chosen and is not derived.  Gains are sums of squares of unit noise.
"""

# -- baseline fit ------------------------------------------------------------------------------------------------------
BASELINE_STEPS = 3  # Gauss-Newton steps: what moves along the measured path is almost linear in all parameters
BRISTLE_GAIN = 0.02  # share of the closable sum of squares: a bristle that explains less is left out
LEAST_NOISE = 1e-4  # share of the rms current, as a current and as its effort: less noise than that is not believed
NOISE_SEED = 1  # of the noise that stands for a repeat; any other gives the same density
DIFFERENCED_NOISE = 20.0  # variance of the third difference of white noise of variance one: 1 + 9 + 9 + 1
# Sizes of the changes by which sensitivities are taken, as shares.
INERTIA_CHANGE = 0.05  # of the inertia
BIAS_CHANGE = 0.05  # of the Coulomb friction
VISCOUS_CHANGE = 0.1  # of the viscous friction
WEIGHT_CHANGE = 0.02  # of the Coulomb friction, for one stop operator
SHIFT_CHANGE = 0.2  # of the control period
SHIFTS_TRIED = (0.0, 0.25, -0.25, 0.5, -0.5, 0.75, -0.75, 1.0, -1.0)  # of it, from which the fit may begin; chosen
FRICTIONS_TRIED = (0.25, 0.5, 1.0)  # of the rms effort, where the nominal model has none; chosen
LAGS_TRIED = (0.2, 0.4, 0.8)  # of it, further lag of the current loop, whose staircase is rounded and not late; chosen
BRISTLE_CHANGE, LENGTH_CHANGE = 0.1, 0.2  # of the size and the length of the nominal bristle
# Gauss-Newton steps of the whole base with its bristle's shape, at most: one that settles takes three to twelve.  After
# eight the friction of a LuGre stage still was in the stop operators, and a sixth of the misfit was left.
SHAPE_STEPS = 40
SHAPE_SENSITIVITY = 0.1  # of the logarithms of the shape, and of critical damping, for their sensitivities
DAMPING_STEP = 0.3  # of its critical damping, by which that of a bristle may grow in one step; chosen
EXPONENTS = (0.2, 4.0)  # of a bristle: those that a stage file takes
MEMBER_CHANGE = 0.1  # of the Coulomb friction, for a bristle next to the stop operators
START_LOAD = 0.5  # of the friction's limit, with which the runs begin
NATURAL_DAMPING = 1e-3  # share of inertia over control period: unit of viscous friction where the model has none
# How far down a parameter may go in one step, as shares of its value.
LOWEST_MECHANICS = -0.9  # inertia and viscous friction
LOWEST_BRISTLE = -0.8  # size and length of the nominal bristle
SHORTEST_BRISTLE = 0.2  # factor on the length of the nominal bristle
AMPLITUDE_WIDTH = 10.0  # of an effect's largest typical amplitude: what an effect may be before any data
MOST_SHIFT = 5.0  # control periods by which the logged current may be late or early

# -- machine scales, effects, refinement -------------------------------------------------------------------------------
LARGEST_SPEED = 99.5  # percentile of the speed that counts as the largest
SCALED_CHANGE = 0.1  # share by which a parameter that varies with time is changed for its column
# Of what is missing: on the runs that hold it the places are compared, and the best few of them on all; chosen.  Of 44
# places of a session with a gap, the best four on a fifth of its rows hold the three that are best on all.
MISSING_SHARE, PROMISING_PLACES = 0.4, 4
# Of the search for the place of what bends: members of its population for each parameter, next to the effect's grid;
# generations; by how much its ranges are wider than the grid.  Chosen: with half the members one of two gaps is lost.
SEARCH_MEMBERS, SEARCH_GENERATIONS, SEARCH_WIDER = 8, 12, 3.0
SEARCH_SEED = 1  # arbitrary; fixed, so that a diagnosis can be repeated
REFINEMENT_STEPS = 12  # Gauss-Newton steps at most: three left a third of the misfit of a nonlinear viscous friction
STEP_SHARES = (1.0, 0.4, 0.1)  # of a Gauss-Newton step, tried until one improves the fit
SHAPE_FACTOR = 1.6  # by which a shape may change in one step
# Of the cost, in which a parameter that is off by its standard deviation is worth one: a step that gains less is the
# last one.
SETTLED = 0.3
BROKEN_PROMISE = 3.0  # of the cost, chosen: a step that promised as much and gains nothing had the wrong columns
AS_CLOSE = 1e-3  # share of the sum of squares by which a fit may leave more and is still as good; chosen
AMPLITUDE_CHANGE = 0.1  # of an amplitude, for its sensitivity
LEAST_AMPLITUDE = 0.3  # of an effect's typical amplitude, where its own is smaller
SHAPE_CHANGE = 0.05  # of a shape, for its sensitivity
SHARE_CHANGE = 0.02  # of a share, for the same
# Damping ratio from which a resonance is broad enough for these changes; those of a narrower one are smaller in
# proportion, so that its frequency moves by a twentieth of its width.  A base with a damping of 0.012 kept 56 % of its
# misfit with whole changes.  From four places within 10 % of its frequency it keeps 2 to 4 %; with half of this value 3
# to 5 %, with a quarter 3 to 19 %, with four times it 2 to 18 %.
BROAD_DAMPING = 0.5

# -- null ensemble: machines with another law of friction --------------------------------------------------------------
ENSEMBLE_MEMBERS = {False: 24, True: 40}  # by `Options.full`; columns of the friction's error of form
ENSEMBLE_SEED = 20100  # arbitrary; fixed, so that a diagnosis can be repeated
ZONE_SPREAD = 0.2  # standard deviation of the logarithm of the rolling zone
ELEMENT_COUNTS = (5, 16)  # Maxwell-slip elements, from and below
SLIP_RANGE = (0.02, 0.55)  # of the rolling zone
WEIGHT_CONCENTRATION = 1.5  # of the Dirichlet distribution of the weights
EXPONENT_RANGE = (0.5, 2.0)  # of Dahl's law
DAMPING_RANGE = (0.0, 0.02)  # of LuGre's bristle, in units of twice the root of its stiffness times 1e-6
RANGE_LEFT = 0.1  # of the two range lengths between -1 and 1 that is left when 95 % of a bristle has reversed
