"""How the axis stops: one row a fault, with its stop category, its words and the next command.

Categories as in IEC 60204-1, which names what happens to the power; none of them is a safety function here.
"""

import enum
from typing import NamedTuple

from stagectl.drives.drive import Fault


class Category(enum.IntEnum):
    """Stop categories of IEC 60204-1."""

    COAST = 0
    RAMP = 1
    HOLD = 2

    @property
    def words(self) -> str:
        """The category in a sentence."""
        return _CATEGORIES[self]


_CATEGORIES = {
    Category.COAST: "category 0: power is cut at once, friction stops the axis",
    Category.RAMP: "category 1: the drive brakes on its own ramp, then power is cut",
    Category.HOLD: "category 2: the controller brakes, then holds the position under power",
}


class Stop(NamedTuple):
    """How the axis stops after a fault."""

    category: Category
    words: str  # what happened
    causes: str  # probable ones; empty where the drive explains itself
    next: str  # the command that resumes


_RESET = "`stagectl fault reset`, then `stagectl enable`"
_LOOK = "the black box shows the ten seconds before; then `stagectl fault reset` and `stagectl enable`"
STOPS: dict[Fault, Stop] = {
    Fault.FEEDBACK_LOST: Stop(Category.RAMP, "the drive fell silent", "", _RESET),
    Fault.DRIVE_FAULT: Stop(Category.RAMP, "the drive left Operation enabled", "", _RESET),
    Fault.EMERGENCY: Stop(Category.RAMP, "the drive sent an emergency message", "", _RESET),
    Fault.BUS: Stop(Category.RAMP, "the bus failed", "", _RESET),
    Fault.REBOOTED: Stop(Category.RAMP, "the drive restarted during operation", "", _RESET),
    Fault.FOLLOWING_ERROR: Stop(
        Category.RAMP, "the following error exceeds limits.following_error",
        "Probable causes: a load or friction that the model does not contain, wrong gains, an obstacle", _LOOK),
    Fault.TRAVEL: Stop(
        Category.RAMP, "the position left limits.travel",
        "Probable causes: a trajectory from the wrong start, a wrong home position",
        "move the axis back by hand, or widen limits.travel; then " + _RESET),
    Fault.SPEED: Stop(Category.RAMP, "the speed exceeds limits.speed", "Probable cause: an unstable loop", _LOOK),
    Fault.LATE: Stop(
        Category.RAMP, "too many late cycles in a row (realtime.late_limit)",
        "Probable causes: no real-time scheduling, a busy machine", "`stagectl doctor`; then " + _RESET),
    Fault.OPERATOR: Stop(Category.HOLD, "stopped by the operator", "", "the next command"),
    Fault.BRAKING: Stop(
        Category.RAMP, "the axis can no longer stop within limits.travel",
        "Probable causes: a runaway, a trajectory from the wrong start, or one too fast for limits.deceleration and the"
        " drive's ramp", _LOOK),
    Fault.CURRENT: Stop(
        Category.RAMP, "the measured current exceeds limits.current",
        "Probable causes: the drive's current loop, a short circuit, a wrong current_scale", _LOOK),
    Fault.CLAMPED: Stop(
        Category.RAMP, "the drive gives another current than it is told",
        "Probable causes: a limit in the drive's own set-up (0x6072, 0x6073), its I2t or temperature limit, too little"
        " voltage, a wrong current_scale, a motor cable that is off, commands that do not reach the drive", _LOOK),
    Fault.OVERLOAD: Stop(
        Category.RAMP, "the motor's I2t exceeds limits.continuous_current",
        "Probable causes: a jam, a closed brake, too high a duty cycle",
        "let it cool down for limits.thermal_time; then " + _RESET),
    Fault.JUMP: Stop(
        Category.COAST, "the encoder jumped: no force could move the axis so far in a period",
        "Probable causes: encoder cable, its supply, dirt, a slipped coupling; the position is not to be trusted",
        "check the encoder, then `stagectl fault reset`, `stagectl enable`, `stagectl home`"),
    Fault.FREEZE: Stop(
        Category.COAST, "the position does not change although the axis must be moving",
        "Probable causes: the encoder froze, the coupling broke, or the axis is blocked",
        "check the encoder and the axis, then `stagectl fault reset`, `stagectl enable`, `stagectl home`"),
    Fault.STARVED: Stop(
        Category.HOLD, "the setpoints ran out in mid motion", "Probable cause: the service was blocked",
        "the next command"),
    Fault.UNATTENDED: Stop(
        Category.RAMP, "the service that gives the orders is gone", "", "`systemctl status stagectl`"),
    Fault.HOMING: Stop(
        Category.RAMP, "no home was found within homing.distance",
        "Probable causes: a wrong direction, an unconnected switch or index", _RESET),
    Fault.PARTNER: Stop(Category.RAMP, "another axis of the group has stopped by a fault", "", _RESET),
}  # fmt: skip


_UNPOWERED = {
    Fault.DRIVE_FAULT: "the drive is not ready; the axis had no power",  # in Fault, or it takes none: it says why
    Fault.FOLLOWING_ERROR: "the axis left its place as its brake was released, and its power was cut; the current that"
    " carries it is brake.holding_current, or that of the model's load there (without a home: of mechanics.bias)",
}


def without_power(fault: Fault, coming: bool = False) -> str:
    """A fault of an axis that had no power, in words: nothing was stopped; where power was `coming` it may be there."""
    power = "may have power, which only its drive can cut" if coming and fault is Fault.BUS else "had no power"
    return _UNPOWERED.get(fault, f"{STOPS[fault].words}; the axis {power}")
