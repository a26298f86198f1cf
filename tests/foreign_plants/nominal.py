"""The nominal axis: what the stage file says, read as plain YAML."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import yaml

STAGE_FILE = Path(__file__).parents[2] / "config" / "ball-screw.yaml"
_SCALES = {"mm": 1e-3, "mm/s": 1e-3, "um": 1e-6, "ms": 1e-3}


class Nominal(NamedTuple):
    """What the machines are drawn around, SI at the motor."""

    inertia: float  # kg m^2
    viscous: float  # N m s/rad
    coulomb: float  # N m
    force_constant: float  # N m/A
    rated_current: float  # A
    current_limit: float  # A
    speed: float  # rad/s, limit
    travel: float  # rad, to either side
    rolling_zone: float  # rad, in which the friction builds up after a reversal


def _number(entry: Any) -> float:
    """The value of an entry such as ``12 mm``, in SI."""
    value, _, unit = str(entry).partition(" ")
    return float(value) * _SCALES.get(unit, 1.0)


def nominal() -> Nominal:
    """The ball screw of the shipped stage file."""
    stage = yaml.safe_load(STAGE_FILE.read_text(encoding="utf-8"))
    angle = 2.0 * math.pi / _number(stage["axis"]["lead"])
    return Nominal(
        _number(stage["mechanics"]["inertia"]),
        _number(stage["mechanics"]["viscous"]),
        _number(stage["friction"]["coulomb"]),
        _number(stage["motor"]["force_constant"]),
        _number(stage["drive"]["wire"]["rated_current"]),
        _number(stage["drive"]["current_limit"]),
        angle * _number(stage["limits"]["speed"]),
        angle * _number(stage["limits"]["travel"][1]),
        angle * _number(stage["friction"]["longest"]),
    )
