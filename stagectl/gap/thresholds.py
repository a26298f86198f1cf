"""Numbers of the pipeline, with unit, origin and what each decides."""

from __future__ import annotations

# By `Options.full`; chosen.  Machines of the null ensemble: columns of the friction's error of form.
ENSEMBLE_MEMBERS = {False: 24, True: 40}
ENSEMBLE_SEED = 20100  # arbitrary; fixed, so that a diagnosis can be repeated.
