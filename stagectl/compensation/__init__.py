"""Friction compensation computed before the motion: a force for every position and velocity of the reference."""
