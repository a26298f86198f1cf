"""What of a stage's model a format cannot hold, entry by entry."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from typing import Any, get_type_hints

from stagectl.config.stage_file import Setup
from stagectl.units import quantity_of

RESIDUAL = "residual"  # the block of a residual table
_NEUTRAL = {"current_quantum": 0.0, "current_lag": 0.0, "delay_samples": 0, "step": 0.0}  # of entries without a default


def lost(setup: Setup, held: Mapping[str, Set[str]]) -> list[str]:
    """Entries that are not neutral and not in `held`, by block: value, unit and meaning."""
    blocks = [block for block in held if block != RESIDUAL]
    words = [each for block in blocks for each in _lost(setup, block, held[block])]
    return words if RESIDUAL in held else words + _residual(setup)


def random_numbers(setup: Setup) -> list[str]:
    """Entries whose random numbers are drawn outside of the model."""
    p = setup.file.simulation
    drawn = {"drive.jitter": setup.stage.drive.jitter, "simulation.current_noise": p.current_noise}
    drawn |= {"simulation.encoder_noise": p.encoder_noise}
    return [f"{name} = {value:.4g}: it draws random numbers" for name, value in drawn.items() if value]


def _lost(setup: Setup, block: str, held: Set[str]) -> Iterator[str]:
    part = getattr(setup.stage, block)
    hints = get_type_hints(type(part), include_extras=True)
    for name, value in part._asdict().items():
        neutral = part._field_defaults.get(name, _NEUTRAL.get(name))
        if name not in held and value != neutral:
            yield f"{block}.{name} = {_shown(value)} {_meaning(hints[name], setup.file.axis.kind)}"


def _meaning(hint: Any, kind: str) -> str:
    quantity = quantity_of(hint)
    return f"{quantity.unit_for(kind)}: {quantity.meaning}".lstrip() if quantity else ""


def _shown(value: Any) -> str:
    if hasattr(value, "_asdict"):
        return ", ".join(f"{name} {_shown(part)}" for name, part in value._asdict().items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _residual(setup: Setup) -> list[str]:
    if setup.file.residual is None:
        return []
    return [f"residual: a table of {len(setup.file.residual.values)} values over {setup.file.residual.coordinate}"]
