"""Ambiguities that are physics and not statistics: no motion of this kind tells these apart."""

from __future__ import annotations

from collections.abc import Iterable

# What has the same effect on every log, whatever moves.
EXACT: tuple[frozenset[str], ...] = (
    frozenset({"force_constant", "current_gain"}),
    frozenset({"dead_time", "jitter"}),
)
# What holds an effect as a special case, and so explains all that it does.
WIDER: dict[str, frozenset[str]] = {
    "stribeck": frozenset({"friction_lag"}),
    "lead_friction": frozenset({"ball_pass_ripple"}),
}
# What is another effect with something more to it, and takes its place.
OVER: dict[str, str] = {"friction_lag": "stribeck"}
# Whose error of form looks like another one: no curve, period or course in time is quite that of its model.
KIN: tuple[frozenset[str], ...] = (
    frozenset({"stribeck", "friction_lag", "viscous_nonlinear"}),
    frozenset({"cogging", "current_ripple", "lead_friction", "ball_pass_ripple", "encoder_eccentricity"}),
    frozenset({"cable_spring", "cable_hysteresis", "position_friction"}),
    frozenset({"dwell", "backlash", "compliance", "cable_hysteresis"}),
    frozenset({"thermal_viscous", "thermal_coulomb", "friction_step"}),
    frozenset({"dead_time", "current_loop"}),
    frozenset({"current_saturation", "voltage_saturation", "current_gain"}),
)
# What has the same effect under a condition on the data.
WITHOUT_CURRENT = frozenset({"bias", "current_offset"})
ONE_SPEED = frozenset({"bias", "coulomb_asymmetry"})


def narrower(name: str, other: str) -> bool:
    """Whether `other` is a special case of `name`."""
    return name in WIDER.get(other, ())


def alternatives(name: str, sets: Iterable[frozenset[str]]) -> tuple[str, ...]:
    """What stands in one set with `name`."""
    return tuple(sorted({other for one in sets if name in one for other in one} - {name}))
