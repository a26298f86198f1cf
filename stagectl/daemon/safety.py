"""When the loop stops by itself.  Nothing raises inside the cycle: a cycle returns a status, and this decides.

This is not a safety function: the emergency stop is wired to the drive's STO.
"""

from __future__ import annotations

from typing import NamedTuple

from stagectl.drives.drive import Fault


class Envelope(NamedTuple):
    """What the loop accepts, in axis units."""

    low: float  # rad | m
    high: float
    speed: float  # rad/s | m/s
    following_error: float  # rad | m
    late_limit: int  # late cycles in a row


_WORDS = {
    Fault.NONE: "",
    Fault.FEEDBACK_LOST: "the drive did not answer SYNC in time",
    Fault.DRIVE_FAULT: "the drive left Operation enabled",
    Fault.EMERGENCY: "the drive sent an emergency message",
    Fault.BUS: "the bus failed",
    Fault.FOLLOWING_ERROR: "the following error exceeds limits.following_error",
    Fault.TRAVEL: "the position left limits.travel",
    Fault.SPEED: "the speed exceeds limits.speed",
    Fault.LATE: "too many late cycles in a row (realtime.late_limit)",
    Fault.OPERATOR: "stopped by the operator",
}


def words(fault: Fault) -> str:
    """The reason as a person says it."""
    return _WORDS[fault]


def judge(p: Envelope, fault: Fault, position: float, speed: float, error: float) -> Fault:
    """The drive's own fault first, then the envelope."""
    if fault is not Fault.NONE:
        return fault
    if not -p.following_error <= error <= p.following_error:  # NaN fails too
        return Fault.FOLLOWING_ERROR
    if not p.low <= position <= p.high:
        return Fault.TRAVEL
    if not -p.speed <= speed <= p.speed:
        return Fault.SPEED
    return Fault.NONE
