"""Inertia, viscous and rolling friction and delay from one motion with reversals; `method` is where it begins."""
