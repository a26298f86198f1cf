"""Numbers of the pipeline, of the fleet and of the knock-outs, with unit, origin and what each decides."""

from __future__ import annotations

# By `Options.full`; chosen.  Machines of the null ensemble, which give the detection limits.
ENSEMBLE_MEMBERS = {False: 12, True: 40}
# By `Options.full`; chosen.  Resamples for each experiment that is left out, which give the stability of an effect.
RESAMPLES = {False: 4, True: 25}
ENSEMBLE_SEED = 20100  # arbitrary; fixed, so that a diagnosis can be repeated.

KNOCKED_INERTIA = 0.2  # of the inertia; chosen.  What is knocked out of the model.
KEPT_COULOMB = 0.02  # of Coulomb friction; chosen.  What stays, so that the rolling zone keeps its length.
MOTION_CUTOFF = 50.0  # Hz; chosen.  Low-pass of the motion along which a force is made.
SIGN_SPEED = 0.01  # of the largest speed; chosen.  Width of the smoothed sign of the velocity.
STEP_TIME = 0.55  # of the session; chosen.  When the friction steps.
