"""What an identification found: values with their intervals, and what is to be known about them."""

from typing import Any

from stagectl.report.page import Table


def parameters(result: dict[str, Any]) -> Table:
    """Values with their intervals."""
    rows = [
        [
            f"{name.replace('_', ' ')} [{parameter['unit']}]".replace(" []", ""),
            "not known" if parameter["value"] is None else f"{parameter['value']:.6g}",
            _interval(parameter),
        ]
        for name, parameter in result["parameters"].items()
    ]
    return Table("Parameters", ["parameter", "value", "95 % interval"], rows)


def _interval(parameter: dict[str, Any]) -> str:
    if parameter["low"] is None or parameter["high"] is None:
        return "not known"
    return f"{parameter['low']:.5g} to {parameter['high']:.5g}"


def remarks(result: dict[str, Any]) -> list[str]:
    """A line for each capture and what it was taken from, then what is to be known about the parameters."""
    lines = []
    for capture in result["captures"]:
        every = f"{1e3 * capture['dt']:.4g} ms"
        lines.append(f"{capture['name']}: {capture['rows']} rows every {every}, taken from {capture['current']}")
        lines += [f"  {note}" for note in capture["notes"]]
    if result.get("force_residual_percent") is not None:
        lines.append(f"force residual {result['force_residual_percent']:.3g} % of the force")
    return [*lines, *(f"{name}: held out, not used" for name in result["held_out"]), *result["notes"]]
