"""The status of an axis as JSON values: for the control interface, the live page and the stop path alike."""

import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from stagectl.drives.canopen.cia402 import LIMITED
from stagectl.drives.drive import Fault
from stagectl.realtime.shared_memory import Board, Status
from stagectl.realtime.states import State
from stagectl.service.limits import NO_ANSWER
from stagectl.typed_json import finite

SILENT = "no_answer"  # in place of a state: the loop does not say how the axis is
_LIMIT_ACTIVE = "the drive reports an internal limit (statusword bit 11): of current, speed or position, or a switch"
_LENGTHS = ("position", "speed", "reference", "error", "stop_distance")


class Shown(NamedTuple):
    """What must be known of an axis to show its status."""

    name: str
    scale: float  # travel (m | rad) per axis unit
    unit: str  # of travel
    unborn: str  # words for its state until the real-time process reports one
    warnings: Sequence[str] = ()  # that do not come from its drive


def _answers(status: Status, now: float) -> bool:
    """Whether the loop of this axis gives signs of life, or has not begun; to configure a drive takes longer."""
    patience = max(status.patience, NO_ANSWER) if int(status.state) == State.CONNECTING else NO_ANSWER
    return not status.tick or now - status.tick < patience


def _axis_json(shown: Shown, board: Board, now: float, silent: bool) -> dict[str, Any]:
    """The axis now; lengths in the unit of travel, None where no drive or no loop (`silent`) has said them."""
    status = board.status()
    state, fault = State(int(status.state)), Fault(int(status.fault))
    unheard = silent or not status.tick or state in (State.CONNECTING, State.OFFLINE)
    lengths = {name: None if unheard else finite(getattr(status, name) * shown.scale) for name in _LENGTHS}
    return {
        "axis": shown.name,
        "state": SILENT if silent else state.name.lower(),
        "state_words": _words(shown, status, now, silent),
        "fault": fault.name.lower() if fault else "",
        "words": board.words if fault or state is State.OFFLINE else "",
        "unit": shown.unit,
        **lengths,
        "current": None if unheard else finite(status.current),
        "statusword": int(status.statusword),
        "warnings": [*([_LIMIT_ACTIVE] if int(status.statusword) & LIMITED and not silent else []), *shown.warnings],
        "homed": bool(status.homed),
        "in_position": status.settled > 0.0 and not silent,
        "progress": status.row / status.rows if status.rows and not silent else None,
        "cycles": int(status.cycles),
        "late_cycles": int(status.late),
        "faults": int(status.faults),
        "stop_time": status.stop_time,
    }


def machine_json(axes: Sequence[tuple[Shown, Board]], refused: list[str]) -> dict[str, Any]:
    """The machine now, as JSON values, with what the kernel `refused` its loop."""
    now = time.monotonic()
    silent = not any(_answers(board.status(), now) for _, board in axes)
    return {"axes": [_axis_json(*axis, now, silent) for axis in axes], "alive": not silent, "refused": refused}


def noted(notes: Mapping[str, str] | None, machine: dict[str, Any]) -> dict[str, Any]:
    """The status of a machine with a warning more for each axis that has a note."""
    for axis in machine["axes"]:
        axis["warnings"] += [note for name, note in (notes or {}).items() if name == axis["axis"]]
    return machine


def _words(shown: Shown, status: Status, now: float, silent: bool) -> str:
    if not status.tick:
        return shown.unborn
    words = State(int(status.state)).words
    return f"no answer from the loop for {now - status.tick:.1f} s; before that: {words}" if silent else words
