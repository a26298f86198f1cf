"""The difference of two stage models as places and values of a stage file."""

from collections.abc import Iterator
from typing import Any

from stagectl.gap.effects.library import EFFECTS
from stagectl.gap.result.diagnosis import Fields, Setting
from stagectl.kernels import effects
from stagectl.kernels.friction_bristle import Bristle
from stagectl.kernels.stage import Friction, Stage

_OF_LAW = ("operators", "bristle", "stribeck")  # fields of the friction that a file has as entries of its law
_PLACELESS = frozenset(place for effect in EFFECTS.values() if not effect.in_stage_file for place in effect.places)


def fields_of(before: Stage, after: Stage) -> Fields:
    """Every place at which `after` differs from `before`, with the value that it has there.

    A friction whose elements or bristle differ gives its law and all that belongs to it.  Places that a stage file
    does not have are left out.
    """
    fields: list[tuple[str, Setting]] = []
    for block in ("drive", "motor", "mechanics", "encoder"):
        fields += _within(block, getattr(before, block), getattr(after, block))
    rest = {name: getattr(before.friction, name) for name in _OF_LAW}
    fields += [*_law(before.friction, after.friction), *_stribeck(before.friction, after.friction)]
    fields += _within("friction", before.friction, after.friction._replace(**rest))
    if not _same(before.residual, after.residual):
        fields += table_fields(after.residual)
    return tuple((name, value) for name, value in fields if name not in _PLACELESS)


def _within(place: str, old: Any, new: Any) -> Iterator[tuple[str, Setting]]:
    """What differs in the fields of the block at `place`."""
    for name in new._fields:
        yield from _differences(f"{place}.{name}", getattr(old, name), getattr(new, name))


def _differences(place: str, old: Any, new: Any) -> Iterator[tuple[str, Setting]]:
    """The leaves at `place` and below that differ; all leaves of a block that was neutral."""
    if _same(old, new):
        return
    if not hasattr(new, "_fields"):
        yield place, new
    else:
        yield from _leaves(place, new) if _neutral(old) else _within(place, old, new)


def _neutral(block: Any) -> bool:
    return _same(block, type(block)())


def _leaves(place: str, block: Any) -> Iterator[tuple[str, Setting]]:
    """All leaves, without those of neutral blocks within."""
    for name in block._fields:
        value = getattr(block, name)
        if not hasattr(value, "_fields"):
            yield f"{place}.{name}", value
        elif not _neutral(value):
            yield from _leaves(f"{place}.{name}", value)


def _law(old: Friction, new: Friction) -> Iterator[tuple[str, Setting]]:
    """The friction's law with its elements or its bristle, where they differ."""
    if _same(old.operators, new.operators) and _same(old.bristle, new.bristle):
        return
    yield from _bristle(new.bristle) if _is_bristle(new) else _operators(old, new)


def _is_bristle(p: Friction) -> bool:
    """Whether nothing rubs but a bristle."""
    return p.bristle.coulomb > 0.0 and not any(weight > 0.0 for weight in p.operators.weight)


def _stribeck(old: Friction, new: Friction) -> Iterator[tuple[str, Setting]]:
    """The Stribeck curve of the law; Dahl's has none."""
    if _is_bristle(new) and not _damped(new.bristle):
        return
    before, after = (p.bristle.stribeck if _is_bristle(p) else p.stribeck for p in (old, new))
    yield from _differences("friction.stribeck", before, after)


def _damped(p: Bristle) -> bool:
    return p.damping != 0.0 or p.stribeck.rise != 0.0


def _operators(old: Friction, p: Friction) -> Iterator[tuple[str, Setting]]:
    """The elements, and the bristle beside them, if there is or was one."""
    yield "friction.law", "stop-operators"
    yield "friction.weight", tuple(float(value) for value in p.operators.weight)
    yield "friction.slip", tuple(float(value) for value in p.operators.slip)
    if p.bristle.coulomb > 0.0:
        yield "friction.bristle.coulomb", p.bristle.coulomb
        yield "friction.bristle.range", p.bristle.coulomb / p.bristle.stiffness
        yield "friction.bristle.exponent", p.bristle.exponent
        yield "friction.bristle.damping", p.bristle.damping
    elif old.bristle.coulomb > 0.0 and not _is_bristle(old):
        yield "friction.bristle.coulomb", 0.0


def _bristle(p: Bristle) -> Iterator[tuple[str, Setting]]:
    """Dahl's law, or LuGre's where the bristle is damped or follows Stribeck's curve."""
    yield "friction.law", "lugre" if _damped(p) else "dahl"
    yield "friction.coulomb", p.coulomb
    yield "friction.range", p.coulomb / p.stiffness
    yield ("friction.damping", p.damping) if _damped(p) else ("friction.exponent", p.exponent)


def table_fields(p: effects.Table) -> Iterator[tuple[str, Setting]]:
    """The data-based term `p`."""
    yield "residual.coordinate", effects.COORDINATES[p.coordinate]
    yield "residual.start", p.start
    yield "residual.step", p.step
    yield "residual.values", tuple(float(value) for value in p.values)


def _same(a: Any, b: Any) -> bool:
    """Whether two numbers, arrays or blocks hold the same."""
    if hasattr(a, "_fields") and hasattr(b, "_fields"):
        return all(_same(x, y) for x, y in zip(a, b, strict=True))
    if hasattr(a, "__len__") and hasattr(b, "__len__"):
        return len(a) == len(b) and all(float(x) == float(y) for x, y in zip(a, b, strict=True))
    return bool(a == b)
