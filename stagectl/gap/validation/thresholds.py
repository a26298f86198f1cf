"""Every number that decides something in the validation, with its unit, its origin and what it decides."""

# Sub-steps of a control period; as the virtual drive takes.  Accuracy of the simulated closed loop.
SUBSTEPS = 10
# Periods of the crossover frequency after which a loop has forgotten a disturbance: a PID with four equal poles all but
# 0.1 % of the peak.  Rows after a rest before that are not judged.  Measured on a machine without an effect: 250 nm of
# gap at 0, 81 at 2, 75 at 3 and 74 at 6, over a floor of 74; a cascade settles at 4 to 6.
SETTLING = 4.0
# Share of a log's rows; chosen.  With fewer a log of steps within the rolling zone is judged in all its rows.
LEAST_JUDGED = 0.5
# Chosen.  Resamples of the half strokes, for the interval of the closure.
BOOTSTRAP_RESAMPLES = 400
# Share of them with a gap above the floor; from the interval's 95 %.  With fewer the closure has no interval.
LEAST_RESAMPLES = 0.975
# Squared gap over the smallest of all models; chosen.  A richer model is taken where its gap is not larger than this.
NEARLY_CLOSEST = 1.05
# Times the floor; measured: of 84 machines without an effect, 28 with another friction law, none was beyond 3.4.  A
# gap stays open only where it is larger.
OPEN_ABOVE_FLOOR = 5.0
# Upper end of the closure's interval; chosen.  A gap stays open only where surely less of it closes.  At 0.5 a friction
# of no known law and a backlash that may not be named, at 9 and 11 floors, were called parameters: they had closed 0.63
# and 0.68 of the gap.  Four right diagnoses beyond 3 floors closed 0.91 to 0.99.
OPEN_CLOSURE = 0.8
# Chosen.  Blocks of half strokes, each predicted from the others where no run is held out.
BLOCKS = 5
# Share of the closable gap; chosen.  A form of the friction that takes less is neither stated nor written.
FORM_SHARE = 0.02
