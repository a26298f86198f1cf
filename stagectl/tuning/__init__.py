"""Gains for a stated bandwidth and margin: families of designs, their robustness, the search, the sheet."""
