"""Frequency response from current to velocity, and the effect of friction on it; `method` is where it begins."""
