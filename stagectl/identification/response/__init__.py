"""Frequency response from current to velocity, and what friction does to it; `method` is where it begins."""
