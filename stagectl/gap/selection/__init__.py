"""Which effects explain the residuals: baseline fit, candidates, evidence, refinement."""
