"""The friction of a stage file: which law, and the plant's parameters that follow from it."""

import types
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple, TypeVar, cast, get_type_hints

from stagectl.kernels import friction, friction_bristle, stage
from stagectl.kernels.plant import Friction
from stagectl.units import Quantity

EFFECTS = Friction._fields[Friction._fields.index("lag") :]  # what changes the limit of any law
L = TypeVar("L")


def _with_effects(law: L) -> L:
    """The block of a law with the entries of every law, the effects, behind its own."""
    own: Any = law
    hints, kernel = get_type_hints(law, include_extras=True), get_type_hints(Friction, include_extras=True)
    content = {
        "__doc__": law.__doc__,
        "__module__": law.__module__,
        "__annotations__": {**hints, **{name: kernel[name] for name in EFFECTS}},
        **own._field_defaults,
        **{name: Friction._field_defaults[name] for name in EFFECTS},
        **{name: vars(law)[name] for name in {"operators", "bristle"} & {*vars(law)} - {*own._fields}},
    }
    block: Any = types.new_class(own.__name__, (NamedTuple,), exec_body=lambda names: names.update(content))
    return cast("L", block)


@_with_effects
class Rolling(NamedTuple):
    """Rolling friction: equal elements whose slips are spaced geometrically."""

    coulomb: Annotated[float, Quantity("N m | N", "[0, 1e6]", "friction when all elements slip, T_c")]
    shortest: Annotated[float, Quantity("rad | m", "(0, 1e3]", "slip of the stiffest element")]
    longest: Annotated[float, Quantity("rad | m", "(0, 1e3]", "slip of the softest element")]
    elements: Annotated[int, Quantity("", "[1, 64]", "number of stop operators")] = 12
    stribeck: friction.Stribeck = friction.Stribeck()

    def operators(self) -> friction.StopOperators:
        """The elements, one by one."""
        steps = max(self.elements - 1, 1)
        ratio = self.longest / self.shortest
        slips = [self.shortest * ratio ** (j / steps) for j in range(self.elements)]
        return friction.bundle([self.coulomb / self.elements] * self.elements, slips)


class OwnBristle(NamedTuple):
    """A bristle in addition to the stop operators, as in Dahl's or LuGre's law; a `coulomb` of 0: none."""

    coulomb: Annotated[float, Quantity("N m | N", "[0, 1e6]", "its friction at speed; 0 is none")] = 0.0
    range: Annotated[float, Quantity("rad | m", "(0, 1e3]", "its friction over its stiffness at rest")] = 1.0
    exponent: Annotated[float, Quantity("", "[0.2, 4]", "n, the shape of the approach; 1 is exponential")] = 1.0
    damping: Annotated[float, Quantity("N m s/rad | N s/m", "[0, 1e9]", "of the bristle, sigma_1")] = 0.0


@_with_effects
class Operators(NamedTuple):
    """Rolling friction element by element, as an identification writes it; a bristle may bend the curve further."""

    weight: Annotated[tuple[float, ...], Quantity("N m | N", "[0, 1e6]", "force at which each element slips")]
    slip: Annotated[tuple[float, ...], Quantity("rad | m", "(0, 1e3]", "displacement at which each element slips")]
    stribeck: friction.Stribeck = friction.Stribeck()
    bristle: OwnBristle = OwnBristle()

    def operators(self) -> friction.StopOperators:
        """The elements, as given."""
        return friction.bundle(self.weight, self.slip)


@_with_effects
class Dahl(NamedTuple):
    """Dahl's friction: one bristle that bends towards its limit as the axis moves."""

    coulomb: Annotated[float, Quantity("N m | N", "(0, 1e6]", "friction at speed, T_c")]
    range: Annotated[float, Quantity("rad | m", "(0, 1e3]", "T_c over the stiffness at rest, sigma_0")]
    exponent: Annotated[float, Quantity("", "[0.2, 4]", "n, the shape of the approach; 1 is exponential")] = 1.0

    def bristle(self) -> friction_bristle.Bristle:
        """The law, ready to run."""
        return friction_bristle.Bristle(self.coulomb, self.coulomb / self.range, self.exponent)


@_with_effects
class Lugre(NamedTuple):
    """LuGre friction: a damped bristle whose limit follows Stribeck's curve."""

    coulomb: Annotated[float, Quantity("N m | N", "(0, 1e6]", "friction at speed, T_c")]
    range: Annotated[float, Quantity("rad | m", "(0, 1e3]", "T_c over the stiffness at rest, sigma_0")]
    damping: Annotated[float, Quantity("N m s/rad | N s/m", "[0, 1e9]", "damping of the bristle, sigma_1")] = 0.0
    stribeck: friction.Stribeck = friction.Stribeck()

    def bristle(self) -> friction_bristle.Bristle:
        """The law, ready to run."""
        return friction_bristle.Bristle(self.coulomb, self.coulomb / self.range, 1.0, self.damping, self.stribeck)


LAWS = {"rolling": Rolling, "stop-operators": Operators, "dahl": Dahl, "lugre": Lugre}


def law_in(block: Mapping[str, Any]) -> Rolling | Operators | Dahl | Lugre:
    """The law of a block in SI, as an identification writes it."""
    entries: dict[str, Any] = {key: tuple(x) if isinstance(x, list) else x for key, x in block.items()}
    if "stribeck" in entries:
        entries["stribeck"] = friction.Stribeck(**entries["stribeck"])
    law: Any = LAWS[entries.pop("law")]
    return cast("Rolling | Operators | Dahl | Lugre", law(**entries))


def friction_of(law: Rolling | Operators | Dahl | Lugre) -> stage.Friction:
    """The plant's friction: a bundle of stop operators, with a bristle or without, or a bundle that carries nothing."""
    if isinstance(law, Dahl | Lugre):
        friction_ = stage.Friction(friction.bundle([0.0], [1.0]), friction.Stribeck(), law.bristle())
    else:
        friction_ = stage.Friction(law.operators(), law.stribeck, _beside(law))
    return friction_._replace(**{name: getattr(law, name) for name in EFFECTS})


def _beside(law: Rolling | Operators) -> friction_bristle.Bristle:
    """The bristle beside the stop operators, which follow the same Stribeck curve."""
    if isinstance(law, Rolling) or law.bristle.coulomb == 0.0:
        return friction_bristle.NEUTRAL
    coulomb, length, exponent, damping = law.bristle
    return friction_bristle.Bristle(coulomb, coulomb / length, exponent, damping, law.stribeck)
