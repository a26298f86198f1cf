r"""What stops the axis when its controller is lost: a supervisor in the drive that works, and a reaction that stops.

::

    our process, cable or bus dies --> RPDO deadline   0x1400:05      \
                                       heartbeat       0x1016:01       >--> 0x6007: fault, power off or quick stop
                                       life guarding   0x100C, 0x100D /     (where it is missing: 0x1029, CiA 301)

Each is written, read back and verified after NMT start.  Without both nothing is enabled, unless the stage file accepts
it by name (`drive.wire.accept`).  Sources: CiA 301, heartbeat, guarding, event timer, error behaviour; CiA 402, 0x6007.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

from stagectl.drives.bus.frames import HEARTBEAT, MASTER, REMOTE, frame
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.object_access import Fits, Held, ObjectAccess
from stagectl.drives.canopen.pdo import EVENT_TIMER, PdoMap
from stagectl.drives.drive import ACCEPTED, Accepted, Canopen
from stagectl.drives.limits import BEATS
from stagectl.drives.run_on import AxisLimits

_MEANS = ("RPDO time-out (0x1400:05)", "heartbeat (0x1016)", "node guarding (0x100C, 0x100D)")  # that notice it
NOT_OFFERED = "not offered by this drive"
ALIVE = frame(HEARTBEAT + MASTER, bytes([cia402.OPERATIONAL]))
_STOPS = (1, 2, 3)  # options 0x6007 that stop: fault, power off, quick stop
_FAULT, _QUICK_STOP = 1, 3  # options 0x6007
_HOLDS = (5, 6, 7, 8)  # options 0x605A that stay in Quick stop active, under power
_OTHER_RAMP = (1, 5)  # options 0x605A and 0x605E that slow down on 0x6084; the next number is the same on 0x6085
_KNOWN = (None, 0, *cia402.BRAKING)  # None: a drive that has no option slows down on 0x6085; 0: it coasts
_WRITTEN = (_QUICK_STOP, 1, 2)  # in which order they are tried: the ramp of a quick stop is known
_LEAVES, _STOPPED = 0, 2  # options 0x1029:01: to pre-operational, which is the default of CiA 301; to stopped
_COMMUNICATION = 1  # subindex of 0x1029


class Protection(NamedTuple):
    """What was found to work."""

    timeout: float  # s of silence after which the drive reacts; 0: it never does
    reacts: bool  # it stops the axis when its controller is lost or NMT takes it out of operation
    brakes: bool  # by its ramp; False: it cuts the power and the axis coasts
    alive: bytes  # frame that tells the drive that we live
    period: float  # s between two of them


class Supervision:
    """The pass that sets the protection up."""

    def __init__(self, objects: ObjectAccess, limits: AxisLimits) -> None:
        self._objects, self._settings, self._limits = objects, objects.settings, limits
        self._description = objects.description

    def run(self, rpdo: PdoMap) -> Protection:
        """Set up supervisors and reaction.  Raises DriveError where one is missing and is not accepted."""
        deadline = self._deadline(rpdo)
        # A drive without a deadline notices by the heartbeat alone, which then must be as quick.
        quick = min(self._settings.rpdo_timeout or self._settings.heartbeat_timeout, self._settings.heartbeat_timeout)
        heartbeat = self._heartbeat(self._settings.heartbeat_timeout if deadline else quick)
        watched = deadline or heartbeat or self._objects.offered(cia402.CONSUMER_HEARTBEAT, 1) is not None
        # A drive whose 0x1016 does not hold is not trusted further.
        guarding = 0.0 if watched else self._guarding(quick)
        times = dict(zip(_MEANS, (deadline, heartbeat, guarding), strict=True))
        timeout = min(filter(None, times.values()), default=0.0)
        if not timeout:
            lacks(self._objects, "no_supervision", cia402.CONSUMER_HEARTBEAT << 8 | 1, None)
        self._choose_ramp(cia402.QUICK_STOP_OPTION)
        reacts, brakes = self._reaction()
        period = min(self._settings.heartbeat, (heartbeat or guarding or self._settings.heartbeat) / BEATS)
        alive = frame(REMOTE | HEARTBEAT + self._settings.node) if guarding else ALIVE
        self._produce(0.0 if guarding else period)
        protection = Protection(timeout, reacts, brakes, alive, period)
        self._description["protection"] = in_words(protection, self._limits, [name for name in _MEANS if times[name]])
        return protection

    def _deadline(self, rpdo: PdoMap) -> float:
        """Time-out (s) of the RPDO in the drive; 0 where there is none."""
        wanted, index = milliseconds(self._settings.rpdo_timeout), cia402.RPDO_PARAMETER + rpdo.number
        name = f"RPDO time-out (0x{index:04X}:05)"
        return self._time(name, wanted, self._objects.hold(wanted, index, EVENT_TIMER, _within(wanted)))

    def _heartbeat(self, timeout: float) -> float:
        """Time-out (s) of our heartbeat in the drive; 0 where it does not watch it."""
        wanted = milliseconds(timeout)
        held = self._objects.hold(
            MASTER << 16 | wanted,
            cia402.CONSUMER_HEARTBEAT,
            1,
            lambda value: value >> 16 == MASTER and _within(wanted)(value & 0xFFFF),
        )
        time = held._replace(value=held.value & 0xFFFF) if held.value is not None else held
        return self._time("heartbeat time-out in the drive (0x1016)", wanted, time)

    def _guarding(self, timeout: float) -> float:
        """Life time (s) of node guarding in the drive: for drives without heartbeat; 0 where it has none."""
        time = max(milliseconds(timeout) // BEATS, 1)
        held = (
            self._objects.hold(time, cia402.GUARD_TIME, 0, _within(time)),
            self._objects.hold(BEATS, cia402.LIFE_TIME_FACTOR, 0, _within(BEATS)),
        )
        works = all(part.fits for part in held)
        life = (held[0].value or 0) * (held[1].value or 0)
        name = "life time of node guarding (0x100C, 0x100D)"
        return self._time(name, time * BEATS, Held(life if life else None, works))

    def _time(self, name: str, wanted: int, held: Held) -> float:
        """Seconds of a time-out that holds, and its words."""
        if held.value is None:
            words = NOT_OFFERED
        elif wanted == 0 and held.fits:
            words = "off"
        else:
            words = f"{held.value} ms" if held.fits else f"DOES NOT HOLD: {wanted} ms wanted, {held.value} ms read back"
        self._description[name] = words
        return (held.value or 0) * 1e-3 if held.fits else 0.0

    def _produce(self, period: float) -> None:
        """The drive's own heartbeat; off with guarding, which it would replace (CiA 301)."""
        wanted = milliseconds(self._settings.heartbeat if period else 0.0)
        held = self._objects.hold(wanted, cia402.PRODUCER_HEARTBEAT, 0, _within(wanted))
        words = NOT_OFFERED if held.value is None else f"{held.value} ms"
        self._description["heartbeat of the drive (0x1017)"] = words

    def _choose_ramp(self, index: int) -> None:
        """Let a stop go by the ramp that is set (0x6085), not by one that nobody knows: of other stops, or a vendor's.

        Raises DriveError where its option code does not change.
        """
        option = self._objects.offered(index)
        if option in _OTHER_RAMP:
            option = self._objects.hold(option + 1, index).value
        if option not in _KNOWN:
            name = cia402.OPTIONS[index][0]
            words = f": how far its stop goes is not known: the {name} is {option}, {cia402.option(index, option)}"
            raise self._objects.error(f"{words}; set it to 2 with the drive's own tool", index << 8, option)

    def _reaction(self) -> tuple[bool, bool]:
        """Whether a lost controller stops the axis, and whether by braking."""
        code = self._objects.offered(cia402.ABORT_CONNECTION)
        name = cia402.OPTIONS[cia402.ABORT_CONNECTION][0]
        if code is None:
            self._description[name] = NOT_OFFERED
            return self._error_behaviour(), False
        for wanted in (self._preferred(), *_WRITTEN):
            held = self._objects.hold(wanted, cia402.ABORT_CONNECTION)
            code = code if held.value is None else held.value
            if code in _STOPS:
                break
        self._description[name] = cia402.option(cia402.ABORT_CONNECTION, code)
        if code not in _STOPS:
            lacks(self._objects, "no_reaction", cia402.ABORT_CONNECTION << 8, code)
            return False, False
        self._objects.held[cia402.ABORT_CONNECTION << 8] = code
        if code == _FAULT:
            self._choose_ramp(cia402.FAULT_REACTION)
        return True, self._brakes(code)

    def _preferred(self) -> int:
        """Quick stop, on the ramp that is set; another reaction where a person wants it by `start_up`."""
        key = cia402.ABORT_CONNECTION << 8
        return next((entry.value for entry in self._settings.start_up if entry.object == key), _WRITTEN[0])

    def _brakes(self, code: int) -> bool:
        """Whether a reaction brakes: fault and quick stop have option codes of their own, in which 0 coasts."""
        following = {_FAULT: cia402.FAULT_REACTION, _QUICK_STOP: cia402.QUICK_STOP_OPTION}.get(code)
        return following is not None and self._objects.offered(following) != 0

    def _error_behaviour(self) -> bool:
        """Of a drive without 0x6007: whether 0x1029:01 makes it leave operational."""
        held = self._objects.hold(_LEAVES, cia402.ERROR_BEHAVIOUR, _COMMUNICATION, (_LEAVES, _STOPPED).__contains__)
        self._description["error behaviour (0x1029:01)"] = (
            "leaves operational when the controller is lost" if held.fits else NOT_OFFERED
        )
        lacks(self._objects, "nmt_reaction" if held.fits else "no_reaction", cia402.ABORT_CONNECTION << 8, None)
        return held.fits


def check_output_brake(objects: ObjectAccess) -> None:
    """A brake that we set by 0x60FE: nobody does once we are lost, so that the drive must hold the axis under power.

    Raises DriveError where its reaction does not end in Quick stop active (0x6007 = 3, 0x605A of 5 to 8).
    """
    reaction, option = objects.offered(cia402.ABORT_CONNECTION), objects.offered(cia402.QUICK_STOP_OPTION)
    if reaction != _QUICK_STOP:
        lacks(objects, "output_brake", cia402.ABORT_CONNECTION << 8, reaction)
    elif option not in _HOLDS:
        lacks(objects, "output_brake", cia402.QUICK_STOP_OPTION << 8, option)


def lacks(objects: ObjectAccess, name: Accepted, key: int, value: int | None, detail: str = "") -> None:
    """Note what a drive lacks and the stage file accepts by `name`.  Raises DriveError where it does not."""
    if name in objects.settings.accept:
        objects.description[f"ACCEPTED: {name}"] = ACCEPTED[name]
        return
    shown = "missing, or does not hold what is written" if value is None else f"{value}"
    raise objects.error(
        f": {ACCEPTED[name]}. Object {cia402.shown(key)} is {shown}; {detail or _REMEDY[name]}."
        f" It is not enabled like this, unless the stage file says 'drive.wire.accept: [{name}]'",
        key,
        value,
        "drive.wire.accept",
    )


_REMEDY: dict[str, str] = {
    "no_supervision": "one of 0x1016 (heartbeat), 0x1400:05 (RPDO time-out) and 0x100C with 0x100D (guarding) must hold"
    " a time; compare the EDS with the drive's firmware, or take another drive",
    "nmt_reaction": "its power stage need not follow 0x1029:01; try it at low current with the power to the motor off",
    "output_brake": "let 0x605A be 5 to 8 by drive.wire.start_up, so that the quick stop (0x6007 = 3) ends in holding;"
    " or wire the brake to the drive's own brake output and say 'brake.control: drive'",
    "no_reaction": "set 0x6007 to 3 (quick stop) with the drive's own tool; where it is missing, 0x1029:01 to 0",
}


def in_words(protection: Protection, limits: AxisLimits, by: Iterable[str]) -> str:
    """What protects the axis, with the way that a lost controller costs; `by` names what notices it.

    All of it was only read: CiA 402 leaves to the maker whether 0x6007 follows a time-out of the RPDO.
    """
    if not protection.timeout:
        return "NONE: the drive does not notice the loss of its controller"
    if not protection.reacts:
        return "NONE: the drive notices the loss of its controller and goes on"
    how = "brakes by its ramp" if protection.brakes else "cuts its power, the axis coasts"
    words = f"{protection.timeout * 1e3:.0f} ms after the last sign of its controller the drive {how}"
    way = f"; {limits.words(protection.timeout, protection.brakes)}" if limits.current else ""
    return f"{words}{way}; by {', '.join(by)}, as the drive says: `stagectl drive accept` tries it"


class Outlook(NamedTuple):
    """What a set-up would find, from what the drive offers; nothing was written."""

    good: bool
    words: str


def outlook(wire: Canopen, offered: Callable[[int, int], int | None], limits: AxisLimits) -> Outlook:
    """How the axis would be protected; `offered` gives the value of an object, None where it is missing."""
    quick = min(wire.rpdo_timeout or wire.heartbeat_timeout, wire.heartbeat_timeout)
    guarded = offered(cia402.GUARD_TIME, 0) is not None and offered(cia402.LIFE_TIME_FACTOR, 0) is not None
    deadline = wire.rpdo_timeout > 0.0 and offered(cia402.RPDO_PARAMETER, EVENT_TIMER) is not None
    means = (deadline, offered(cia402.CONSUMER_HEARTBEAT, 1) is not None, guarded)
    by = [name for name, there in zip(_MEANS, means, strict=True) if there]
    code = offered(cia402.ABORT_CONNECTION, 0)
    brakes = offered(cia402.QUICK_STOP_OPTION, 0) != 0  # 0x6007 becomes 3 where it is not
    words = in_words(Protection(quick if by else 0.0, code is not None, brakes, b"", 0.0), limits, by)
    written = "; 0x6007 is 0 and must take 3 at the start" if code not in (None, *_STOPS) else ""
    missing = "; 0x6007 is missing" if code is None else ""
    return Outlook(bool(by) and code is not None, f"{words}{written}{missing}")


def milliseconds(seconds: float) -> int:
    """As the drive counts; a short time is not rounded to 0, which would mean none."""
    return 0 if seconds == 0.0 else max(1, round(seconds * 1e3))


def _within(wanted: int) -> Fits:
    """A drive may round a time-out down, not up, and not to 0, which is off."""
    return lambda value: value == wanted or 0 < value <= wanted
