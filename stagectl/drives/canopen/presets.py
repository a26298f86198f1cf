"""Families of CiA 402 drives: which object takes the current, what a count of it is, and in what the stop ramp counts.

From the makers' public documentation; none was tried on hardware here.  What differs from drive to drive (rated
current, option codes) is read from the drive by `probe` and never assumed.
"""

import math
from typing import NamedTuple

from stagectl.drives.canopen import cia402

TARGET, ACTUAL = cia402.TARGET_TORQUE << 8, cia402.ACTUAL_TORQUE << 8
RATED = cia402.RATED_CURRENT << 8
ENCODER_COUNTS = 0.0  # of the stop ramp: an encoder count per second squared
_STEPS = "Its stop ramp (0x6085) counts encoder steps: drive.wire needs no deceleration_scale."
RPM_PER_SECOND = 2.0 * math.pi / 60.0  # rad/s^2


class Preset(NamedTuple):
    """What a family of drives has in common."""

    name: str
    family: str
    vendor: int | None  # CiA vendor id (0x1018:01); None: any
    rated: int  # object (mA) that 1000 per mille of command and feedback stand for, index_subindex
    rated_words: str
    deceleration_scale: float | None  # rad/s^2 of one count of 0x6085, `ENCODER_COUNTS`; None: not known
    notes: tuple[str, ...]
    documents: tuple[str, ...]
    command_object: int = TARGET
    current_object: int = ACTUAL
    standing: str = "from documentation, not tried on hardware"  # how far it is to be trusted


PRESETS = (
    Preset(
        "maxon-epos4",
        "maxon EPOS4",
        0x00FB,
        0x3001_01,
        "nominal current of the motor data, 0x3001:01; 0x6075 is not in its dictionary",
        RPM_PER_SECOND,
        (
            "0x6071 counts per mille of the motor rated torque 0x6076, which the drive computes from nominal current "
            "and torque constant (0x3001:05): the current is right whatever torque constant is set.",
            "Accelerations are in rpm/s by default, 0x60AA says so: 0x00C00300.",
            "Cyclic synchronous torque takes a command as it comes; 0x60C2 must not lie below the bus cycle.",
        ),
        (
            "EPOS4 Firmware Specification, rel8234, edition November 2018: sections 2.3 (units), 3.8 (CST)",
            "EtherCAT information of the EPOS4 Micro 24/5: vendor 251, product 0x69500000",
        ),
    ),
    Preset(
        "elmo-gold",
        "Elmo Gold (Whistle, Solo, Twitter ...)",
        0x009A,
        RATED,
        "motor rated current 0x6075, CL[1] of the drive; 0 there means that it was never set",
        ENCODER_COUNTS,
        (
            "0x6071 counts per mille of 0x6075: 2 A of 3.2 A rated are 625.",
            _STEPS,
            "Its EDS has no event timer of the RPDO (0x1400:05): it notices the loss of its "
            "controller by the heartbeat (0x1016) only.",
            "0x6080 limits the speed in torque mode as well: leave it at its largest value "
            "(github.com/nasa-jpl/jsd/issues/86).",
            "Bit rates of 50, 125, 250, 500 kbit/s and 1 Mbit/s.",
        ),
        (
            "CANopen DSP 402 Implementation Guide, MAN-CAN402IG, version 1.2, pages 104 and 106",
            "EDS 'Gold Drive' V002 of 2014: vendor 0x9A, product 0x30923, 0x6071 to 0x6078 and 0x60B2 are 16 bits",
        ),
    ),
    Preset(
        "nanotec",
        "Nanotec PD4, CL, C5, N5 (plug and drive)",
        0x026C,
        0x203B_01,
        "rated current of the motor, 0x203B:01",
        None,
        (
            "0x6071 counts per mille of the rated torque, which belongs to the rated current 0x203B:01.",
            "Closed loop must have been commissioned in the drive, or torque mode does nothing.",
            "The cycle of 0x60C2 counts whole milliseconds: take control.period of 1 ms or a multiple.",
            "The unit of accelerations is set by the user, in 0x60AA or, with firmware of 2016, by 0x2063 and 0x2064 "
            "(of a revolution per second squared): look there, and set deceleration_scale.",
            "None of these documents gives the vendor id: if `probe` does not know the drive, add --preset nanotec.",
        ),
        (
            "PD4-E-M Technical Manual 1.0.1, FIR-v1748, page 246: 6077h; 6075h shows 203Bh:01 in mA",
            "PD6-E and PD4-E-M online manuals, 6071h: the rated torque corresponds to the rated current 203Bh:01",
            "PD4-C Manual 1.4.1 of 2016, pages 35 (user units), 201, 209 and 217 (60C2h:02 must be -3, milliseconds)",
        ),
    ),
    Preset(
        "kollmorgen-akd",
        "Kollmorgen AKD",
        0x006A,
        RATED,
        "DRV.ICONT, the continuous current of the drive's settings; give it with --rated if 0x6075 does not report it",
        None,
        (
            "0x6071 and 0x6077 count per mille of the rated torque; 1000 belong to DRV.ICONT.",
            "The manual of 2012 describes 0x6071 for profile torque only: look in 0x6502 whether this firmware offers "
            "cyclic synchronous torque.",
            "Accelerations follow the drive's own unit settings: set deceleration_scale.",
        ),
        (
            "AKD CAN-BUS Communication, 903-200004-00, revision H, November 2012, pages 57 and 102",
            "AKD EtherCAT Communication, 903-200005-00, October 2017, page 143 (0x6087: 1000 per mille are DRV.ICONT)",
            "vendor id: S300-S700 CANopen, December 2019, page 36, and AKD2G, object 1018h: 0x6A for all of Kollmorgen",
        ),
    ),
    Preset(
        "stagectl-virtual",
        "stagectl's own virtual drive",
        0x0000,
        RATED,
        "rated current 0x6075, that of the stage file",
        ENCODER_COUNTS,
        ("Finer than 0x6071: command_object 0x2071_00 and current_object 0x2077_00 count 10 uA.", _STEPS),
        ("stagectl/drives/virtual/object_dictionary.py; its EDS is config/drives/stagectl-virtual.eds",),
        standing="tried",
    ),
    Preset(
        "cia402",
        "any drive that keeps to CiA 402",
        None,
        RATED,
        "motor rated current 0x6075",
        None,
        (
            "0x6071 and 0x6077 count per mille of the rated torque, which belongs to the rated current where torque is "
            "proportional to current.",
            "The standard leaves the unit of 0x6085 to the drive: where it is not an encoder count per second squared, "
            "set deceleration_scale.",
        ),
        ("IEC 61800-7-201 (CiA 402-2): cyclic synchronous torque mode",),
    ),
)
BY_NAME = {preset.name: preset for preset in PRESETS}
GENERIC = PRESETS[-1]


def for_vendor(vendor: int | None) -> Preset:
    """The preset of a vendor id; the generic one where there is none."""
    return next((preset for preset in PRESETS if vendor is not None and preset.vendor == vendor), GENERIC)


def wire_values(preset: Preset, rated: float) -> dict[str, float | int]:
    """What belongs into ``drive.wire`` (SI) for a drive of this `rated` current (A)."""
    scale = rated * cia402.TORQUE_PERMILLE
    values: dict[str, float | int] = {
        "rated_current": rated,
        "command_object": preset.command_object,
        "command_scale": scale,
        "current_object": preset.current_object,
        "current_scale": scale,
    }
    if preset.deceleration_scale:
        values["deceleration_scale"] = preset.deceleration_scale
    return values
