"""What a drive's faults mean, in plain words, with the probable causes and the next step."""

from __future__ import annotations

import math
from typing import NamedTuple

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.cia402 import DriveState
from stagectl.drives.drive import DriveError, Fault, Feedback
from stagectl.drives.limits import ENABLE_TIME

MUTE = "its heartbeat was not heard"  # how the problem of a silent drive begins


class Emergency(NamedTuple):
    """An emergency message (EMCY, CiA 301)."""

    code: int  # emergency error code
    register: int  # error register 0x1001
    vendor: bytes  # five bytes of the maker's own


WHAT = {
    Fault.NONE: "no fault",
    Fault.FEEDBACK_LOST: "no answer to SYNC within the time-out",
    Fault.DRIVE_FAULT: "the drive left Operation enabled",
    Fault.EMERGENCY: "the drive sent an emergency",
    Fault.BUS: "the bus failed",
    Fault.REBOOTED: "the drive booted in mid operation",
}
CAUSES = {
    Fault.NONE: "Nothing to be done",
    Fault.FEEDBACK_LOST: (
        "Probable causes: drive without power, cable or termination, another node with the same id, or a bus that is"
        " too busy. Check the wiring, then start the run again"
    ),
    Fault.DRIVE_FAULT: (
        "Probable causes: the drive's own limits, its enable or STO input, or its time-outs (heartbeat, RPDO). Look at"
        " its display, remove the cause, then start the run again: it resets the fault"
    ),
    Fault.EMERGENCY: (
        "Probable causes are in the drive's manual under this code. Remove the cause, then start the run again: it"
        " resets the fault"
    ),
    Fault.REBOOTED: (
        "Probable causes: a dip of its supply, its watchdog, or an NMT reset. Its configuration is gone with it."
        " Check the supply, then start the run again: it configures the drive anew"
    ),
    Fault.BUS: (
        "Probable causes: interface down or bus off. See 'ip -details link', bring it up again,"
        " then start the run again"
    ),
}
_HINTS = {
    DriveState.NOT_READY: (
        "Probable causes: the drive still initialises, or has no logic supply. Wait, then read its display"
    ),
    DriveState.SWITCH_ON_DISABLED: (
        "Probable causes: no DC link voltage, STO open, or the enable input missing. Close STO,"
        " then start the run again"
    ),
    DriveState.READY: "Probable cause: no DC link voltage. Switch the power supply on, then start the run again",
    DriveState.SWITCHED_ON: (
        "Probable causes: the enable input is missing or the brake or encoder is not ready. See the drive's display"
    ),
    DriveState.FAULT: "Probable cause: the cause of the fault is still present. Remove it, then start the run again",
}


def state_words(statusword: int) -> str:
    """State of the drive with its statusword."""
    return f"{cia402.state(statusword).words} (statusword 0x{statusword:04X})"


def emergency_words(emergency: Emergency) -> str:
    """The emergency with the meaning of its code."""
    code, register, vendor = emergency
    meaning = cia402.emergency(code)
    return f"emergency 0x{code:04X} ({meaning}), error register 0x{register:02X}, vendor's bytes {vendor.hex(' ')}"


def not_enabled(node: int, last: Feedback, problem: str, emergency: Emergency | None) -> DriveError:
    """The error of a drive that does not become enabled, with probable causes and the next step."""
    reported = emergency_words(emergency) if emergency else "no emergency was sent"
    parts = filter(None, (state_words(last.statusword), problem, reported))
    hint = _HINTS.get(cia402.state(last.statusword), CAUSES[Fault.DRIVE_FAULT])
    return DriveError(
        f"node {node} does not reach Operation enabled within {ENABLE_TIME:.0f} s: it remains in"
        f" {'; '.join(parts)}. {CAUSES[last.fault] if last.fault is Fault.FEEDBACK_LOST else hint}",
        node=node,
        object_key=cia402.STATUSWORD << 8,
        value=last.statusword,
    )


def explained(node: int, last: Feedback, problem: str, emergency: Emergency | None, heartbeat_age: float) -> str:
    """The fault of the `last` feedback with its probable causes; `heartbeat_age` in s, NaN where none was heard."""
    parts = [problem] if problem.startswith(MUTE) else [WHAT[last.fault], problem]
    parts.append(f"state {state_words(last.statusword)}")
    if emergency is not None:
        parts.append(emergency_words(emergency))
    if not math.isnan(heartbeat_age):
        parts.append(f"last heartbeat of the drive {heartbeat_age:.2f} s ago")
    return f"node {node}: {'; '.join(filter(None, parts))}. {CAUSES[last.fault]}"
