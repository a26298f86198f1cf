"""Parameters that every model has: a change of one is an error of the parameter, not a missing effect."""

from __future__ import annotations

from stagectl.gap.effects.effect import Amplitude, Parameters, ParametersOf
from stagectl.gap.effects.stage_changes import Change, added, coulomb, scaled, stretched


def _share(change: Change) -> ParametersOf:
    """A relative change of the parameter."""
    return lambda _: Parameters((Amplitude("size", "", (0.1,), -0.9, 10.0),), (), change)


PARAMETERS: dict[str, ParametersOf] = {
    "inertia": _share(scaled("mechanics.inertia")),
    "viscous": _share(scaled("mechanics.viscous")),
    "coulomb": _share(coulomb),
    "presliding": _share(stretched),
    "force_constant": _share(scaled("motor.force_constant")),
    "bias": lambda s: Parameters(
        (Amplitude("effort", "N m | N", (0.1 * s.coulomb,)),), (), added(effort="mechanics.bias")
    ),
}
