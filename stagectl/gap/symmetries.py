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
# What has the same effect under a condition on the data.
WITHOUT_CURRENT = frozenset({"bias", "current_offset"})
ONE_SPEED = frozenset({"bias", "coulomb_asymmetry"})


def alternatives(name: str, sets: Iterable[frozenset[str]]) -> tuple[str, ...]:
    """What stands in one set with `name`."""
    return tuple(sorted({other for one in sets if name in one for other in one} - {name}))
