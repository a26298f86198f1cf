"""Objects that real drives want right, as one table: written where present, compared where fixed.

What a person must decide is none of these: the stage file writes it by `drive.wire.start_up`.
Sources: CiA 301 (communication), IEC 61800-7-201 (CiA 402-2: profile).
"""

import math
import operator
from collections.abc import Callable
from typing import NamedTuple

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.object_access import Held, ObjectAccess
from stagectl.drives.canopen.protection import NOT_OFFERED, lacks
from stagectl.drives.drive import Accepted, Canopen, DriveError, StartUp
from stagectl.drives.homing import NO_HOMING, Homing
from stagectl.drives.limits import INCREMENTS, ROUNDED, SEARCH_TIME
from stagectl.drives.run_on import UNKNOWN_AXIS, AxisLimits

_INVERTED = 0xE0  # bits of 0x607E: position, velocity and, with some makers, torque
_LARGEST_U32, _LARGEST_U16, _LARGEST_U8 = 2**32 - 1, 2**16 - 1, 2**8 - 1
_EXPONENTS = (-3, -4, -5, -6)  # of 0x60C2, in the order in which they are tried: drives exist that take -3 alone


class Wishes(NamedTuple):
    """What the rules follow from."""

    settings: Canopen
    encoder_step: float  # rad | m, one count of the position
    dt: float = 0.0  # s, the period
    limits: AxisLimits = UNKNOWN_AXIS  # what follows from them is left alone where nothing is known of the axis
    homing: Homing = NO_HOMING
    offered: Callable[[int, int], int | None] = lambda index, subindex: None  # value of an object; None: it is missing


class Rule(NamedTuple):
    """One object."""

    key: int  # index << 8 | subindex
    name: str
    wanted: Callable[[Wishes], int | None]  # None: nothing follows from the stage file
    enough: Callable[[int, int], bool] | None  # (value, wanted) that may stay where it cannot be written; None: any
    written: bool  # False: set in the drive by a person, and only compared
    remedy: str = ""
    accept: Accepted | None = None


def _torque(p: Wishes) -> int | None:
    """Largest command in per mille of the rated current, rounded up: the law's own limit comes first."""
    if not p.limits.current:
        return None
    return min(math.ceil(p.limits.current / (p.settings.rated_current * cia402.TORQUE_PERMILLE) - 1e-9), _LARGEST_U16)


def _slope(p: Wishes) -> int | None:
    """Per mille a second: from zero to the largest command within a period."""
    torque = _torque(p)
    return min(math.ceil(torque / p.dt), _LARGEST_U32) if torque else None


def _revolutions(p: Wishes) -> int | None:
    """Speed limit in revolutions a minute; a linear motor has no such unit."""
    return math.floor(p.limits.speed * 60.0 / (2.0 * math.pi)) if p.limits.travel.rotary else None


def _increments(p: Wishes) -> int | None:
    """Counts of the revolutions in 0x608F:02; nothing where a feed constant or a linear motor scales the position."""
    scaled = p.offered(cia402.FEED, 1) and p.offered(cia402.FEED, 2)
    return None if scaled or not p.offered(cia402.ENCODER, 1) else _counts(p, p.offered(cia402.ENCODER, 2))


def _feed(p: Wishes) -> int | None:
    """Counts of the revolutions of the shaft in 0x6092:02."""
    return _counts(p, p.offered(cia402.FEED, 2)) if p.offered(cia402.FEED, 1) else None


def _counts(p: Wishes, turns: int | None) -> int | None:
    """Counts of 0x6064 that so many turns behind the gear (0x6091) should make, by the stage file."""
    motor, shaft = p.offered(cia402.GEAR, 1) or 1, p.offered(cia402.GEAR, 2) or 1
    return round(2.0 * math.pi * turns * motor / (shaft * p.encoder_step)) if p.limits.travel.rotary and turns else None


def _period(p: Wishes) -> tuple[int, int] | tuple[None, None]:
    """Mantissa and exponent of the period; the drive's own exponent first, none where no exponent fits."""
    present = p.offered(cia402.INTERPOLATION_PERIOD, 2)
    for exponent in (*(() if present is None else (present,)), *_EXPONENTS):
        mantissa = round(p.dt / 10.0**exponent)
        if 1 <= mantissa <= _LARGEST_U8 and math.isclose(mantissa * 10.0**exponent, p.dt, rel_tol=1e-9):
            return mantissa, exponent
    return None, None


def _near(value: int, wanted: int) -> bool:
    return abs(value - wanted) <= max(INCREMENTS * wanted, 0.5)


def _rounded(value: int, wanted: int) -> bool:
    return abs(value - wanted) <= max(ROUNDED * wanted, 1)


def _speed(p: Wishes, speed: float) -> int | None:
    """In counts of 0x6099; a search that does not move has none."""
    return max(1, round(speed / (p.settings.velocity_scale or p.encoder_step))) if p.homing.moves else None


def _ramp(p: Wishes) -> int | None:
    scale = p.settings.deceleration_scale or p.encoder_step
    return max(1, round(abs(p.homing.speed) / SEARCH_TIME / scale)) if p.homing.moves else None


RULES = (
    Rule(
        cia402.SYNC_COB_ID << 8, "identifier of SYNC", lambda p: 0x80, operator.eq, True,
        "set it to 0x80 in the drive",
    ),
    Rule(
        cia402.SYNC_COUNTER << 8, "counter in SYNC", lambda p: 0, operator.eq, True,
        "set it to 0, none, in the drive",
    ),
    Rule(cia402.CYCLE_PERIOD << 8, "SYNC period, us", lambda p: round(p.dt * 1e6) or None, None, True),
    Rule(cia402.INTERPOLATION_PERIOD << 8 | 2, "interpolation period, exponent", lambda p: _period(p)[1], None, True),
    Rule(cia402.INTERPOLATION_PERIOD << 8 | 1, "interpolation period", lambda p: _period(p)[0], None, True),
    Rule(
        cia402.MAX_TORQUE << 8, "max torque, per mille", _torque, operator.ge, True,
        "the drive limits the command: raise it there, or lower drive.current_limit",
    ),
    Rule(
        cia402.MAX_CURRENT << 8, "max current, per mille", _torque, operator.ge, False,
        "the drive limits the command: raise it there if the motor may, or lower drive.current_limit",
    ),
    *(
        Rule(
            index << 8, f"torque limit to {side}, per mille", _torque, operator.ge, True,
            "the drive limits the command: raise it there, or lower drive.current_limit",
        )
        for index, side in zip(cia402.TORQUE_LIMITS, ("positive", "negative"), strict=True)
    ),
    Rule(
        cia402.POLARITY << 8, "polarity", lambda p: 0, lambda value, _: not value & _INVERTED, False,
        "set it to 0 in the drive, so that positive current moves towards positive positions", "inverted_polarity",
    ),
    Rule(cia402.TORQUE_SLOPE << 8, "torque slope, per mille a second", _slope, None, True),
    Rule(cia402.FOLLOWING_WINDOW << 8, "following error window", lambda p: None, None, False),
    Rule(
        cia402.MAX_SPEED << 8, "max speed, 1/min", _revolutions, operator.ge, False,
        "the drive limits the speed: raise it there, or lower limits.speed",
    ),
    Rule(
        cia402.ENCODER << 8 | 1, "encoder increments", _increments, _near, False,
        "correct encoder.counts_per_revolution, or encoder and gear ratio (0x6091) in the drive", "encoder_resolution",
    ),
    Rule(
        cia402.FEED << 8 | 1, "feed constant", _feed, _near, False,
        "correct encoder.counts_per_revolution, or feed and gear ratio (0x6091) in the drive", "encoder_resolution",
    ),
)  # fmt: skip

HOMING_RULES = (  # where the drive finds its home itself
    Rule(
        cia402.HOMING_METHOD << 8, "homing method", lambda p: p.homing.number, operator.eq, True,
        "name one that the drive has in homing.number",
    ),
    Rule(
        cia402.HOMING_SPEEDS << 8 | 1, "homing speed", lambda p: _speed(p, abs(p.homing.speed)), _rounded, True,
        "correct homing.speed, or drive.wire.velocity_scale",
    ),
    Rule(
        cia402.HOMING_SPEEDS << 8 | 2, "homing speed at the switch", lambda p: _speed(p, p.homing.slowly), _rounded,
        True, "correct homing.slow, or drive.wire.velocity_scale",
    ),
    Rule(cia402.HOMING_ACCELERATION << 8, "homing acceleration", _ramp, None, True),
    Rule(
        cia402.HOME_OFFSET << 8, "home offset", lambda p: 0, operator.eq, True,
        "set it to 0 in the drive: homing.position says what the home is",
    ),
)  # fmt: skip


def obey(objects: ObjectAccess, wishes: Wishes) -> None:
    """Let the drive hold what the table wants.  Raises DriveError with the object that cannot be."""
    p = wishes._replace(offered=objects.offered)
    for rule in (*RULES, *(HOMING_RULES if p.homing.by_drive else ())):
        _obey(rule, objects, p)
    for entry in p.settings.start_up:
        held = objects.hold(entry.value, entry.object >> 8, entry.object & 0xFF)
        if not held.fits:
            raise _unheld(objects, entry, held) from held.refusal
        objects.description[f"start-up ({cia402.shown(entry.object)})"] = f"{entry.value}"


def check_start_up(objects: ObjectAccess, settings: Canopen) -> None:
    """Raises DriveError where ramp and protection, which come after a person's objects, need another value of one."""
    for entry in settings.start_up:
        value = objects.held.get(entry.object)
        if value != entry.value:
            raise _unheld(objects, entry, Held(value, False))


def _unheld(objects: ObjectAccess, entry: StartUp, held: Held) -> DriveError:
    shown = "missing" if held.value is None else f"{held.value}"
    return objects.error(
        f": drive.wire.start_up wants {cia402.shown(entry.object)} = {entry.value}, but it is {shown}; correct"
        " the entry, or set the object with the drive's own tool",
        entry.object,
        held.value,
        "drive.wire.start_up",
    )


def _obey(rule: Rule, objects: ObjectAccess, p: Wishes) -> None:
    index, subindex = rule.key >> 8, rule.key & 0xFF
    value = p.offered(index, subindex)
    name = f"{rule.name} ({cia402.shown(rule.key)})"
    if value is None:
        objects.description[name] = NOT_OFFERED
        return
    wanted = rule.wanted(p)
    if wanted is not None and rule.written and not _stays(rule, value, wanted):
        held = objects.hold(wanted, index, subindex)
        value = value if held.value is None else held.value
    objects.description[name] = str(value) if wanted in (None, value) else f"{value}; wanted {wanted}"
    if wanted is None:
        return
    if rule.enough is not None and not rule.enough(value, wanted):
        _refuse(rule, objects, value, wanted)
    objects.keep(Held(value, True), index, subindex)


def _stays(rule: Rule, value: int, wanted: int) -> bool:
    """A steeper torque slope need not be made flatter."""
    return value == wanted or (rule.key == cia402.TORQUE_SLOPE << 8 and value >= wanted)


def _refuse(rule: Rule, objects: ObjectAccess, value: int, wanted: int) -> None:
    key = rule.key
    if rule.accept is not None:
        lacks(objects, rule.accept, key, value, f"by the stage file it must be {wanted}: {rule.remedy}")
        return
    words = f": {rule.name} is {value} ({cia402.shown(key)}); the stage file wants {wanted}: {rule.remedy}"
    raise objects.error(words, key, value)
