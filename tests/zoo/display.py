"""What a foreign drive shows of itself: statusword, mode of operation, position, speed and current, each in its way."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from tests.zoo.homing import HM
from tests.zoo.plant import COUNTS, RATED_CURRENT

if TYPE_CHECKING:
    from tests.zoo.drive import Drive

CST = 10  # mode of operation: cyclic synchronous torque
PERMILLE = RATED_CURRENT / 1000.0  # A
OPERATIONAL, PRE_OPERATIONAL = 5, 127  # NMT states
_COUNTS_PER_RAD = COUNTS / (2.0 * math.pi)
_VOLTAGE, _REMOTE, _LIMIT, _FOLLOWS = 1 << 4, 1 << 9, 1 << 11, 1 << 12


def statusword(drive: Drive) -> int:
    """0x6041, with what the variant leaves out, adds and inverts."""
    variant = drive.variant
    following = drive.enabled and drive.mode == CST and not (drive.deaf_still and variant.deaf_told)
    remote = drive.nmt == OPERATIONAL or not variant.remote_when_operational
    bits = drive.power.state.value | _VOLTAGE | _REMOTE * remote | _FOLLOWS * following
    if drive.mode == HM and drive.enabled:
        bits |= drive.homing.bits
    if variant.clamp_told and abs(drive.target * PERMILLE) > variant.clamp:
        bits |= _LIMIT
    return (bits & ~drive.missing_bits | variant.extra_bits) ^ variant.inverted_bits


def mode(drive: Drive) -> int:
    """0x6061."""
    late = drive.now - drive.mode_since < drive.variant.mode_lag
    shown = {"at once": not late, "enabled": drive.enabled, "never": False}[drive.variant.mode_display]
    return drive.mode if shown else 0


def measured(drive: Drive) -> dict[int, int]:
    """Position, speed and current."""
    sign = -1 if drive.memory.number(0x607E00) & 0x80 else 1
    counts = drive.variant.start_counts + round(drive.plant.angle * _COUNTS_PER_RAD) - drive.homing.origin
    counts = round(counts * _gear(drive))
    return {
        0x606400: (sign * counts + 2**31) % 2**32 - 2**31,
        0x606C00: sign * round(drive.plant.speed * _COUNTS_PER_RAD),
        0x607700: round(drive.current() * drive.variant.current_sign / PERMILLE),
    }


def _gear(drive: Drive) -> float:
    """What 0x6091 makes of the motor's counts."""
    if 0x609101 not in drive.memory:
        return 1.0
    return drive.memory.number(0x609102) / drive.memory.number(0x609101)
