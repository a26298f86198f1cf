"""The mechanics behind a foreign drive: a screw with inertia, friction and gravity, moved by the wall clock.

Positions are motor angles in rad, torques in N m.  The numbers are mild on purpose: at full torque the table reaches
80 mm/s in a few tenths of a second, so a busy computer's pauses stay harmless.
"""

from __future__ import annotations

import math

LEAD = 0.010  # m per revolution
COUNTS = 10_000  # per revolution: one count is 1 um of table
RATED_CURRENT = 5.0  # A: 0x6071 and 0x6077 count per mille of it, 5 mA
PEAK_CURRENT = 8.0  # A, the drive's own limit
FORCE_CONSTANT = 0.10  # N m/A
INERTIA = 0.002  # kg m^2
VISCOUS = 0.015  # N m s/rad
COULOMB = 0.05  # N m
METRES_PER_RAD = LEAD / (2.0 * math.pi)
_STEP = 0.0005  # s, longest step of the integrator
_LONGEST_GAP = 1.0  # s: a process that was stopped for longer does not catch up


class Plant:
    """An axis with Coulomb and viscous friction, an optional weight and an optional brake."""

    def __init__(self, gravity: float = 0.0) -> None:
        """At rest at 0; `gravity` (N m) pulls towards negative positions."""
        self.gravity = gravity
        self.angle = self.speed = 0.0
        self.braked = self._wanted = gravity != 0.0
        self._time, self._due = -1.0, 0.0

    def brake(self, closed: bool, takes: float) -> None:
        """Close or open the brake, which takes so long (s): by its springs, not when a busy process looks again."""
        if closed != self._wanted:
            self._wanted, self._due = closed, self._time + takes

    def advance(self, now: float, torque: float, braking: float = 0.0) -> None:
        """Move on to the time `now` (s) under a constant motor torque (N m), and one that only brakes."""
        gap = 0.0 if self._time < 0.0 else min(now - self._time, _LONGEST_GAP)
        self._time = now
        steps = math.ceil(gap / _STEP)
        for step in range(steps):
            self._step(now - gap + (step + 1) * gap / steps, gap / steps, torque, braking)

    def _step(self, time: float, dt: float, torque: float, braking: float) -> None:
        if time >= self._due:
            self.braked = self._wanted
        if self.braked:
            self.speed = 0.0
            return
        speed = self.speed + dt * (torque - self.gravity - VISCOUS * self.speed) / INERTIA
        dry = dt * (COULOMB + braking) / INERTIA  # the most that both take away in one step; they never reverse
        self.speed = math.copysign(max(abs(speed) - dry, 0.0), speed)
        self.angle += dt * self.speed

    @property
    def rests(self) -> bool:
        """Whether it stays where it is without power: a weight does by its brake, not where it turns to fall."""
        return self.braked or (self.speed == 0.0 and self.gravity == 0.0)

    @property
    def table(self) -> float:
        """Position of the table (m)."""
        return self.angle * METRES_PER_RAD


def ramp_torque(deceleration_counts: float) -> float:
    """Size (N m) of the torque of the drive's own ramp, limited by its peak current; it acts against the speed."""
    return min(INERTIA * deceleration_counts * 2.0 * math.pi / COUNTS, FORCE_CONSTANT * PEAK_CURRENT)
