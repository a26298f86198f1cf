"""Friction around the reversals of a slider; `method` is where it begins."""
