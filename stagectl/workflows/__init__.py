"""Whole tasks made of the rooms below: one motion, trials, comparisons, a battery of experiments, the demo."""
