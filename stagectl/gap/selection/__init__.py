"""Which effects explain the residuals: baseline fit, candidates, search, refinement."""
