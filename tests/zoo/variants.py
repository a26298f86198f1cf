"""The species of the zoo: what each foreign drive does differently from a well-behaved one.

An object is named by its key, index << 8 | subindex: 0x140005 is the event timer of RPDO 1.
Sources: CiA 301 V4.2, CiA 402-2 V3, and the manuals of EPOS4, Gold (Elmo), Accelnet (Copley), AKD, i700, iPOS, C5-E.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

ABSENT, READ_ONLY = 0x0602_0000, 0x0601_0002  # SDO abort codes: object does not exist; attempt to write a constant
NOT_NOW = 0x0800_0022  # cannot be transferred because of the present device state
PDO_LOST = 0x8000_0000  # bit 31 of a COB-ID: the PDO does not exist


class Object(NamedTuple):
    """One entry of an object dictionary."""

    key: int  # index << 8 | subindex
    name: str
    type: str
    access: str
    value: int | str
    record: bool = False


@dataclass(frozen=True)
class Variant:
    """A drive: all that is not said here is as the standard wants it."""

    summary: str
    values: Mapping[int, int] = field(default_factory=dict)  # what objects hold after each boot
    read_only: tuple[int, ...] = ()  # writes are aborted, whatever the value
    forgets: tuple[int, ...] = ()  # writes are confirmed and have no effect
    absent: tuple[int, ...] = ()  # keys; reads and writes are aborted although the EDS lists them
    rpdo: tuple[int, ...] = (0x604000, 0x607100)  # mapping after boot
    tpdo: tuple[int, ...] = (0x604100, 0x606400, 0x607700)
    boot_time: float = 0.02  # s from reset to the boot-up message
    starts_dead: bool = False  # the process begins with that silence, as after power-on
    reset_delay: float = 0.0  # s in which SDOs are still answered after an NMT reset
    reboot_after: int = 0  # SDO requests, then it boots by itself, once
    fault_at_start: int = 0  # emergency error code
    reset_hold: float = 0.0  # s for which bit 7 must stay set
    mode_display: str = "at once"  # "enabled": only in Operation enabled; "never": stays 0
    start_counts: int = 0
    motor_sign: int = 1
    clamp: float = 0.0  # A, the drive limits to this; 0: not
    clamp_told: bool = False  # bit 11 of the statusword
    in_motion: str = ""  # what happens once the axis has moved: see `events.py`
    tpdo_age: int = 0  # periods by which the answer is old
    age_told: bool = False  # the stage file says so
    drops_every: int = 0  # each so many-th SDO response is lost
    sdo_delay: float = 0.0  # s
    extra_pdos: bool = False  # sends TPDO 2 and 3 by event and by SYNC, unasked
    gravity: float = 0.0  # N m, towards negative; such an axis has a brake that the drive works
    brake_time: float = 0.05  # s from the drive's order until the brake holds, or is open
    fault_stays: bool = False  # its cause is still there: a reset has no effect
    needs_interpolation: bool = False  # 0x60C2:01 must not be 0 when it is enabled
    homing: str = ""  # how its mode 6 goes: see `homing.py`; empty: it has none
    second_node: bool = False  # a strange drive with node id 6 is on the same bus
    more: tuple[Object, ...] = ()  # entries of the dictionary that the plain drive has not
    missing_bits: int = 0  # of the statusword
    extra_bits: int = 0
    inverted_bits: int = 0
    toggled_bits: int = 0  # change with each answer
    remote_when_operational: bool = False  # bit 9 follows the NMT state
    mode_lag: float = 0.0  # s until 0x6061 shows what 0x6060 says
    transition_time: float = 0.0  # s that each step towards power takes
    deaf_for: float = 0.0  # s after enabling in which commands have no effect
    deaf_told: bool = True  # by bit 12 meanwhile
    sdo_delay_operational: float = 0.0  # s, while process data run
    vague_aborts: bool = False  # each abort is a general error
    mute_aborts: bool = False  # no answer instead of an abort
    boots_in_silence: bool = False  # no boot-up message
    heartbeat_jitter: float = 0.0  # share of the period to either side
    answers_as: int = 0  # node id that it really has; 0: the right one
    starts_operational: bool = False  # boots into Operational by itself, and sends by event
    starts_enabled: bool = False  # the process begins under power, as somebody left it
    current_sign: int = 1  # of the measured current: -1 reversed, 0 not measured
    wire: Mapping[str, str] = field(default_factory=dict)  # lines of the stage file's block `drive.wire`

    def changed(self, **changes: Any) -> Variant:
        """The same with other fields."""
        return replace(self, **changes)


def keys(*indices: int) -> tuple[int, ...]:
    """Keys of objects without subindices."""
    return tuple(index << 8 for index in indices)


MAPPING = tuple(index << 8 | sub for index in (0x1600, 0x1A00) for sub in range(5))
COB_IDS = (0x140001, 0x180001)
NO_HEARTBEATS = (0x101600, 0x101601, 0x101602, *keys(0x1017))
RPDO_TIMER = (0x140005,)

OPTIONAL = (  # objects that a CiA 402 torque drive may lack
    0x100300, 0x100301, *keys(0x1006, 0x1008, 0x1009, 0x100A), 0x101601, *keys(0x1017), 0x101804, 0x102901, 0x140005,
    *keys(0x6007, 0x603F, 0x605A, 0x605B, 0x605C, 0x605E, 0x6065, 0x6072, 0x6073, 0x6075, 0x6076, 0x607E, 0x6080),
    *keys(0x6085, 0x6087), 0x608F01, 0x60C201, *keys(0x6502),
)  # fmt: skip

SYNC_COUNTER = Object(0x101900, "Synchronous counter overflow", "u8", "rw", 10)
TORQUE_LIMITS = (
    Object(0x60E000, "Positive torque limit", "u16", "rw", 60),
    Object(0x60E100, "Negative torque limit", "u16", "rw", 1600),
)
GEAR = (
    Object(0x609100, "Highest sub-index", "u8", "const", 2, True),
    Object(0x609101, "Gear ratio motor revolutions", "u32", "rw", 2, True),
    Object(0x609102, "Gear ratio shaft revolutions", "u32", "rw", 1, True),
)
MILLIAMPERES = (Object(0x234000, "Current demand", "i32", "rw", 0),)
SYNC_PRODUCER = 0x4000_0000  # bit 30 of 0x1005: the drive makes SYNC itself


VARIANTS: dict[str, Variant] = {
    "plain": Variant("as the standard says; all objects writable"),
    "fixed-map": Variant("mapping objects are read-only, in the order the master wants", read_only=MAPPING),
    "fixed-map-other-order": Variant(
        "fixed map with the torque before the controlword", read_only=MAPPING, rpdo=(0x607100, 0x604000)
    ),
    "fixed-map-more": Variant(
        "fixed map with a mode of operation between the two", read_only=MAPPING, rpdo=(0x604000, 0x606000, 0x607100)
    ),
    "fixed-map-unfit": Variant("fixed map without a torque", read_only=MAPPING, rpdo=(0x604000, 0x606000)),
    "fixed-map-no-position": Variant("fixed TPDO without the position", read_only=MAPPING, tpdo=(0x604100, 0x607700)),
    "fixed-cob-id": Variant("COB-IDs of the PDOs are read-only", read_only=COB_IDS),
    "fixed-right-values": Variant(
        "time-outs and options are read-only and right",
        read_only=(*keys(0x6007, 0x605A, 0x605E), 0x140002, 0x180002),
        values={0x600700: 3, 0x605A00: 2, 0x605E00: 2, 0x140002: 1, 0x180002: 1},
    ),
    "slow-boot": Variant("8 s from power-on to boot-up, shortened to 3 s", boot_time=3.0, starts_dead=True),
    "slow-reset": Variant("a reset takes 3 s", boot_time=3.0, wire={"reset": "node"}),
    "late-boot-up": Variant("answers SDOs for 13.5 ms after a reset", reset_delay=0.0135, wire={"reset": "node"}),
    "late-boot-up-communication": Variant(
        "the same after a communication reset", reset_delay=0.0135, wire={"reset": "communication"}
    ),
    "reboot-in-setup": Variant("boots by itself after the 12th SDO", reboot_after=12),
    "reboot-in-setup-after-reset": Variant("the same, after a reset", reboot_after=12, wire={"reset": "node"}),
    "fault-at-start": Variant("in Fault before we come: over-temperature", fault_at_start=0x4210),
    "fault-stays": Variant("the same, and its cause is still there", fault_at_start=0x4210, fault_stays=True),
    "fault-reset-hold": Variant("a fault reset wants bit 7 for 50 ms", fault_at_start=0x4210, reset_hold=0.05),
    "mode-display-enabled": Variant("0x6061 follows only in Operation enabled", mode_display="enabled"),
    "mode-display-never": Variant("0x6061 stays 0", mode_display="never"),
    "near-wrap": Variant("the position counter is about to pass 2^31", start_counts=2**31 - 500),
    "motor-reversed": Variant("two motor phases are exchanged", motor_sign=-1),
    "polarity": Variant("0x607E reverses the position", values={0x607E00: 0x80}),
    "polarity-fixed": Variant("the same, read-only", values={0x607E00: 0x80}, read_only=keys(0x607E)),
    "clamp-silent": Variant("limits the current to 0.9 A, a third of what the motion needs, in silence", clamp=0.9),
    "clamp-told": Variant("the same, and sets bit 11", clamp=0.9, clamp_told=True),
    "clamp-blocks": Variant("limits the current to less than friction takes, in silence", clamp=0.3),
    "limit-in-drive": Variant("0x6072 and 0x6073 are set below the stage file", values={0x607200: 60, 0x607300: 60}),
    "remote-lost": Variant("bit 9 falls in motion: somebody took over at the keypad", in_motion="remote-lost"),
    "follow-lost": Variant("bit 12 falls in motion: commands are not followed", in_motion="follow-lost"),
    "mode-lost": Variant("leaves the mode in motion", in_motion="mode-lost"),
    "tpdo-late": Variant("the answer is that of the period before", tpdo_age=1),
    "tpdo-late-told": Variant("the same, and the stage file says so", tpdo_age=1, age_told=True),
    "tpdo-frozen": Variant("from some point the same answer again and again", in_motion="tpdo-frozen"),
    "tpdo-silent": Variant("from some point no answer", in_motion="tpdo-silent"),
    "guarding-only": Variant(
        "node guarding, no heartbeat, no RPDO time-out",
        absent=(*NO_HEARTBEATS, *RPDO_TIMER),
    ),
    "heartbeat-only": Variant("no RPDO time-out", absent=RPDO_TIMER),
    "rpdo-timer-only": Variant("no heartbeats, no guarding", absent=(*NO_HEARTBEATS, 0x100C00, 0x100D00)),
    "unsupervised": Variant(
        "no heartbeat consumer, no guarding, no RPDO time-out",
        absent=(*NO_HEARTBEATS, *RPDO_TIMER, 0x100C00, 0x100D00),
    ),
    "supervision-forgets": Variant("confirms 0x1016 and 0x1400:05 but keeps 0", forgets=(0x101601, 0x140005)),
    "abort-connection-0": Variant("0x6007 is 0 and writable", values={0x600700: 0}),
    "abort-connection-0-fixed": Variant("0x6007 is 0 and read-only", values={0x600700: 0}, read_only=keys(0x6007)),
    "abort-connection-absent": Variant("no 0x6007", values={0x600700: 0}, absent=keys(0x6007)),
    "other-vendor": Variant("another maker than the EDS says", values={0x101801: 0x9A}),
    "other-product": Variant("another product of the same maker", values={0x101802: 0x1234}),
    "other-encoder": Variant("0x608F holds four times the counts", values={0x608F01: 40_000}),
    "other-rated-current": Variant("0x6075 is twice that of the stage file", values={0x607500: 10_000}),
    "reboot-in-motion": Variant("boots in motion", in_motion="reboot"),
    "emergency": Variant("an EMCY in motion, without a fault", in_motion="emergency"),
    "emergency-fault": Variant("an EMCY in motion, with fault reaction", in_motion="fault"),
    "disabled-in-motion": Variant("STO in motion: Switch on disabled, no EMCY", in_motion="disabled"),
    "vertical": Variant("a vertical axis with a brake", gravity=0.08),
    "extra-pdos": Variant("sends other PDOs as well", extra_pdos=True),
    "needs-interpolation": Variant("is not enabled while 0x60C2 is 0", values={0x60C201: 0}, needs_interpolation=True),
    "refuses-interpolation": Variant("refuses writes to 0x60C2", read_only=(0x60C201, 0x60C202)),
    "no-torque-mode": Variant(
        "a drive for positions only: modes 1, 6 and 8", values={0x650200: 0xA1}, read_only=keys(0x6060)
    ),
    "no-synchronous-tpdo": Variant("TPDO by event only", values={0x180002: 255}, read_only=(0x180002,)),
    "no-synchronous-rpdo": Variant("RPDO acts at once only", values={0x140002: 255}, read_only=(0x140002,)),
    "drops-sdo": Variant("each 15th SDO response is lost", drops_every=15),
    "slow-sdo": Variant("answers SDOs after 400 ms", sdo_delay=0.4),
    "two-nodes": Variant("a strange node is on the same bus", second_node=True),
    # Ways of drives that come from their manuals.
    "voltage-bit-missing": Variant("bit 4, voltage enabled, is never set", missing_bits=1 << 4),
    "vendor-bits": Variant("bits 7, 8, 14 and 15 are set, and bit 10 toggles", extra_bits=0xC180, toggled_bits=1 << 10),
    "quick-stop-bit-inverted": Variant("bit 5 of the statusword is inverted", inverted_bits=1 << 5),
    "remote-when-operational": Variant("bit 9 only in the NMT state Operational", remote_when_operational=True),
    "follows-never": Variant("old firmware: no bit 12", missing_bits=1 << 12),
    "mode-display-late": Variant("0x6061 follows after 20 ms", mode_lag=0.02),
    "slow-transitions": Variant("each step towards power takes 400 ms", transition_time=0.4),
    "deaf-after-enable": Variant("commands have no effect for 100 ms after enabling; bit 12 says so", deaf_for=0.1),
    "deaf-after-enable-untold": Variant("the same, and bit 12 is set all the time", deaf_for=0.1, deaf_told=False),
    "slow-sdo-under-load": Variant("SDOs take 300 ms in Operational", sdo_delay_operational=0.3),
    "vague-aborts": Variant(
        "what is absent is a general error", absent=OPTIONAL[:-6], vague_aborts=True, values={0x600700: 1}
    ),
    "mute-aborts": Variant("what it does not know, it does not answer", absent=keys(0x1006, 0x6087), mute_aborts=True),
    "sync-counter": Variant("wants a counter in SYNC, 0x1019 is writable", more=(SYNC_COUNTER,)),
    "sync-counter-fixed": Variant("the same, read-only", more=(SYNC_COUNTER,), read_only=keys(0x1019)),
    "sync-producer": Variant("makes SYNC itself until it is told not to", values={0x100500: SYNC_PRODUCER | 0x80}),
    "sync-other-id": Variant("waits for another SYNC frame", values={0x100500: 0x81}),
    "sync-other-id-fixed": Variant("the same, read-only", values={0x100500: 0x81}, read_only=keys(0x1005)),
    "inhibit-time": Variant("the TPDO has an inhibit time of 12 ms", values={0x180003: 120}),
    "inhibit-time-fixed": Variant("the same, read-only", values={0x180003: 120}, read_only=(0x180003,)),
    "gear": Variant("0x6091 scales the position to half of the counts, writable", more=GEAR),
    "gear-fixed": Variant("the same, read-only", more=GEAR, read_only=(0x609101, 0x609102)),
    "torque-limit-one-side": Variant("0x60E0 limits torque to one side only", more=TORQUE_LIMITS),
    "torque-limit-one-side-fixed": Variant("the same, read-only", more=TORQUE_LIMITS, read_only=keys(0x60E0, 0x60E1)),
    "milliamperes": Variant(
        "takes commands in mA, 32 bits wide, in an object of its own",
        more=MILLIAMPERES,
        absent=keys(0x6071),
        rpdo=(0x604000, 0x234000),
        wire={"command_object": "0x2340_00", "command_scale": "1 mA", "rpdo": "[0x6040_00, 0x2340_00]"},
    ),
    "current-reversed": Variant("the measured current has the opposite sign", current_sign=-1),
    "current-not-measured": Variant("0x6077 stays 0", current_sign=0),
    "quick-stop-holds": Variant("stays in Quick stop active, fixed", values={0x605A00: 6}, read_only=keys(0x605A)),
    "quick-stop-coasts": Variant("0x605A cuts the power, fixed", values={0x605A00: 0}, read_only=keys(0x605A)),
    "heartbeat-jitter": Variant("its heartbeat varies by 30 %", heartbeat_jitter=0.3),
    "other-node": Variant("has lost its address: answers as node 6", answers_as=6),
    "starts-operational": Variant("boots into Operational by itself, TPDO by event", starts_operational=True),
    "starts-enabled": Variant("left under power in another mode, with a torque in 0x6071", starts_enabled=True),
    "emergency-storm": Variant("an EMCY every 2 ms in motion, without a fault", in_motion="emergency-storm"),
    "fault-untold": Variant("a fault in motion without EMCY", in_motion="fault-untold"),
    "switched-on-in-motion": Variant("falls back to Switched on in motion", in_motion="switched-on"),
    "voltage-lost": Variant("the power supply goes in motion: bit 4 falls, no fault", in_motion="voltage-lost"),
    "reboot-in-silence": Variant("boots in motion and does not say so", in_motion="reboot", boots_in_silence=True),
}

# Drives that are asked to home themselves; they are tried by `test_homing.py`, as no motion of the table does it.
HOMINGS = {
    f"homing-{kind}": Variant(f"homing by the drive: {kind}", homing=kind, values={0x650200: 0x220})
    for kind in ("switch", "error", "never", "here", "stubborn")
}
HOMINGS |= {f"{name}-late": HOMINGS[name].changed(tpdo_age=1) for name in ("homing-switch", "homing-here")}
HOMINGS["homing-absent"] = Variant("no homing mode", homing="absent")


def named(name: str) -> Variant:
    """The variant of this name; ``without:0x605A00`` lacks the object with this key."""
    if name.startswith("without:"):
        key = int(name.removeprefix("without:"), 16)
        return Variant(f"has no 0x{key >> 8:04X}:{key & 0xFF:02X}", absent=(key,))
    return HOMINGS[name] if name in HOMINGS else VARIANTS[name]
