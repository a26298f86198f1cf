"""A ladder of friction models, each fitted, the one of the smallest error taken: the structure is chosen, not found.

The rungs are the six models of BAM in the terms of our library (Duclusaud, Passault, Padois, Ly: Extended Friction
Models for the Physics Simulation of Servo Actuators, arXiv 2410.08650).
"""

from stagectl.gap.selection import refine
from stagectl_studies.baselines.baseline_common import Answer, Ground, shifts, singles

RUNGS: tuple[tuple[str, ...], ...] = (
    (),
    ("stribeck",),
    ("load_friction",),
    ("stribeck", "load_friction"),
    ("stribeck", "load_friction", "coulomb_asymmetry"),
    ("stribeck", "load_friction", "viscous_nonlinear"),
)


def ladder(g: Ground) -> Answer:
    """The rung that leaves least."""
    best = singles(g, refine.start(g.evidence))
    fits = []
    for rung in RUNGS:
        effects = [best[name] for name in rung if name in best]
        fits.append(refine.refine(g.evidence, g.evidence.base.model, effects, 2))
    chosen = min(fits, key=lambda fit: fit.residual_sum_of_squares)
    return Answer(tuple(effect.effect.name for effect in chosen.effects), chosen.equipped.stage, shifts(g))
