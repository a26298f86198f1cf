"""Numbers that decide which effects explain the residuals.

Unless a line names another origin, a value was chosen and is not derived.  Gains are sums of squares of unit noise.
"""

from __future__ import annotations

# -- baseline fit ------------------------------------------------------------------------------------------------------
BASELINE_STEPS = 3  # Gauss-Newton steps: what moves along the measured path is almost linear in all parameters
BRISTLE_GAIN = 0.02  # share of the closable sum of squares: a bristle that explains less is left out
LEAST_NOISE = 1e-4  # share of the rms current, as a current and as its effort: less noise than that is not believed
DIFFERENCED_NOISE = 20.0  # variance of the third difference of white noise of variance one: 1 + 9 + 9 + 1
# Sizes of the changes by which sensitivities are taken, as shares.
INERTIA_CHANGE = 0.05  # of the inertia
BIAS_CHANGE = 0.05  # of the Coulomb friction
VISCOUS_CHANGE = 0.1  # of the viscous friction
WEIGHT_CHANGE = 0.02  # of the Coulomb friction, for one stop operator
SHIFT_CHANGE = 0.2  # of the control period
BRISTLE_CHANGE, LENGTH_CHANGE = 0.1, 0.2  # of the size and the length of the nominal bristle
MEMBER_CHANGE = 0.1  # of the Coulomb friction, for a bristle next to the stop operators
START_LOAD = 0.5  # of the friction's limit, with which the runs begin
NATURAL_DAMPING = 1e-3  # share of inertia over control period: unit of viscous friction where the model has none
# How far down a parameter may go in one step, as shares of its value.
LOWEST_MECHANICS = -0.9  # inertia and viscous friction
LOWEST_BRISTLE = -0.8  # size and length of the nominal bristle
SHORTEST_BRISTLE = 0.2  # factor on the length of the nominal bristle

# -- machine scales, effects, refinement -------------------------------------------------------------------------------
LARGEST_SPEED = 99.5  # percentile of the speed that counts as the largest
SCALED_CHANGE = 0.1  # share by which a parameter that varies with time is changed for its column
REFINEMENT_STEPS = 3  # Gauss-Newton steps
STEP_SHARES = (1.0, 0.4, 0.1)  # of a Gauss-Newton step, tried until one improves the fit
SHAPE_FACTOR = 1.6  # by which a shape may change in one step
SETTLED = 1e-3  # share of the sum of squares: a step that gains less is the last one
AMPLITUDE_CHANGE = 0.1  # of an amplitude, for its sensitivity
LEAST_AMPLITUDE = 0.3  # of an effect's typical amplitude, where its own is smaller
SHAPE_CHANGE = 0.05  # of a shape, for its sensitivity

# -- null ensemble: machines with another law of friction --------------------------------------------------------------
ZONE_SPREAD = 0.2  # standard deviation of the logarithm of the rolling zone
ELEMENT_COUNTS = (5, 16)  # Maxwell-slip elements, from and below
SLIP_RANGE = (0.02, 0.55)  # of the rolling zone
WEIGHT_CONCENTRATION = 1.5  # of the Dirichlet distribution of the weights
EXPONENT_RANGE = (0.5, 2.0)  # of Dahl's law
DAMPING_RANGE = (0.0, 0.02)  # of LuGre's bristle, in units of twice the root of its stiffness times 1e-6
RANGE_LEFT = 0.1  # of the two range lengths between -1 and 1 that is left when 95 % of a bristle has reversed

# -- detection ---------------------------------------------------------------------------------------------------------
BEYOND = 1.5  # times the largest gain in the null ensemble: limit of an effect's gain
SMALLEST_GAIN = 60.0  # what noise alone gives the best of many forms
CERTAIN = 2.0  # times SMALLEST_GAIN: what noise gives the best of many forms in the best of many experiments
EXCITED = 0.2  # of an effect's column: a resample with less does not excite the effect
SINGULAR = 1e-10  # relative eigenvalue of the nuisances' correlations below which a direction is left out
SINGULAR_FORM = 1e-12  # the same among the amplitudes of one form

# -- search ------------------------------------------------------------------------------------------------------------
MOST_EFFECTS = 5  # that are searched for at once
MATERIAL = 0.03  # share of the closable gap in an effect's channel that it must explain
MATERIAL_UNREPEATED = 0.1  # the same where nothing was repeated: there is no floor, and form error counts as gap
# Share of the closable gap that the baseline fit and the friction laws left: less is the form error of something else.
OF_ALL = 0.01
# The same for a weaker second effect that explains DOMINANT of the rest and is FAR above its limit.
OF_ALL_CLEAR = 0.001
FAR = 20.0  # times its limit
DOMINANT = 0.1  # relative drop of the sum of squares from which an effect is judged by it alone
VANISHING = 0.4  # share of resamples: an effect found in fewer is dropped
ADEQUATE = 0.57  # of what a function of one coordinate predicts: an effect that explains less is not the cause
OF_KIN = 0.25  # of an effect's gain: what the error of its form may give a similar effect
OF_MORE = 0.3  # of the rest: from there on an effect counts as a special case of a wider one
RIVAL = 0.7  # of the largest gain: from there on a rival is refined, too, before one is chosen
