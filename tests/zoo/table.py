"""What is right for each variant, by the issue and by the standards; not what the present version does.

``moves``    the motion ends as planned, exit code 0
``refuses``  the axis does not move; the message names the cause
``stops``    it moves, then stands without power; the message names the cause

Where two are right, both are allowed: ``MOVES | REFUSES``.  In each case no sample of the diary may show power without
a monitor that leads to a stop.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from tests.zoo.variants import OPTIONAL

MOVES, REFUSES, STOPS = frozenset({"moves"}), frozenset({"refuses"}), frozenset({"stops"})
WIRING = ("wiring", "terminat", "120 ohm")  # a drive that answers is wired
_ALWAYS_NEVER = ("Traceback",)


@dataclass(frozen=True)
class Row:
    """One expectation; words are regular expressions without regard to case."""

    variant: str
    allowed: frozenset[str]
    says: tuple[str, ...] = ()  # all of them, where it does not move
    never: tuple[str, ...] = (*WIRING, *_ALWAYS_NEVER)  # none of them
    wire: Mapping[str, str] = field(default_factory=dict)  # lines of `drive.wire`, such as a lack that is accepted
    written: Mapping[int, tuple[int, ...]] = field(
        default_factory=dict
    )  # objects that must hold one of these at the end
    served: frozenset[str] | None = None  # what a service must do where it differs: a fault is reset there
    bare: bool = False  # power without a monitor that stops is accepted by name in `wire`
    holding: bool = False  # after the loss of its controller it holds the axis itself, in Quick stop active
    name: str = ""  # of a second row with the same variant

    @property
    def title(self) -> str:
        """For a test's id."""
        return self.name or self.variant


def _row(variant: str, allowed: frozenset[str], *says: str, **more: object) -> Row:
    return Row(variant, allowed, says, **more)  # type: ignore[arg-type]


def _accepted(variant: str, lack: str, **more: object) -> Row:
    """It moves because the stage file accepts the lack by name."""
    return _row(variant, MOVES, wire={"accept": f"[{lack}]"}, name=f"{variant}-accepted", **more)


_STOPPING = {0x600700: (1, 2, 3)}

ROWS = [
    _row("plain", MOVES, written=_STOPPING),
    _row("fixed-map", MOVES),
    _row("fixed-map-other-order", MOVES | REFUSES, "0x1600", r"wire\.rpdo"),
    _row("fixed-map-other-order", MOVES, name="fixed-map-other-order-named", wire={"rpdo": "[0x6071_00, 0x6040_00]"}),
    _row("fixed-map-more", MOVES | REFUSES, "0x1600", r"wire\.rpdo"),
    _row("fixed-map-unfit", REFUSES, "0x1600", "0x6071"),
    _row("fixed-map-no-position", REFUSES, "0x1A00", "0x6064"),
    _row("fixed-cob-id", MOVES),
    _row("fixed-right-values", MOVES),
    _row("slow-boot", MOVES),
    _row("slow-reset", MOVES),
    _row("late-boot-up", MOVES),
    _row("late-boot-up-communication", MOVES),
    _row("reboot-in-setup", MOVES | REFUSES, "boot"),
    _row("reboot-in-setup-after-reset", MOVES | REFUSES, "boot"),
    _row("fault-at-start", REFUSES, "0x4210", "fault reset|reset the fault|fault, reset", served=MOVES),
    _row("fault-reset-hold", REFUSES, "0x4210", "fault reset|reset the fault|fault, reset", served=MOVES),
    _row("fault-stays", REFUSES, "0x4210"),
    _row("mode-display-enabled", MOVES),
    _row("mode-display-never", REFUSES, "0x6061"),
    _row("near-wrap", MOVES | REFUSES, "travel|home", served=MOVES),
    _row("motor-reversed", STOPS | REFUSES, "sign|polarity|reversed"),
    _row("polarity", MOVES | REFUSES, "0x607E|polarity"),
    _row("polarity-fixed", REFUSES | STOPS, "0x607E|polarity|sign"),
    _row("clamp-silent", STOPS | REFUSES, "current"),
    _row("clamp-told", STOPS | REFUSES, "bit 11|internal limit"),
    _row("clamp-blocks", STOPS | REFUSES, "current"),
    _row("limit-in-drive", MOVES | REFUSES, "0x6072|0x6073"),
    _row("remote-lost", STOPS, "bit 9|remote"),
    _row("follow-lost", STOPS, "bit 12|does not follow"),
    _row("mode-lost", STOPS, "0x6061|mode of operation|bit 12"),
    _row("tpdo-late", MOVES | REFUSES | STOPS, r"periods? old|\bage\b|too old|delay"),
    _row("tpdo-late-told", MOVES),
    _row("tpdo-frozen", STOPS, "freeze|frozen|froze|same|stands still|stuck|no new count|does not change"),
    _row("tpdo-silent", STOPS, "TPDO|answer|feedback", never=_ALWAYS_NEVER),  # here a cable may be the cause
    _row("guarding-only", MOVES),
    _row("heartbeat-only", MOVES),
    _row("rpdo-timer-only", MOVES),
    _row("unsupervised", REFUSES, "0x1016", "0x1400"),
    _row("supervision-forgets", REFUSES, "0x1016|0x1400"),
    _row("abort-connection-0", MOVES, written=_STOPPING),
    _row("abort-connection-0-fixed", REFUSES, "0x6007"),
    _row("abort-connection-absent", REFUSES, "0x6007"),
    _row("other-vendor", REFUSES, "0x1018|vendor|identity"),
    _row("other-product", REFUSES, "0x1018|product|identity"),
    _row("other-encoder", REFUSES, "0x608F"),
    _row("other-rated-current", REFUSES, "0x6075"),
    _row("reboot-in-motion", STOPS, "boot"),
    _row("emergency", STOPS, "0x4210"),
    _row("emergency-fault", STOPS, "0x2310"),
    _row("disabled-in-motion", STOPS, "switch on disabled|STO\\b|Operation enabled"),
    _row("vertical", MOVES),
    _row("extra-pdos", MOVES),
    _row("needs-interpolation", MOVES | REFUSES, "0x60C2"),
    _row("refuses-interpolation", MOVES),
    _row("no-torque-mode", REFUSES, "0x6502|0x6060|mode"),
    _row("no-synchronous-tpdo", REFUSES, "0x1800"),
    _row("no-synchronous-rpdo", MOVES | REFUSES, "0x1400"),
    _row("drops-sdo", MOVES),
    _row("slow-sdo", MOVES),
    _row("two-nodes", MOVES),
    _accepted("unsupervised", "no_supervision", bare=True),
    _accepted("abort-connection-0-fixed", "no_reaction", bare=True),
    # Its 0x1029:01 is 0: on a lost heartbeat it leaves operational (CiA 301), so that this is the lack it has.
    _accepted("abort-connection-absent", "nmt_reaction", bare=True),
    _accepted("other-encoder", "encoder_resolution"),
    # Ways of drives that come from their manuals.
    _row("voltage-bit-missing", MOVES),
    _row("vendor-bits", MOVES),
    _row("quick-stop-bit-inverted", REFUSES, "quick stop active|bit 5|statusword"),
    _row("remote-when-operational", MOVES),
    _row("follows-never", MOVES | REFUSES, "bit 12"),
    _row("follows-never", MOVES, name="follows-never-told", wire={"watched_bits": "[9]"}),
    _row("mode-display-late", MOVES),
    _row("slow-transitions", MOVES),
    _row("deaf-after-enable", MOVES | REFUSES, "bit 12"),
    _row("deaf-after-enable-untold", MOVES | REFUSES | STOPS, "current"),
    _row("slow-sdo-under-load", MOVES),
    _row("vague-aborts", MOVES | REFUSES, "General error"),
    _row("mute-aborts", MOVES | REFUSES, "0x1006|0x6087"),
    _row("sync-counter", MOVES, written={0x101900: (0,)}),
    _row("sync-counter-fixed", REFUSES, "0x1019"),
    _row("sync-producer", MOVES | REFUSES, "0x1005|SYNC"),
    _row("sync-other-id", MOVES, written={0x100500: (0x80,)}),
    _row("sync-other-id-fixed", REFUSES, "0x1005"),
    _row("inhibit-time", MOVES),
    _row("inhibit-time-fixed", REFUSES, "0x1800", "inhibit", never=_ALWAYS_NEVER),
    _row("gear", REFUSES | STOPS, "0x6091|gear"),
    _row("gear-fixed", REFUSES | STOPS, "0x6091|gear"),
    _row("torque-limit-one-side", MOVES | REFUSES | STOPS, "0x60E0|current"),
    _row("torque-limit-one-side-fixed", REFUSES | STOPS, "0x60E0|current"),
    _row("milliamperes", MOVES),
    _row("current-reversed", STOPS | REFUSES, "current"),
    _row("current-not-measured", STOPS | REFUSES, "current"),
    _row("quick-stop-holds", MOVES | REFUSES, "0x605A", holding=True),
    _row("quick-stop-coasts", MOVES | REFUSES, "0x605A"),
    _row("heartbeat-jitter", MOVES),
    _row("other-node", REFUSES, "node id", never=_ALWAYS_NEVER),
    _row("starts-operational", MOVES),
    _row("starts-enabled", MOVES | REFUSES, "operation enabled", bare=True),  # its power is not ours
    _row("emergency-storm", STOPS, "0x8110"),
    _row("fault-untold", STOPS, "state fault"),
    _row("switched-on-in-motion", STOPS, "switched on|Operation enabled"),
    _row("voltage-lost", STOPS, "bit 4|voltage|current"),
    _row("reboot-in-silence", STOPS, "boot|answer|switch on disabled", never=_ALWAYS_NEVER),
]
LACKS = [
    _row(f"without:{key:06X}", REFUSES if key == 0x600700 else MOVES, *(["0x6007"] if key == 0x600700 else []))
    for key in OPTIONAL
]
EVERY = {row.title: row for row in (*ROWS, *LACKS)}
