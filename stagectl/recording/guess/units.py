"""Units: by the words around a column, by its magnitude, and by what makes two columns agree."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

import numpy as np

from stagectl.recording import constants
from stagectl.recording.columns import Array
from stagectl.recording.scales import is_unit
from stagectl.units import factor

_WORDS = {
    "time": ("s", "ms", "us"),
    "position": ("rad", "deg", "rev", "counts", "m", "mm", "um"),
    "velocity": ("rad/s", "deg/s", "rpm", "r/min", "m/s", "mm/s"),
    "effort": ("A", "mA", "Nm", "mNm", "N", "V", "%", "permille", "‰"),
}


class Unit(NamedTuple):
    """A unit, and how sure it is."""

    name: str
    sure: float  # 0 to 1
    why: str


def said(words: str, kind: str) -> Unit | None:
    """The unit that the words around a column name."""
    tidy = re.sub(r"n[ .*·]m\b", "nm", words)
    for name in sorted(_WORDS[kind], key=len, reverse=True):
        if re.search(rf"(?:^|[\s_\[(]){re.escape(name.lower())}(?:$|[\s\])])", tidy):
            return Unit("rpm" if name == "r/min" else name, constants.SURE_BY_NAME, f"its header says {name}")
    return None


def stranger(words: str) -> str:
    """What the words around a column have in brackets, where a unit belongs; empty where that is a known one."""
    within = re.search(r"[\[(]\s*([^\])]+?)\s*[\])]", words)
    return within[1] if within and not is_unit(within[1]) else ""


def known(quantity: str) -> tuple[str, ...]:
    """The units that a guess knows of a position, a reference or a velocity."""
    return _WORDS["velocity" if quantity == "velocity" else "position"]


def of_time(words: str, time: Array) -> Unit:
    """The unit with which the rows come at 100 Hz to 10 kHz."""
    if unit := said(words, "time"):
        return unit
    step = float(np.median(np.diff(time))) or float(np.ptp(time)) / len(time)
    low, high = constants.USUAL_STEPS
    fit = [name for name in (*_WORDS["time"], "ns") if low <= step * factor(name, "s") <= high]
    name = fit[0] if fit else "s"
    sure = constants.SURE_BY_PHYSICS if fit else constants.SURE_BY_MAGNITUDE
    return Unit(name, sure, f"rows come every {step * factor(name, 's') * 1e3:.4g} ms")


def of_position(words: str, position: Array, ratio: float, speed_unit: str) -> Unit:
    """By its words, else by its velocity (`ratio` is d position/dt over it; 0: there is none), else by magnitude."""
    if unit := said(words, "position"):
        return unit
    if speed_unit == "rpm" and (unit := _with_revolutions(ratio)):
        return unit
    if ratio and abs(abs(ratio) - 1.0) < constants.SAME_UNIT:
        why = f"its derivative is {ratio:.4g} times the velocity column"
        return Unit("rad", constants.SURE_BY_PHYSICS, why)
    travel = float(np.ptp(position))
    if travel > constants.MANY_RADIANS:
        return Unit("counts", constants.SURE_BY_MAGNITUDE, f"it travels {travel:.4g}")
    name, why = ("rad", "more") if travel > constants.LONG_TRAVEL else ("m", "no more")
    why = f"no header names a unit, and it travels {travel:.4g}, {why} than {constants.LONG_TRAVEL:g}"
    return Unit(name, constants.SURE_BY_DEFAULT, why)


def _with_revolutions(ratio: float) -> Unit | None:
    for name, wanted in (("rad", math.pi / 30.0), ("deg", 6.0), ("rev", 1.0 / 60.0)):
        if abs(abs(ratio) / wanted - 1.0) < constants.SAME_UNIT:
            return Unit(name, constants.SURE_BY_PHYSICS, f"its derivative is {ratio:.4g} times the rev/min beside it")
    return None


def of_velocity(words: str, velocity: Array) -> Unit:
    """By its words, else by its magnitude."""
    if unit := said(words, "velocity"):
        return unit
    fastest = float(np.abs(velocity).max())
    name = "rpm" if fastest > constants.FAST_IN_RADIANS else "rad/s"
    return Unit(name, constants.SURE_BY_DEFAULT, f"no header says it, and it is up to {fastest:.4g}")


def of_effort(words: str) -> Unit:
    """By its words; amperes where nothing is said."""
    if unit := said(words, "effort"):
        return unit
    if re.search(r"torque|moment|tau|nm", words):
        return Unit("Nm", constants.SURE_BY_DEFAULT, "its header says torque and no unit")
    if re.search(r"curr|amp|\biq?\b", words):
        return Unit("A", constants.SURE_BY_MAGNITUDE, "its header says current")
    return Unit("A", constants.SURE_BY_DEFAULT, "no header says it")


def counts_by_speed(position: Array, time: Array) -> float:
    """Counts a turn, a power of two, for which the motion has the speed that motors are logged at."""
    fastest = float(np.quantile(np.abs(np.gradient(position, time)), constants.USUAL))
    low, high = constants.USUAL_COUNTS
    return 2.0 ** min(max(round(math.log2(max(fastest, 1.0) / constants.USUAL_SPEED)), low), high)
