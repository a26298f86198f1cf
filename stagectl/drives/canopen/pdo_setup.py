"""The two PDOs of the cycle in the drive: mapped as the stage file wishes, or as the drive has them for good.

Compared first; written where they differ, by the rules of CiA 301 (a PDO is mapped anew while it does not exist); read
back.  A map that the drive keeps is taken as it is, if it holds all that the cycle needs, in whatever order.
"""

from typing import NamedTuple

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.object_access import ObjectAccess
from stagectl.drives.canopen.pdo import COUNT, DUMMIES, EVENT_TIMER, INVALID, Direction, PdoMap, needed
from stagectl.drives.drive import DriveError

_NO_REMOTE, _IDENTIFIER = 0x4000_0000, 0x7FF  # of a PDO's COB-ID
_INHIBIT_TIME = 3  # subindex: a TPDO's shortest pause
_AT_EVERY_SYNC = 1  # transmission type
_AT_ONCE = (254, 255)  # transmission types of an RPDO that acts as it comes


class _Present(NamedTuple):
    """A PDO as it is in the drive."""

    cob_id: int
    transmission: int
    entries: tuple[int, ...]


class PdoSetup:
    """One direction."""

    def __init__(self, objects: ObjectAccess, direction: Direction) -> None:
        self._objects, self._direction, self._try = objects, direction, objects.attempt
        self._needed = needed(objects.settings, direction)  # objects that the map must hold
        self._read_back: dict[int, _Present] = {}

    def run(self, wished: PdoMap, deadline: int | None = None) -> PdoMap:
        """The map that the cycle uses.

        `deadline` (ms) goes to the event timer of the RPDO, which some drives take only while the PDO does not exist.
        Raises DriveError with the object that a fixed map lacks.
        """
        refusal = self._write(wished, deadline)
        maps = (self._usable(n) for n in range(COUNT))
        chosen = next((pdo for pdo in maps if pdo is not None and self._needed.keys() <= set(pdo.objects)), None)
        if chosen is None:
            raise self._unfit() from refusal
        self._note(chosen.number)
        for n in range(COUNT):
            if n != chosen.number:
                self._switch_off(n)
        return self._filled(chosen)

    def _write(self, wished: PdoMap, deadline: int | None) -> DriveError | None:
        """Write what differs; the first refusal, after which the drive has its PDO again."""
        parameter, present = self._direction.parameter, self._present(0)
        if present is None:
            return None
        cob_id = present.cob_id & _NO_REMOTE | wished.identifier
        times = self._times(deadline)
        if present == _Present(cob_id, _AT_EVERY_SYNC, wished.entries) and not times:
            return None
        refusals = [self._try(INVALID | cob_id, parameter, 1)]
        if present.entries != wished.entries:
            refusals.append(self._map(wished.entries))
        if present.transmission != _AT_EVERY_SYNC:
            refusals.append(self._try(_AT_EVERY_SYNC, parameter, 2))
        for subindex, time in times.items():
            self._try(time, parameter, subindex)  # protection reads the deadline back, and judges
        if refusals[0] is None:
            refusals.append(self._try(cob_id, parameter, 1))
        return next((refusal for refusal in refusals if refusal is not None), None)

    def _map(self, entries: tuple[int, ...]) -> DriveError | None:
        mapping = self._direction.mapping
        writes = [(0, 0), *((entry, n) for n, entry in enumerate(entries, start=1)), (len(entries), 0)]
        for value, subindex in writes:
            refusal = self._try(value, mapping, subindex)
            if refusal is not None:
                return refusal
        return None

    def _times(self, deadline: int | None) -> dict[int, int]:
        """Times of the first PDO that it has and that must be changed, by subindex."""
        wished = {EVENT_TIMER: deadline} if self._direction.received else {_INHIBIT_TIME: 0}
        present = {subindex: self._objects.offered(self._direction.parameter, subindex) for subindex in wished}
        return {n: time for n, time in wished.items() if time is not None and present[n] not in (time, None)}

    def _present(self, n: int) -> _Present | None:
        """PDO `n` as the drive has it; None where it has none."""
        objects, direction = self._objects, self._direction
        cob_id, count = objects.offered(direction.parameter + n, 1), objects.offered(direction.mapping + n)
        if cob_id is None or count is None:
            return None
        entries = tuple(objects.read(direction.mapping + n, subindex) for subindex in range(1, count + 1))
        return _Present(cob_id, objects.read(direction.parameter + n, 2), entries)

    def _usable(self, n: int) -> PdoMap | None:
        """PDO `n`, if it exists and goes with SYNC; an RPDO may also act at once."""
        present = self._present(n)
        if present is None or present.cob_id & INVALID or not present.entries:
            return None
        self._read_back[n] = present
        kinds = (*range(241), *_AT_ONCE) if self._direction.received else (_AT_EVERY_SYNC,)
        if present.transmission not in kinds or any(entry & 0x7 for entry in present.entries):
            return None
        return PdoMap(present.cob_id & _IDENTIFIER, present.entries, number=n, transmission=present.transmission)

    def _filled(self, pdo: PdoMap) -> PdoMap:
        """With the present values of objects that only the drive wants in the RPDO: zeros would change them."""
        if not self._direction.received:
            return pdo
        others = {key for key in pdo.objects if key not in self._needed and key >> 8 >= DUMMIES}
        values = {key: self._objects.offered(key >> 8, key & 0xFF) or 0 for key in others}
        return pdo._replace(fill=tuple(values.get(key, 0) for key in pdo.objects))

    def _note(self, n: int) -> None:
        """Keep all of the chosen PDO, to be verified."""
        present, direction, held = self._read_back[n], self._direction, self._objects.held
        held[direction.parameter + n << 8 | 1] = present.cob_id
        held[direction.parameter + n << 8 | 2] = present.transmission
        for subindex, value in enumerate((len(present.entries), *present.entries)):
            held[direction.mapping + n << 8 | subindex] = value

    def _switch_off(self, n: int) -> None:
        """The others of the predefined set would only take bus time; a drive may keep them."""
        identifier = self._objects.offered(self._direction.parameter + n, 1)
        if identifier is not None and not identifier & INVALID:
            self._try(identifier | INVALID, self._direction.parameter + n, 1)

    def _unfit(self) -> DriveError:
        direction = self._direction
        first = self._read_back.get(0)
        kept = tuple(entry >> 8 for entry in first.entries) if first is not None else ()
        missing = next((key for key in self._needed if key not in kept), None)
        if missing is None or first is None:
            key = direction.parameter << 8 | 2
            reason = f"none that exists and goes with each SYNC (0x{direction.parameter:04X}:02)"
        else:
            key, reason = missing, f"none with {cia402.shown(missing)} ({self._needed[missing]})"
        shown = ", ".join(map(cia402.shown, kept)) or "no object"
        return self._objects.error(
            f": its {direction.name.upper()}s cannot be mapped as the cycle needs them"
            f" (0x{direction.mapping:04X}), and of those that it keeps there is {reason}; the first holds {shown}."
            f" Map it with the drive's own tool, or name other objects in drive.wire.{direction.name}",
            key,
            place=direction.name,
        )
