"""Parameters, friction, and what depends on the place, in words."""

from __future__ import annotations

from stagectl.report.effects.effect_text import Group, Told

PARAMETERS = Group(
    "Parameters that are off",
    "What every model has already. A shift of one is reported as `parameters`, and its value is refitted before any "
    "effect is looked for.",
    (
        Told(
            "inertia",
            "More moving mass than the model has: the lacking effort is a straight line over the acceleration.",
            "2 to 30 %",
            "force constant; compliance below its resonance; a dead time, over the jerk",
            "sines of low and high frequency at equal speed; an added mass that is known",
        ),
        Told(
            "force_constant",
            "An ampere gives another effort than the model says: everything scales with the current.",
            "3 to 10 %; -0.1 to -0.2 % a kelvin",
            "exactly like inertia, viscous, Coulomb friction and bias together, and like the gain of the reported "
            "current: no motion of the axis alone tells them apart",
            "an added mass, a hanging weight, or the back-EMF",
        ),
        Told(
            "viscous",
            "A friction that grows with speed, steeper or flatter than the model's.",
            "5 to 50 %",
            "warming; nonlinear viscous friction",
            "stairs of speeds both ways",
        ),
        Told(
            "coulomb",
            "A friction that only knows the direction, larger or smaller than the model's: a step at zero speed.",
            "5 to 30 %",
            "Coulomb asymmetry; presliding",
            "stairs of speeds both ways",
        ),
        Told(
            "presliding",
            "The balls roll further before they slip than the model says: effort lacks within the rolling zone after "
            "each reversal, and nowhere else.",
            "rolling zones of 5 to 100 µm",
            "warming of the Coulomb friction in a short run; backlash; Stribeck friction",
            "micro-sines of 2, 8 and 50 µm",
        ),
        Told(
            "bias",
            "A constant force on the axis, such as gravity on a stage that is tilted.",
            "0 to 0.3 N m",
            "current offset; Coulomb asymmetry (exactly so at one speed)",
            "the torque at rest, at many positions, reached from both sides",
        ),
    ),
)
FRICTION = Group(
    "Friction",
    "Factors on what slips, and the dependence on speed, rest and load.",
    (
        Told(
            "coulomb_asymmetry",
            "More friction one way than the other, `Tc (1 + e sgn v)`: the even part of a step at zero speed.",
            "1 to 10 %",
            "bias (exactly so at one speed); viscous asymmetry",
            "stairs both ways, and the torque at rest",
        ),
        Told(
            "viscous_asymmetry",
            "Another viscous friction one way than the other, `D (1 + e sgn v)`: even in velocity, zero at rest. "
            "The EMPS axis has about 18 %.",
            "2 to 20 %",
            "Coulomb asymmetry",
            "stairs both ways, over a decade of speed",
        ),
        Told(
            "viscous_nonlinear",
            "Grease and seals: the friction bends over the speed, by its square or its root.",
            "10 to 30 % of `D w` at the largest speed",
            "Stribeck friction, where speeds are few",
            "six speeds or more, over two decades",
        ),
        Told(
            "stribeck",
            "More friction at a creep than at speed: the lubricant's film builds up.",
            "0.05 to 0.5 of Tc, below 0.1 to 20 rad/s",
            "nonlinear viscous friction; friction that grows at rest",
            "creep speeds, and stairs that are spaced by equal ratios",
        ),
        Told(
            "friction_lag",
            "The film follows the speed with a delay, so the Stribeck curve opens into a loop: more friction while "
            "the axis gets faster, less while it gets slower.",
            "1 to 20 ms",
            "presliding",
            "one way at a speed that swings, at several rates, so that no reversal takes part",
        ),
        Told(
            "dwell",
            "The contact ages at rest: the first rolling zone after a dwell takes more, and some slip wipes it out.",
            "1 to 8 % per e-fold of the time at rest",
            "Stribeck friction; presliding",
            "steps after dwells of 0.1, 1, 5 and 30 s",
        ),
        Told(
            "load_friction",
            "The nut presses harder while it pushes: friction grows with the motor's effort.",
            "1 to 8 % of the effort",
            "inertia, if the direction is not looked at",
            "one speed, reached at accelerations over a decade",
        ),
    ),
)
PLACE = Group(
    "Over the place",
    "What repeats where the axis is: along the stroke, with the lead, with the magnets, with the cable.",
    (
        Told(
            "position_friction",
            "A screw that is not equally straight or tight everywhere: friction drifts along the stroke, with "
            "opposite signs forth and back.",
            "5 to 30 % over the stroke",
            "a cable's spring, if only one way is driven",
            "a slow scan both ways",
        ),
        Told(
            "lead_friction",
            "Friction once per turn of the screw: it turns its sign with the direction.",
            "2 to 10 % of Tc",
            "cogging, if only one way is driven",
            "a scan both ways",
        ),
        Told(
            "ball_pass_ripple",
            "Balls entering the nut: a ripple whose order is no whole number, so its phase drifts against the turn.",
            "1 to 5 % of Tc",
            "friction once per revolution",
            "a long way at constant speed",
        ),
        Told(
            "cogging",
            "Magnets pulling at the iron: an effort over the angle, the same both ways and at any current.",
            "5 to 50 mN m",
            "current ripple at one current",
            "a scan at two loads",
        ),
        Told(
            "current_ripple",
            "The force constant ripples over the electrical angle: an effort over the angle that is proportional to "
            "the current.",
            "0.5 to 3 % of the effort",
            "cogging",
            "its amplitude against the current: the same way at little and at much of it",
        ),
        Told(
            "cable_spring",
            "A cable that pulls towards its middle: an effort over the position, the same both ways.",
            "0.001 to 0.04 N m/rad",
            "friction that changes along the stroke, if only one way is driven",
            "a scan both ways",
        ),
        Told(
            "cable_hysteresis",
            "A cable carrier that bends and sticks: a force that turns round over millimetres, not micrometres.",
            "0.02 to 0.3 N m over 1 to 10 mm",
            "presliding",
            "three strokes of the millimetre range",
        ),
    ),
)
