"""A friction law in plain Python, in closed loop: LuGre with its bristle as state."""

import math

import stagectl as sc

stage = sc.load_stage("config/ball-screw.yaml")


class Lugre:
    """Called once per integration step with velocity (rad/s), position (rad) and step (s); returns N m."""

    coulomb, static, stribeck_velocity = 1.0, 1.3, 0.05  # N m, N m, rad/s
    stiffness, damping = 2.0e3, 0.5  # N m/rad, N m s/rad: stiffness * step^2 must stay far below the inertia

    def __init__(self) -> None:
        self.bristle = 0.0  # rad

    def __call__(self, velocity: float, position: float, step: float) -> float:
        """Friction (N m), positive against positive velocity."""
        level = self.coulomb + (self.static - self.coulomb) * math.exp(-((velocity / self.stribeck_velocity) ** 2))
        rate = velocity - self.stiffness * abs(velocity) / level * self.bristle
        self.bristle += rate * step
        return self.stiffness * self.bristle + self.damping * rate


for name, friction in (("stage file", None), ("LuGre", Lugre())):
    run = sc.simulate(stage, "config/trajectories/sine-3.2hz.yaml", friction=friction)
    print(f"{name}: peak error {1e6 * run.summary['tracking_error']['peak']:.3f} um")
run.save("recordings/lugre.h5")
