"""The methods by the names that a user types.  Nothing is imported here: the help of `identify` lists them."""

from typing import NamedTuple


class Method(NamedTuple):
    """Where a method is, and what it is for."""

    module: str  # holds identify(captures, file, progress, ...) -> IdentificationResult
    words: str


METHODS = {
    "simultaneous": Method(
        "simultaneous.method", "inertia, viscous and rolling friction and delay from any motion with reversals"
    ),
    "frf": Method("response.method", "response from current to velocity, at several amplitudes"),
    "constant-speed": Method("constant_speed", "viscous and Coulomb friction from spans of constant speed"),
    "low-speed": Method("low_speed", "rolling friction from an ultra-slow motion there and back"),
    "zero-crossing": Method("reversal.method", "friction around the reversals of a slider"),
    "least-squares": Method("least_squares.method", "inertia, viscous and Coulomb friction and offset"),
    "friction-models": Method("friction.method", "every friction model of the family, fitted and compared"),
}


def listed() -> list[str]:
    """What each gives."""
    return [f"{name}: {method.words}" for name, method in METHODS.items()]
