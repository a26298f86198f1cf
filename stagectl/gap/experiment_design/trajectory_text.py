"""An experiment as the text of a trajectory file: what `run` takes, with comments that say what it is for."""

from __future__ import annotations

import textwrap
from typing import Any, get_type_hints

from stagectl.trajectories import CURRENTS, TYPES, Excited, Experiment, Sequence, Sum
from stagectl.units import Quantity, quantity_of

_NAMES: dict[type, str] = {
    **{kind: name for name, kind in TYPES.items()},
    **{kind: name for name, kind in CURRENTS.items()},
    Excited: "excited",
}
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"))
_LONGEST = 118  # characters of a line


def text_of(experiment: Experiment, comments: tuple[str, ...], unit: str) -> str:
    """YAML of `experiment` below its `comments`; its lengths are in `unit` (m | rad) of travel."""
    header = [f"# {line}" for comment in comments for line in textwrap.wrap(comment, _LONGEST - 2)]
    return "\n".join([*header, *_lines(_entries(experiment, unit))]) + "\n"


def _lines(block: dict[str, Any]) -> list[str]:
    """A block field by field; a block with parts is indented below its name, every other field takes one line."""
    lines = []
    for name, value in block.items():
        if isinstance(value, list) and isinstance(value[0], dict):
            lines += [f"{name}:", *(f"  {line}" for part in value for line in _part(part))]
        elif isinstance(value, dict) and "parts" in value:
            lines += [f"{name}:", *(f"  {line}" for line in _lines(value))]
        else:
            lines.append(f"{name}: {_flow(value)}")
    return lines


def _part(part: dict[str, Any]) -> list[str]:
    if "parts" not in part:
        return [f"- {_flow(part)}"]
    first, *rest = _lines(part)
    return [f"- {first}", *(f"  {line}" for line in rest)]


def _flow(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{name}: {_flow(part)}" for name, part in value.items()) + "}"
    if isinstance(value, list):
        return f"[{', '.join(map(_flow, value))}]"
    return str(value)


def _entries(block: Any, unit: str) -> dict[str, Any]:
    """Type and fields of a block as text; fields at their default are left out.

    Raises KeyError where the block is of a kind that files are not written from.
    """
    if isinstance(block, Sequence | Sum):
        return {"type": _NAMES[type(block)], "parts": [_entries(part, unit) for part in block.parts]}
    hints, defaults = get_type_hints(type(block), include_extras=True), block._field_defaults
    shown = {
        name: _value(value, quantity_of(hints[name]), unit)
        for name, value in block._asdict().items()
        if name not in defaults or value != defaults[name]
    }
    return {"type": _NAMES[type(block)], **shown}


def _value(value: Any, quantity: Quantity | None, unit: str) -> Any:
    if hasattr(value, "_fields"):
        return _entries(value, unit)
    if isinstance(value, tuple):
        return [_value(item, quantity, unit) for item in value]
    if isinstance(value, bool):
        return "true" if value else "false"
    if quantity is None or not quantity.unit:
        return f"{value:.12g}" if isinstance(value, float) else str(value)
    return number(value, _of_travel(quantity.unit, unit))


def _of_travel(unit: str, travel: str) -> str:
    """``m/s`` of an axis whose travel is an angle is ``rad/s``."""
    return travel + unit[1:] if unit.split("/")[0] == "m" else unit


def number(value: float, unit: str) -> str:
    """`value` with its `unit`, and the prefix that a person would take for a length: ``12.3 mm/s``."""
    prefixes = _PREFIXES if unit.split("/")[0] == "m" else _PREFIXES[:1]
    scale, prefix = next(((scale, prefix) for scale, prefix in prefixes if abs(value) >= 0.9995 * scale), _PREFIXES[0])
    return f"{value / scale:.12g} {prefix}{unit}"
