"""Units: by the words around a column, by its magnitude, and by what makes two columns agree."""

import math
import re
from typing import NamedTuple

import numpy as np

from stagectl.number_format import duration
from stagectl.recording import constants
from stagectl.recording.columns import Array
from stagectl.recording.repair import smallest_step
from stagectl.recording.scales import Known, Scales, bases_of
from stagectl.units import LINEAR, ROTARY, factor

_WORDS = {
    "time": ("s", "ms", "us"),
    "position": ("rad", "deg", "rev", "counts", "m", "mm", "um"),
    "velocity": ("rad/s", "deg/s", "rpm", "r/min", "m/s", "mm/s"),
    "effort": ("A", "mA", "Nm", "mNm", "N", "V", "%", "permille", "‰"),
}
_BASES: dict[str, tuple[dict[str, int], ...]] = {
    "time": ({"s": 1},),
    "position": ({"m": 1}, {"rad": 1}, {"counts": 1}),
    "velocity": ({"m": 1, "s": -1}, {"rad": 1, "s": -1}, {"counts": 1, "s": -1}),
}
CURRENT = r"curr|amp|(?<![a-z])i_?q(?![a-z])|^i(?![a-z])"  # words of one that makes force
_ROTARY = re.compile(r"angle|angular|theta|rot(?:or|ation)|joint")


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
    if bases_of(unit := bracketed(words)) in _BASES.get(kind, ()):
        return Unit(unit, constants.SURE_BY_NAME, f"its header says {unit}")
    return None


def bracketed(words: str) -> str:
    """What the words around a column have in brackets, where a unit belongs; empty where nothing."""
    within = re.search(r"[\[(]\s*([^\])]+?)\s*[\])]", words)
    return within[1] if within else ""


def known(quantity: str) -> tuple[str, ...]:
    """The units that a guess knows of a position, a reference or a velocity."""
    return _WORDS["velocity" if quantity == "velocity" else "position"]


def of_time(words: str, time: Array) -> Unit:
    """The unit with which the rows come at 100 Hz to 10 kHz, or else at least often enough to show a motion."""
    if unit := said(words, "time"):
        return unit
    step = float(np.median(np.diff(time))) or float(np.ptp(time)) / len(time)
    low, high = constants.USUAL_STEPS
    for longest, sure in ((high, constants.SURE_BY_PHYSICS), (constants.RARE_ROWS, constants.SURE_BY_MAGNITUDE)):
        if fit := [name for name in (*_WORDS["time"], "ns") if low <= step * factor(name, "s") <= longest]:
            return Unit(fit[0], sure, f"rows come every {duration(step * factor(fit[0], 's'))}")
    return Unit("s", constants.SURE_BY_DEFAULT, f"no header names its unit, and rows come every {step:.4g}")


def of_position(words: str, position: Array, ratio: float, speed_unit: str, known: Known) -> Unit:
    """By its words, its velocity (`ratio` is d position/dt over it; 0: there is none) or its stage; else a proposal."""
    shown = said(words, "position") or _by_speed(ratio, speed_unit) or _by_stage(position, known)
    rotary = _ROTARY.search(words) is not None or abs(abs(ratio) - 1.0) < constants.SAME_UNIT
    return shown or _proposed(float(np.ptp(position)), rotary, known)


def _by_speed(ratio: float, speed_unit: str) -> Unit | None:
    """The unit of which the velocity beside it is the derivative; without a unit of its own that shows none."""
    for axis in (Scales(ROTARY, travel_unit="rad"), Scales(LINEAR)):
        names = axis.units("position") if ratio and speed_unit in axis.units("velocity") else ()
        for name in names:
            if abs(abs(ratio) * axis.position(name) / axis.speed(speed_unit) - 1.0) < constants.SAME_UNIT:
                return Unit(
                    name, constants.SURE_BY_PHYSICS, f"its derivative is {ratio:.4g} times the {speed_unit} beside it"
                )
    return None


def _by_stage(position: Array, known: Known) -> Unit | None:
    """The unit in which it comes in steps of the stage's encoder, within its travel; else the only one that fits."""
    if known.axis is None:
        return None
    width, step = float(np.ptp(position)), smallest_step(position) / known.axis.encoder_step
    sizes = {name: known.axis.position(name) for name in known.axis.units("position")}
    sizes = {name: size for name, size in sizes.items() if width * size <= known.travel}
    if by_step := [name for name, size in sizes.items() if abs(step * size - 1.0) < constants.SAME_UNIT]:
        return Unit(by_step[0], constants.SURE_BY_PHYSICS, "it comes in the steps of the stage's encoder")
    if len(fit := [name for name, size in sizes.items() if width * size > constants.LEAST_TRAVEL * known.travel]) == 1:
        return Unit(fit[0], constants.SURE_BY_MAGNITUDE, "it fits the stage's travel in no other unit")
    return None


def _proposed(travel: float, rotary: bool, known: Known) -> Unit:
    """What is likely where nothing shows a unit, and must be asked for."""
    counts = travel > constants.MANY_RADIANS and not rotary
    if counts and known.counts:
        return Unit("counts", constants.SURE_BY_NAME, f"it travels {travel:.4g}")
    short = "rad" if rotary or travel > constants.LONG_TRAVEL else "m"
    name = known.axis.units("position")[0] if known.axis else "counts" if counts else short
    return Unit(name, constants.SURE_BY_DEFAULT, f"no header names its unit, and it travels {travel:.4g}")


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
    if re.search(CURRENT, words):  # before the torque: one is called torque current
        return Unit("A", constants.SURE_BY_MAGNITUDE, "its header says current")
    if re.search(r"torque|moment|tau|nm", words):
        return Unit("Nm", constants.SURE_BY_DEFAULT, "its header says torque and no unit")
    return Unit("A", constants.SURE_BY_DEFAULT, "no header says it")


def same_by_name(first: str, second: str) -> bool:
    """Whether the words around two efforts say that they are in one unit."""
    one, other = of_effort(first), of_effort(second)
    return one.name == other.name and min(one.sure, other.sure) > constants.SURE_BY_DEFAULT


def counts_by_speed(position: Array, time: Array) -> float:
    """Counts a turn, a power of two, for which the motion has the speed that motors are logged at."""
    fastest = float(np.quantile(np.abs(np.gradient(position, time)), constants.USUAL))
    low, high = constants.USUAL_COUNTS
    return 2.0 ** min(max(round(math.log2(max(fastest, 1.0) / constants.USUAL_SPEED)), low), high)
