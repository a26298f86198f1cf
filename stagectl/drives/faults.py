"""The one table of faults: what can be made to fail, how, and what drive and loop must do about it.

YAML (``virtual_drive: faults:``), ``stagectl inject``, ``stagectl selftest`` and the manual all read `TABLE`.
The kinds are those of PX4's failure injection: off, stuck, garbage, wrong, slow, delayed, intermittent.

Stop categories are those of IEC 60204-1: 0 power removed at once, the axis coasts; 1 braked, then power removed;
2 braked, power stays.  `None`: the motion goes on.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, NamedTuple

from stagectl.drives.drive import Fault
from stagectl.units import Quantity

Name = Annotated[str, "name of the fault, see `stagectl inject --list`"]
After = Annotated[float, Quantity("s", "[0, 1e6]", "from Operation enabled (YAML) or from the command (inject) on")]
Lasting = Annotated[float, Quantity("s", "[0, 1e6]", "how long it lasts; 0 s: until it is cleared")]
Share = Annotated[float, Quantity("", "(0, 1]", "share of the frames that it hits")]
Delay = Annotated[float, Quantity("s", "(0, 1]", "how much later")]
Code = Annotated[int, Quantity("", "[256, 65535]", "emergency error code (CiA 301, CiA 402)")]
Factor = Annotated[float, Quantity("", "[-100, 100]", "actual value for one unit of the true value")]


class Plain(NamedTuple):
    """A fault without parameters."""

    fault: Name
    after: After = 0.0
    duration: Lasting = 0.0


class Frames(NamedTuple):
    """A fault of some of the frames."""

    fault: Name
    share: Share = 1.0
    after: After = 0.0
    duration: Lasting = 0.0


class Some(NamedTuple):
    """A fault that hits frames by chance."""

    fault: Name
    share: Share = 0.05
    after: After = 0.0
    duration: Lasting = 0.0


class Late(NamedTuple):
    """Something that comes later than it should."""

    fault: Name
    delay: Delay = 0.01
    after: After = 0.0
    duration: Lasting = 0.0


class Jump(NamedTuple):
    """A position that jumps."""

    fault: Name
    counts: Annotated[int, Quantity("", "[-1e9, 1e9]", "encoder counts of one jump")] = 100_000
    every: Annotated[float, Quantity("s", "[0, 1e3]", "time between two jumps; 0 s: one only")] = 0.0
    after: After = 0.0
    duration: Lasting = 0.0


class Wrong(NamedTuple):
    """A value with a wrong factor."""

    fault: Name
    factor: Factor = -1.0
    after: After = 0.0
    duration: Lasting = 0.0


class Weak(NamedTuple):
    """A current that is too small."""

    fault: Name
    factor: Factor = 0.3
    after: After = 0.0
    duration: Lasting = 0.0


class Emergency(NamedTuple):
    """Emergency messages."""

    fault: Name
    code: Code = 0x4310
    every: Annotated[float, Quantity("s", "[0, 1e3]", "time between two messages; 0 s: one only")] = 0.0
    after: After = 0.0
    duration: Lasting = 0.0


class Tripped(NamedTuple):
    """A fault that the drive finds itself."""

    fault: Name
    code: Code = 0x2310
    after: After = 0.0
    duration: Lasting = 0.0


class Off(NamedTuple):
    """Something that is gone and comes back by itself."""

    fault: Name
    after: After = 0.0
    duration: Lasting = 0.3


class Skew(NamedTuple):
    """A clock that runs at another rate."""

    fault: Name
    rate: Annotated[float, Quantity("", "[0.5, 2]", "seconds of the drive's clock in one second")] = 1.001
    after: After = 0.0
    duration: Lasting = 0.0


class Must(NamedTuple):
    """What has to happen to an axis that moves, and to one that holds its place."""

    category: Literal[0, 1, 2] | None  # stop category; None: the motion goes on
    noticed: tuple[str, ...] = ("cycle",)  # what bounds the time to the reaction: see `selftest.limits`
    holding: Literal["stop", "go on", "either"] = "stop"  # an axis that stands need not notice all
    brakes: Literal["ramp", "coast"] = "ramp"  # coast: what the drive brakes with is what failed
    reasons: tuple[Fault, ...] = ()  # what the loop may name as its reason; empty: any


class Row(NamedTuple):
    """One fault."""

    name: str
    component: Literal["bus", "encoder", "drive", "node", "clock", "controller"]
    kind: Literal["off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent"]
    block: Any  # NamedTuple of its parameters
    words: str
    must: Must


_LOST, _DRIVE, _EMCY = Fault.FEEDBACK_LOST, Fault.DRIVE_FAULT, Fault.EMERGENCY
_ERROR = Fault.FOLLOWING_ERROR
_SILENT = Must(1, ("feedback",), reasons=(_LOST,))
_SEEN = Must(1, ("error",), "either", "coast")
_GOES_ON = Must(None, (), "go on")
_JUMPS = Must(0, brakes="coast", reasons=(Fault.JUMP,))  # an encoder that lies must not be braked by: `realtime.stops`

# Where a row admits that the axis coasts although its category is 1, the drive cannot brake: its own ramp is closed
# over the encoder or the current that has failed, or a bent controlword has taken its power away before anybody asked.
# Three more are no faults by design: a current of 30 % is made up for by the feedback, whose gain margin it stays in; a
# current that is stuck at what the motion needs is right until the motion changes, and found out as `unbraked` then; a
# twentieth of the frames is doubled, as all of them would take 130 % of the bus at 2 kHz.  How long an axis may hold
# its place in a loop that is late is for the stage file to say, by `late_limit`; what moves is stopped by its error.
TABLE: tuple[Row, ...] = (
    Row("cable-out", "bus", "off", Frames, "no frame passes, either way",
        Must(1, ("supervision",), reasons=(_LOST,))),
    Row("frames-lost", "bus", "intermittent", Some, "frames are lost by chance", Must(1, ("chance", "feedback"))),
    Row("sync-lost", "bus", "off", Frames, "SYNC does not reach the drive",
        Must(1, ("feedback",), reasons=(_LOST,))),
    Row("command-lost", "bus", "off", Frames, "the cyclic command (RPDO) does not reach the drive",
        Must(1, ("command",), reasons=(_DRIVE, _EMCY, Fault.FOLLOWING_ERROR))),
    Row("feedback-lost", "bus", "off", Frames, "the drive's cyclic answer (TPDO) is lost", _SILENT),
    Row("controller-heartbeat-lost", "bus", "off", Frames, "the controller's heartbeat does not reach the drive",
        Must(1, ("heartbeat",), reasons=(_DRIVE, _EMCY))),
    Row("drive-heartbeat-lost", "bus", "off", Frames, "the drive's heartbeat is lost while its answers go on",
        Must(1, ("heartbeat",), reasons=(_LOST,))),
    Row("frames-duplicated", "bus", "wrong", Some, "some frames arrive twice", _GOES_ON),
    Row("frames-reordered", "bus", "wrong", Some, "neighbouring frames change places", Must(1, ("chance", "feedback"))),
    Row("command-corrupted", "bus", "garbage", Some, "bits of the command (RPDO) are flipped",
        Must(1, ("chance", "feedback"), "either", "coast", (_DRIVE, _EMCY, _ERROR, Fault.SPEED, Fault.JUMP))),
    Row("feedback-corrupted", "bus", "garbage", Some, "bits of the drive's answer (TPDO) are flipped",
        Must(1, ("chance",), brakes="coast", reasons=(Fault.JUMP, _DRIVE, _ERROR, Fault.SPEED))),
    Row("frames-delayed", "bus", "delayed", Late, "all frames arrive late",
        Must(1, ("error", "delay"), "either", "coast", (_ERROR, Fault.JUMP, Fault.LATE, _EMCY, _DRIVE, _LOST))),
    Row("bus-flooded", "bus", "garbage", Frames, "another node sends frames between the drive's", _GOES_ON),
    Row("bus-off", "bus", "off", Off, "the drive's CAN controller goes bus-off and recovers (EMCY 0x8140)",
        Must(1, ("supervision",), reasons=(_LOST,))),
    Row("encoder-off", "encoder", "off", Plain, "the drive notices that its encoder is gone (EMCY 0x7305)",
        Must(1, brakes="coast", reasons=(_DRIVE, _EMCY))),
    Row("encoder-stuck", "encoder", "stuck", Plain, "the position freezes, no error is reported", _SEEN),
    Row("encoder-jump", "encoder", "wrong", Jump, "the position jumps", _JUMPS),
    Row("encoder-jumping", "encoder", "intermittent", Jump, "the position jumps back and forth", _JUMPS),
    Row("encoder-garbage", "encoder", "garbage", Plain, "the position is noise over the whole range", _JUMPS),
    Row("encoder-reversed", "encoder", "wrong", Wrong, "the position has the wrong sign", _SEEN),
    Row("encoder-late", "encoder", "delayed", Late, "the position is late",
        Must(1, ("error",), "either", "coast", (_ERROR, Fault.SPEED, Fault.JUMP, Fault.FREEZE, _DRIVE))),
    Row("drive-fault", "drive", "off", Tripped, "the drive trips: EMCY, fault reaction, Fault",
        Must(1, reasons=(_DRIVE, _EMCY))),
    Row("emergency", "drive", "wrong", Emergency, "the drive sends an EMCY and continues", Must(1, reasons=(_EMCY,))),
    Row("emergency-storm", "drive", "garbage", Emergency, "the drive sends EMCYs continuously",
        Must(1, reasons=(_EMCY,))),
    Row("drive-disabled", "drive", "off", Plain, "STO: the drive removes the power",
        Must(0, brakes="coast", reasons=(_DRIVE,))),
    Row("power-off", "drive", "off", Off, "the supply fails; when it returns, the drive boots",
        Must(0, ("feedback",), brakes="coast", reasons=(_LOST, Fault.REBOOTED))),
    Row("current-off", "drive", "off", Plain, "no current flows (motor cable), no error is reported", _SEEN),
    Row("current-stuck", "drive", "stuck", Plain, "the current freezes",
        Must(1, ("error", "motion", "unbraked"), "either", "coast", (_ERROR, Fault.BRAKING, Fault.TRAVEL))),
    Row("current-reversed", "drive", "wrong", Wrong, "the current has the wrong sign", _SEEN),
    Row("current-weak", "drive", "slow", Weak, "only a part of the current flows", _GOES_ON),
    Row("current-late", "drive", "delayed", Late, "the current acts late", Must(1, ("error",), "either", "coast")),
    Row("node-stuck", "node", "stuck", Plain, "the drive repeats its last answer", _SEEN),
    Row("node-reboot", "node", "off", Plain, "the drive reboots by itself",
        Must(0, ("feedback",), brakes="coast", reasons=(_LOST, _DRIVE, Fault.REBOOTED))),
    Row("statusword-garbage", "node", "garbage", Plain, "the statusword is noise", Must(1, reasons=(_DRIVE,))),
    Row("feedback-short", "node", "wrong", Frames, "the drive's answer is one byte short", _SILENT),
    Row("sdo-abort", "node", "wrong", Plain, "each SDO request is aborted", _GOES_ON),
    Row("sdo-silent", "node", "off", Plain, "no SDO request is answered", _GOES_ON),
    Row("clock-skewed", "clock", "slow", Skew, "the drive's clock runs at another rate", _GOES_ON),
    Row("loop-stalled", "controller", "slow", Late, "the loop's process misses cycles",
        Must(1, ("error", "delay"), "either", reasons=(Fault.LATE, _DRIVE, _EMCY, _ERROR))),
    Row("controller-dead", "controller", "off", Plain, "the loop's process dies (kill -9)",
        Must(1, ("supervision",))),
    Row("interface-down", "controller", "off", Plain, "the controller's own CAN interface fails",
        # while the kernel takes it down, what is sent is lost before anything is refused
        Must(1, ("supervision",), reasons=(Fault.BUS, Fault.FEEDBACK_LOST))),
)  # fmt: skip

ROWS = {row.name: row for row in TABLE}
BLOCKS = {row.name: row.block for row in TABLE if row.component != "controller"}  # what a virtual drive can have


def default(name: str) -> Any:
    """The fault with its default parameters."""
    return ROWS[name].block(name)
