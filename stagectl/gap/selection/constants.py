"""Every number of the evidence that decides which effects are named: its unit, its origin, and what it changes.

Sensitivities are those of a prototype on 30 development machines (Brier score a machine, base 0.111), unless a line
names another source.  Powers of the likelihoods need no number here: see `evidence.temper`.
"""

# -- what is known of the base, standard deviations --------------------------------------------------------------------
# Shares of the nominal inertia and viscous friction, and of the Coulomb friction (bias, weights, bristles).  Origin:
# how far a user's values are off.  All three times 0.3 or 10: 0.115, 0.110.
INERTIA, VISCOUS, FRICTION = 0.3, 0.5, 0.3
LENGTH = 0.5  # share of the length of the nominal bristle; chosen.

# -- what is known of an effect ----------------------------------------------------------------------------------------
# Prior odds that an effect is there: one of the library's, on the average.  1/15 or 1/150: 0.116, 0.113.
INCLUSION = 1.0 / 39.0
# Times an effect's typical size: its amplitude is of one of these scales; how often, in proportion.  The first three
# times 0.5 or 2: 0.121, 0.108.  The last two are of machines of another kind, chosen as one in a hundred and in a
# thousand: the spring of a flexure is 290 times that of a cable.  As often as the others, they make a stiff spring an
# alternative to gravity.
SCALES = ((0.5, 1.0), (1.0, 1.0), (3.0, 1.0), (30.0, 0.03), (300.0, 0.003))
WIDEST = 3.0  # times its value or its typical size: what is known of an effect that is in the model
# Of the typical size: a trace that every machine has of everything, and the error of form of what is explained.
# Origin: 12 development machines.  Sum of squares a machine, and wrong names, of the linear evidence alone: 1.06 and 9
# at 0, 0.70 and 4 at 0.05, 0.59 and 2 at 0.1, 0.56 and 2 at 0.2.  On 16 unseen ones the whole diagnosis finds one
# effect more at 0.1, and names three that are not there.
IMMATERIAL = 0.15
SCALE_RANGE = 1e3  # of an error of form over the noise, within which its scale is unknown; chosen
BENT = 0.25  # of the size at which a column was taken that bends with it; chosen.  How far the column is believed.
SHAPE = 0.5  # of its value: standard deviation of a refined shape; chosen.  Decides intervals, no name.
# Of the typical size: where the fitted amplitude is smaller, its column is taken at the typical one; chosen.  No name.
LEAST_SIZE = 0.1

# Control periods; chosen.  Beyond it, a drive that answers later may stand behind a time shift of the current.  Halved
# and doubled on eight short sessions with a late drive, report or gain: no name changes.
LEAST_SHIFT = 0.05
# Of what several effects explain together; chosen.  One that explains all but that is taken first, by itself.  Halved
# and doubled on the same sessions: no name changes.
ONE_OF_MANY = 0.05
# Power of a line over the median of its surroundings; derived: noise alone has one in a thousand spectra.  Of 13
# machines of the exam without cogging the highest is 13.6, but for one whose inertia swings with the position.
LINE = 20.0
GONE = 0.75  # of a line's power; chosen.  A fit that explains so much of it is the wave.
# Effects that make a line over the position: a force, one with its multiples, a place that is read wrong.
WAVES = ("cogging", "cogging_map", "encoder_eccentricity")
# Effects whose force turns with the current, so that its product with the current makes a line.  Of 13 machines of the
# exam without a ripple the highest is 16, of three with one the lowest 116.
RIPPLES = ("current_ripple", "ball_pass_ripple")
# Relative; chosen.  A further ripple at an order as near is a sideband of the first.  On a machine whose ball pass of
# order 5.22 drifts, a current ripple of order 5 had P 1.00, with a hundredth of its amplitude.
SIDEBAND = 0.1
LEAD = "lead_friction"
TIMING = ("dead_time", "current_loop")  # effects that make it answer later
CLIPPING = ("current_saturation", "voltage_saturation")  # effects that cut off the noise of a repeat as well
SCALING = ("current_gain", "torque_path")  # what it reports, and what it gives
OFFSET = "current_offset"  # what it reports, or gives

AT_BOUND = 0.01  # of an end of an amplitude's range; chosen.  So near to it, the data ask for more than there is.

# -- sets --------------------------------------------------------------------------------------------------------------
BEAM = 12  # sets that are continued by one effect more; chosen.  Costs time alone: four are as good as twelve.
# Of the probability of the best set: a less probable one of several effects is not kept.  Derived: a hundred thousand
# of them are worth 1e-4 together.
NEGLIGIBLE = 1e-9
MOST_EFFECTS = 4  # in one set; two score as four.
# Of an effect's gain; chosen.  What the error of its form may leave over the same coordinate, or another effect name.
OF_KIN = 0.25
KEPT = 0.5  # probability that something stands in an effect's place: below, the effect leaves the model; derived.
COMPARABLE = 0.1  # odds of another effect in the place of one: from there on it is an alternative; chosen.
# Of what a function of one coordinate predicts, or of all that is left above the noise: an effect that explains so much
# of it is the cause.  Effects that are there, behind stronger ones, explained 0.62 to 0.93; next to the models of some
# 28 machines the columns of effects that are not there 0.38 at most, but for a gain of the current, whose column alone
# reached 0.95 on aliens; it was named on none of them.
ADEQUATE = 0.57
# The same of an effect that bends, where no function of one coordinate predicts anything.  Each impact of a gap depends
# on those before it: five backlashes of another hand explained 0.73 to 0.93, and three 0.22 to 0.50 whose cable pulled
# the motor.  Next to 24 machines of other causes or none, the best of all that bend explained 0.23 at most.
ADEQUATE_BENT = 0.4
# Times what a function of one coordinate leaves: mechanical effects that leave more are not the cause, unless that is
# less than FORM of what they explain, an error of a third of their force.  On ten machines of an exam what is named
# rightly leaves twice as much as a function at most; a hardening spring as one of a cable 200 times.  Chosen.
OUTDONE, FORM = 4.0, 0.1
