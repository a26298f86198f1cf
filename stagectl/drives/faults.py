"""The table of faults: what can fail, how, and how drive and loop must react.

YAML (``virtual_drive: faults:``), ``stagectl inject``, ``stagectl selftest`` and the manual all read `TABLE`.
The kinds are those of PX4's failure injection: off, stuck, garbage, wrong, slow, delayed, intermittent.

Stop categories are those of IEC 60204-1: 0 power removed at once, the axis coasts; 1 braked, then power removed;
2 braked, power stays.  `None`: the motion goes on.
"""

import collections
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
Jump = Annotated[int, Quantity("", "[-1e9, 1e9]", "encoder counts of one jump")]
Pause = Annotated[float, Quantity("s", "[0, 1e3]", "time between two jumps or messages; 0 s: one only")]
Rate = Annotated[float, Quantity("", "[0.5, 2]", "seconds of the drive's clock in one second")]


def _block(name: str, words: str, duration: float = 0.0, **own: tuple[Any, float]) -> Any:
    """A NamedTuple of a fault's parameters: its name, its `own` ones with their defaults, when and how long it acts."""
    fields = {**own, "after": (After, 0.0), "duration": (Lasting, duration)}
    defaults = [default for _, default in fields.values()]
    block = _named_tuple(name, ("fault", *fields), defaults=defaults, module=__name__)
    block.__annotations__ = {"fault": Name, **{field: kind for field, (kind, _) in fields.items()}}
    block.__doc__ = words
    return block


_named_tuple: Any = collections.namedtuple  # whose name and defaults mypy wants as literals

OnOffFault = _block("OnOffFault", "A fault that is present or absent.")
FrameFault = _block("FrameFault", "A fault of some of the frames.", share=(Share, 1.0))
RandomFrameFault = _block("RandomFrameFault", "A fault that hits frames by chance.", share=(Share, 0.05))
DelayFault = _block("DelayFault", "A delayed signal.", delay=(Delay, 0.01))
PositionJump = _block("PositionJump", "A position that jumps.", counts=(Jump, 100_000), every=(Pause, 0.0))
ScaledSignal = _block("ScaledSignal", "A signal with a wrong factor.", factor=(Factor, -1.0))
ReducedCurrent = _block("ReducedCurrent", "A current that flows only in part.", factor=(Factor, 0.3))
EmergencyFault = _block("EmergencyFault", "Emergency messages.", code=(Code, 0x4310), every=(Pause, 0.0))
DriveTrip = _block("DriveTrip", "A fault that the drive detects itself.", code=(Code, 0x2310))
Outage = _block("Outage", "A failure that ends by itself.", 0.3)
ClockSkew = _block("ClockSkew", "A clock that runs at another rate.", rate=(Rate, 1.001))


class Reaction(NamedTuple):
    """How an axis must react: one that moves, and one that holds its position."""

    category: Literal[0, 1, 2] | None  # stop category; None: the motion goes on
    noticed: tuple[str, ...] = ("cycle",)  # what bounds the time to the reaction: see `selftest.limits`
    holding: Literal["stop", "go on", "either"] = "stop"  # an axis at rest need not notice every fault
    brakes: Literal["ramp", "coast"] = "ramp"  # coast: the means to brake has failed
    reasons: tuple[Fault, ...] = ()  # what the loop may name as its reason; empty: any


class FaultType(NamedTuple):
    """One kind of fault, with the reaction that it requires."""

    name: str
    component: Literal["bus", "encoder", "drive", "node", "clock", "controller"]
    kind: Literal["off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent"]
    block: Any  # NamedTuple of its parameters
    words: str
    required: Reaction


_LOST, _DRIVE, _EMCY = Fault.FEEDBACK_LOST, Fault.DRIVE_FAULT, Fault.EMERGENCY
_ERROR = Fault.FOLLOWING_ERROR
_SILENT = Reaction(1, ("feedback",), reasons=(_LOST,))
_SEEN = Reaction(1, ("error",), "either", "coast")
_GOES_ON = Reaction(None, (), "go on")
_JUMPS = Reaction(0, brakes="coast", reasons=(Fault.JUMP,))  # not braked by an encoder that lies: `realtime.stops`

# Where a row admits that the axis coasts although its category is 1, the drive cannot brake: its own ramp is closed
# over the encoder or the current that has failed, or a bent controlword has taken its power away before anybody asked.
# Two more are no faults by design: a current that is stuck at what the motion needs is right until the motion changes,
# and found out as `unbraked` then; a twentieth of the frames is doubled, as all of them would take 130 % of the bus at
# 2 kHz.  How long an axis may hold its place in a loop that is late is for the stage file to say, by `late_limit`; what
# moves is stopped by its error.
TABLE: tuple[FaultType, ...] = (
    FaultType("cable-out", "bus", "off", FrameFault, "no frame passes, either way",
        Reaction(1, ("supervision",), reasons=(_LOST,))),
    FaultType("frames-lost", "bus", "intermittent", RandomFrameFault, "frames are lost by chance",
        Reaction(1, ("chance", "feedback"))),
    FaultType("sync-lost", "bus", "off", FrameFault, "SYNC does not reach the drive",
        Reaction(1, ("feedback",), reasons=(_LOST,))),
    FaultType("command-lost", "bus", "off", FrameFault, "the cyclic command (RPDO) does not reach the drive",
        Reaction(1, ("command",), reasons=(_DRIVE, _EMCY, _ERROR, Fault.CLAMPED))),
    FaultType("feedback-lost", "bus", "off", FrameFault, "the drive's cyclic answer (TPDO) is lost", _SILENT),
    FaultType("controller-heartbeat-lost", "bus", "off", FrameFault,
        "the controller's heartbeat does not reach the drive",
        Reaction(1, ("heartbeat",), reasons=(_DRIVE, _EMCY))),
    FaultType("drive-heartbeat-lost", "bus", "off", FrameFault, "the drive's heartbeat is lost while its answers go on",
        Reaction(1, ("heartbeat",), reasons=(_LOST,))),
    FaultType("frames-duplicated", "bus", "wrong", RandomFrameFault, "some frames arrive twice", _GOES_ON),
    FaultType("frames-reordered", "bus", "wrong", RandomFrameFault, "neighbouring frames change places",
        Reaction(1, ("chance", "feedback"))),
    FaultType("command-corrupted", "bus", "garbage", RandomFrameFault, "bits of the command (RPDO) are flipped",
        Reaction(1, ("chance", "feedback"), "either", "coast", (_DRIVE, _EMCY, _ERROR, Fault.SPEED, Fault.JUMP))),
    FaultType("feedback-corrupted", "bus", "garbage", RandomFrameFault, "bits of the drive's answer (TPDO) are flipped",
        Reaction(1, ("chance",), brakes="coast", reasons=(Fault.JUMP, _DRIVE, _ERROR, Fault.SPEED))),
    FaultType("frames-delayed", "bus", "delayed", DelayFault, "all frames arrive late",
        Reaction(1, ("error", "delay"), "either", "coast", (_ERROR, Fault.JUMP, Fault.LATE, _EMCY, _DRIVE, _LOST))),
    FaultType("bus-flooded", "bus", "garbage", FrameFault, "another node sends frames between the drive's", _GOES_ON),
    FaultType("bus-off", "bus", "off", Outage, "the drive's CAN controller goes bus-off and recovers (EMCY 0x8140)",
        Reaction(1, ("supervision",), reasons=(_LOST,))),
    FaultType("encoder-off", "encoder", "off", OnOffFault, "the drive notices that its encoder is gone (EMCY 0x7305)",
        Reaction(1, brakes="coast", reasons=(_DRIVE, _EMCY))),
    FaultType("encoder-stuck", "encoder", "stuck", OnOffFault, "the position freezes, no error is reported", _SEEN),
    FaultType("encoder-jump", "encoder", "wrong", PositionJump, "the position jumps", _JUMPS),
    FaultType("encoder-jumping", "encoder", "intermittent", PositionJump, "the position jumps back and forth", _JUMPS),
    FaultType("encoder-garbage", "encoder", "garbage", OnOffFault, "the position is noise over the whole range",
        _JUMPS),
    FaultType("encoder-reversed", "encoder", "wrong", ScaledSignal, "the position has the wrong sign", _SEEN),
    FaultType("encoder-late", "encoder", "delayed", DelayFault, "the position is late",
        Reaction(1, ("error",), "either", "coast", (_ERROR, Fault.SPEED, Fault.JUMP, Fault.FREEZE, _DRIVE))),
    FaultType("drive-fault", "drive", "off", DriveTrip, "the drive trips: EMCY, fault reaction, Fault",
        Reaction(1, reasons=(_DRIVE, _EMCY))),
    FaultType("emergency", "drive", "wrong", EmergencyFault, "the drive sends an EMCY and continues",
        Reaction(1, reasons=(_EMCY,))),
    FaultType("emergency-storm", "drive", "garbage", EmergencyFault, "the drive sends EMCYs continuously",
        Reaction(1, reasons=(_EMCY,))),
    FaultType("drive-disabled", "drive", "off", OnOffFault, "STO: the drive removes the power",
        Reaction(0, brakes="coast", reasons=(_DRIVE,))),
    FaultType("power-off", "drive", "off", Outage, "the supply fails; when it returns, the drive boots",
        Reaction(0, ("feedback",), brakes="coast", reasons=(_LOST, Fault.REBOOTED))),
    FaultType("current-off", "drive", "off", OnOffFault, "no current flows (motor cable), no error is reported", _SEEN),
    FaultType("current-stuck", "drive", "stuck", OnOffFault, "the current freezes",
        Reaction(1, ("error", "motion", "unbraked"), "either", "coast",
            (_ERROR, Fault.BRAKING, Fault.TRAVEL, Fault.CLAMPED))),
    FaultType("current-reversed", "drive", "wrong", ScaledSignal, "the current has the wrong sign", _SEEN),
    FaultType("current-weak", "drive", "slow", ReducedCurrent, "only a part of the current flows",
        Reaction(1, ("error", "motion"), "either", "coast", (Fault.CLAMPED, _ERROR))),
    FaultType("current-late", "drive", "delayed", DelayFault, "the current acts late",
        Reaction(1, ("error",), "either", "coast")),
    FaultType("node-stuck", "node", "stuck", OnOffFault, "the drive repeats its last answer", _SEEN),
    FaultType("node-reboot", "node", "off", OnOffFault, "the drive reboots by itself",
        Reaction(0, ("feedback",), brakes="coast", reasons=(_LOST, _DRIVE, Fault.REBOOTED))),
    FaultType("statusword-garbage", "node", "garbage", OnOffFault, "the statusword is noise",
        Reaction(1, reasons=(_DRIVE,))),
    FaultType("feedback-short", "node", "wrong", FrameFault, "the drive's answer is one byte short", _SILENT),
    FaultType("sdo-abort", "node", "wrong", OnOffFault, "each SDO request is aborted", _GOES_ON),
    FaultType("sdo-silent", "node", "off", OnOffFault, "no SDO request is answered", _GOES_ON),
    FaultType("clock-skewed", "clock", "slow", ClockSkew, "the drive's clock runs at another rate", _GOES_ON),
    FaultType("loop-stalled", "controller", "slow", DelayFault, "the loop's process misses cycles",
        Reaction(1, ("error", "delay"), "either", reasons=(Fault.LATE, _DRIVE, _EMCY, _ERROR))),
    FaultType("controller-dead", "controller", "off", OnOffFault, "the loop's process dies (kill -9)",
        Reaction(1, ("supervision",))),
    FaultType("interface-down", "controller", "off", OnOffFault, "the controller's own CAN interface fails",
        # while the kernel takes it down, what is sent is lost before anything is refused
        Reaction(1, ("supervision",), reasons=(Fault.BUS, Fault.FEEDBACK_LOST))),
)  # fmt: skip

FAULT_TYPES = {row.name: row for row in TABLE}
BLOCKS = {row.name: row.block for row in TABLE if row.component != "controller"}  # what a virtual drive can have


def default(name: str) -> Any:
    """The fault with its default parameters."""
    return FAULT_TYPES[name].block(name)
