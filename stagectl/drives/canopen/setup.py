"""Configuration of a CiA 402 drive over SDO, in pre-operational; what it is and does, in words.

Every value that matters is read back.  Objects that drives may lack are tolerated and described as not
offered; anything else that is missing or refused is an error which names the object.
"""

from __future__ import annotations

from typing import Any

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.library import SdoAbortedError, SdoCommunicationError, SdoError
from stagectl.drives.canopen.network import Partner
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import Canopen, DriveError

MASTER = 127  # our own node id, as the drive's heartbeat consumer (0x1016) knows it
NOT_OFFERED = "not offered by this drive"
_ANSWER_TIME = 5.0  # s in which a drive that is just booting must answer
# A drive that boots swallows the first request, which is soon put again.  Once it answers, an object that it keeps in
# flash may take it most of a second (canopen #25, CanOpenSTM32 #89); nothing has power yet, nothing waits for it.
_KNOCK_TIME, _SDO_TIME = 0.3, 1.0  # s for one answer
_TRIES = 3  # of a request whose frame, or whose answer, is lost; a late answer is not taken for another: see `wire`
_MODE_TIME = 1.0  # s in which 0x6061 must follow 0x6060
_INVALID, _NO_REMOTE = 0x8000_0000, 0x4000_0000  # bits of a PDO's COB-ID
_ABSENT = (cia402.NO_OBJECT, cia402.NO_SUBINDEX)
_EVENT_TIMER = 5  # subindex of an RPDO's deadline


class Setup:
    """One pass of configuration; `reported` collects the answers of the drive."""

    def __init__(self, settings: Canopen, node: Partner, encoder_step: float, clock: Clock = WALL) -> None:
        """`encoder_step` (rad | m) is one count of the drive's position."""
        self._settings, self._node, self._step = settings, node, encoder_step
        self.reported: dict[str, str] = {}
        self._now = clock.now

    def run(self) -> None:
        """Configure the drive and start its PDOs.  Raises DriveError."""
        if self._settings.reset != "none":
            self._node.nmt.send_command(cia402.NMT_RESETS[self._settings.reset])
        self._wait_for_answer()
        self._identify()
        self._check_rated_current()
        self._map()
        self._supervise()
        self._set_stops()
        self._set_mode()
        self._node.nmt.send_command(cia402.NMT_START)

    def read(self, index: int, subindex: int = 0) -> Any:
        """Value of an object, by the type that the EDS gives it.  Raises DriveError."""
        try:
            return self._upload(index, subindex)
        except SdoError as error:
            raise self._refused("read", index, subindex, error) from error

    def offered(self, index: int, subindex: int = 0) -> Any:
        """Value of an object that a drive may lack; None where it does.  Raises DriveError."""
        try:
            return self._upload(index, subindex)
        except SdoAbortedError as error:
            if error.code in _ABSENT:
                return None
            raise self._refused("read", index, subindex, error) from error
        except SdoError as error:
            raise self._refused("read", index, subindex, error) from error

    def write(self, value: int, index: int, subindex: int = 0, optional: bool = False) -> bool:
        """Write an integer; False where an `optional` object is missing.  Raises DriveError."""
        try:
            self._node.sdo.download(index, subindex, self._variable(index, subindex).encode_raw(value))
        except SdoError as error:
            if optional and isinstance(error, SdoAbortedError) and error.code in _ABSENT:
                return False
            action = f"write of {value} (0x{value & 0xFFFFFFFF:X})"
            raise self._refused(action, index, subindex, error) from error
        return True

    def _upload(self, index: int, subindex: int) -> Any:
        return self._variable(index, subindex).decode_raw(self._node.sdo.upload(index, subindex))

    def _variable(self, index: int, subindex: int) -> Any:
        variable = self._node.object_dictionary.get_variable(index, subindex)
        if variable is None:
            raise SdoAbortedError(cia402.NO_OBJECT)  # not in the EDS: for us the drive does not have it
        return variable

    def _refused(self, action: str, index: int, subindex: int, error: SdoError) -> DriveError:
        known = self._node.object_dictionary.get_variable(index, subindex)
        name = known.name if known is not None else "not in the EDS"
        return DriveError(
            f"node {self._settings.node}: {action} of object 0x{index:04X}:{subindex:02X} ({name})"
            f" failed: {error};"
            f" compare {self._settings.eds} with the drive's manual and firmware"
        )

    def _wait_for_answer(self) -> None:
        s = self._settings
        deadline = self._now() + _ANSWER_TIME
        self._node.sdo.RESPONSE_TIMEOUT, self._node.sdo.MAX_RETRIES = _KNOCK_TIME, 1
        while True:
            self._node.nmt.send_command(cia402.NMT_PRE_OPERATIONAL)
            try:
                kind = self._upload(cia402.DEVICE_TYPE, 0)
                break
            except SdoCommunicationError as error:
                if self._now() > deadline:
                    raise DriveError(
                        f"node {s.node} does not answer on {s.interface} {s.channel} in {_ANSWER_TIME:.0f} s; is"
                        " the drive powered, are node id and bit rate right, the bus terminated? (virtual: is"
                        " 'stagectl virtual-drive' running on this channel?)"
                    ) from error
            except SdoError as error:
                raise self._refused("read", cia402.DEVICE_TYPE, 0, error) from error
        self._node.sdo.RESPONSE_TIMEOUT, self._node.sdo.MAX_RETRIES = _SDO_TIME, _TRIES
        if kind & 0xFFFF != cia402.PROFILE:
            raise DriveError(
                f"node {s.node}: device type 0x1000 = 0x{kind:08X} is profile {kind & 0xFFFF}; must be"
                f" {cia402.PROFILE} (a CiA 402 drive); check 'node: {s.node}'"
            )
        servo = "servo drive" if kind & cia402.SERVO_DRIVE else "not marked as servo drive"
        self.reported["device type"] = f"0x{kind:08X}: CiA 402, {servo}"

    def _identify(self) -> None:
        names = ("vendor", "product", "revision", "serial number")
        for subindex, name in enumerate(names, start=1):
            value = self.offered(cia402.IDENTITY, subindex)
            self.reported[name] = NOT_OFFERED if value is None else f"0x{value:08X}"
        for index, name in (
            (cia402.DEVICE_NAME, "device name"),
            (cia402.HARDWARE_VERSION, "hardware version"),
            (cia402.SOFTWARE_VERSION, "software version"),
        ):
            self.reported[name] = str(self.offered(index) or NOT_OFFERED)

    def _check_rated_current(self) -> None:
        s = self._settings
        rated = self.offered(cia402.RATED_CURRENT)
        self.reported["rated current (0x6075)"] = NOT_OFFERED if rated is None else f"{rated * 1e-3:g} A"
        permille = s.command_object >> 8 == cia402.TARGET_TORQUE
        if permille and rated is not None and round(s.rated_current * 1e3) != rated:
            raise DriveError(
                f"rated_current = {s.rated_current:g} A, but node {s.node} says {rated * 1e-3:g} A"
                " (0x6075), and its"
                f" command counts per mille of it; set 'rated_current: {rated * 1e-3:g} A' or parametrise"
                " the drive"
            )
        self.reported["current command"] = f"0x{s.command_object:06X}, {s.command_scale:g} A a count"
        measured = f"0x{s.current_object:06X}, {s.current_scale:g} A a count" if s.current_object else "none"
        self.reported["measured current"] = measured

    def _map(self) -> None:
        s = self._settings
        self.write(0x80, cia402.SYNC_COB_ID, optional=True)
        self._map_one(cia402.RPDO_PARAMETER, cia402.RPDO_MAPPING, s.rpdo, 0x200 + s.node)
        self._map_one(cia402.TPDO_PARAMETER, cia402.TPDO_MAPPING, s.tpdo, 0x180 + s.node)
        for parameter in (cia402.RPDO_PARAMETER, cia402.TPDO_PARAMETER):
            for n in (1, 2, 3):  # the others of the predefined set would only take bus time
                identifier = self.offered(parameter + n, 1)
                if identifier is not None and not identifier & _INVALID:
                    self.write(identifier | _INVALID, parameter + n, 1)

    def _map_one(self, parameter: int, mapping: int, objects: tuple[int, ...], identifier: int) -> None:
        kept = self.read(parameter, 1) & _NO_REMOTE
        self.write(_INVALID | kept | identifier, parameter, 1)
        self.write(0, mapping, 0)
        for subindex, key in enumerate(objects, start=1):
            bits = len(self._variable(key >> 8, key & 0xFF))
            self.write(key << 8 | bits, mapping, subindex)
        self.write(len(objects), mapping, 0)
        self.write(1, parameter, 2)  # at every SYNC
        if parameter == cia402.RPDO_PARAMETER:
            self._set_deadline(parameter)
        self.write(kept | identifier, parameter, 1)

    def _set_deadline(self, parameter: int) -> None:
        wanted = self._settings.rpdo_timeout
        if self.write(_milliseconds(wanted), parameter, _EVENT_TIMER, optional=True):
            words = "off" if wanted == 0.0 else f"{_milliseconds(wanted)} ms"
        else:
            words = NOT_OFFERED
        self.reported["RPDO time-out (0x1400:05)"] = words

    def _supervise(self) -> None:
        """Heartbeats both ways."""
        s = self._settings
        produced, consumed = _milliseconds(s.heartbeat), _milliseconds(s.heartbeat_timeout)
        offered = self.write(produced, cia402.PRODUCER_HEARTBEAT, optional=True)
        self.reported["heartbeat of the drive (0x1017)"] = f"{produced} ms" if offered else NOT_OFFERED
        offered = self.write(MASTER << 16 | consumed, cia402.CONSUMER_HEARTBEAT, 1, optional=True)
        self.reported["heartbeat time-out in the drive (0x1016)"] = (
            f"{consumed} ms" if offered else (f"{NOT_OFFERED}: it does not notice when the controller dies")
        )

    def _set_stops(self) -> None:
        scale = self._settings.deceleration_scale
        counts = round(self._settings.quick_stop_deceleration / (scale or self._step))
        unit = f"counts of {scale:.4g}" if scale else "counts/s^2"
        if not 1 <= counts < 2**32:
            raise DriveError(
                f"quick_stop_deceleration = {self._settings.quick_stop_deceleration:g} is {counts}"
                f" {unit}; must lie in [1, {2**32 - 1}] (0x6085); change it, or the drive's unit of"
                " acceleration and deceleration_scale"
            )
        offered = self.write(counts, cia402.QUICK_STOP_DECELERATION, optional=True)
        self.reported["quick stop ramp (0x6085)"] = f"{counts} {unit}" if offered else NOT_OFFERED
        for index, (name, _) in cia402.OPTIONS.items():
            code = self.offered(index)
            self.reported[name] = NOT_OFFERED if code is None else cia402.option(index, code)

    def _set_mode(self) -> None:
        modes = self.offered(cia402.SUPPORTED_MODES)
        if modes is not None and not modes & cia402.CYCLIC_SYNCHRONOUS_TORQUE_BIT:
            raise DriveError(
                f"node {self._settings.node} does not offer cyclic synchronous torque mode (0x6502 ="
                f" 0x{modes:08X});"
                " it must be enabled in the drive, or another drive be used"
            )
        self.write(cia402.CYCLIC_SYNCHRONOUS_TORQUE, cia402.MODE)
        deadline = self._now() + _MODE_TIME
        while (mode := self.read(cia402.MODE_DISPLAY)) != cia402.CYCLIC_SYNCHRONOUS_TORQUE:
            if self._now() > deadline:
                raise DriveError(
                    f"node {self._settings.node}: mode of operation stays {mode} (0x6061); must become"
                    f" {cia402.CYCLIC_SYNCHRONOUS_TORQUE} (cyclic synchronous torque); is another mode forced"
                    " in"
                    " the drive's own set-up?"
                )
        self.reported["mode of operation"] = "cyclic synchronous torque (10)"


def _milliseconds(seconds: float) -> int:
    return 0 if seconds == 0.0 else max(1, round(seconds * 1e3))
