"""Set-up of a CiA 402 drive over SDO, in pre-operational; what it is and does, in words.

Every value is compared first, written where it differs, read back, and read once more after NMT start.  A drive that
boots in between is set up again.  Objects that drives may lack are described as not offered; anything else that is
missing or refused, and anything that protects the axis, is an error which names the object.
"""

from stagectl.drives.brake import NO_BRAKE, Brake
from stagectl.drives.bus.frames import Bus
from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.boot_up import BootUp, take_power
from stagectl.drives.canopen.network import PumpedNode, check_profile, load_eds
from stagectl.drives.canopen.object_access import ObjectAccess, SetupInterruptedError
from stagectl.drives.canopen.object_rules import Wishes, check_start_up, obey
from stagectl.drives.canopen.pdo import RPDO, TPDO, CommandPdo, FeedbackPdo, PdoMap, wished
from stagectl.drives.canopen.pdo_setup import PdoSetup
from stagectl.drives.canopen.protection import NOT_OFFERED, Protection, Supervision, milliseconds
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import DriveError, Identity
from stagectl.drives.limits import MODE_TIME, ROUNDED, SETUPS

_SHOWN = {"serial": "serial number"}


class DriveConfiguration:
    """The set-up."""

    rpdo: PdoMap  # as read back
    tpdo: PdoMap
    protection: Protection
    mode_shown = False  # as cyclic synchronous torque, before it has power

    def __init__(self, wishes: Wishes, bus: Bus, brake: Brake = NO_BRAKE, clock: Clock = WALL) -> None:
        """The drive on `bus`, by these `wishes`.  Raises DriveError."""
        self._wishes, self._settings, self._brake, self._clock = wishes, wishes.settings, brake, clock
        od = load_eds(self._settings.eds, self._settings.node)
        self._node = PumpedNode(self._settings.node, od, bus, clock)
        self._wished = [wished(self._settings, od, way) for way in (RPDO, TPDO)]  # refused before the drive is asked
        self.objects = ObjectAccess(self._settings, self._node)
        self.description = self.objects.description

    @property
    def pdos(self) -> tuple[CommandPdo, FeedbackPdo]:
        """Both PDOs of the cycle, compiled from what was read back."""
        s, od = self._settings, self._node.object_dictionary
        return CommandPdo(s, od, self.rpdo), FeedbackPdo(s, od, self.tpdo)

    def run(self) -> None:
        """Configure the drive and start its PDOs.  Raises DriveError."""
        try:
            self._insist()
        except OSError as error:
            s = self._settings
            raise DriveError(
                f"the bus {s.interface} {s.channel} failed while node {s.node} was being configured: {error};"
                " see 'ip -details link', bring it up, then start again",
                place=s.channel,
                node=s.node,
            ) from error
        finally:
            self.objects.close()

    def _insist(self) -> None:
        """Set up, and again where the drive boots meanwhile; the last reason is raised."""
        for left in reversed(range(SETUPS)):
            try:
                self.description.clear()
                self._configure()
                return
            except SetupInterruptedError as error:
                if not left:
                    raise DriveError(
                        f"{error}. The set-up was tried {SETUPS} times",
                        node=error.node,
                        object_key=error.object_key,
                        value=error.value,
                    ) from error

    def _configure(self) -> None:
        objects, s = self.objects, self._settings
        kind, boot = BootUp(objects).run(self._take_power)
        check_profile(kind, s.node)
        servo = "servo drive" if kind & cia402.SERVO_DRIVE else "not marked as servo drive"
        self.description["device type"] = f"0x{kind:08X}: CiA 402, {servo}"
        self.description["boot-up message"] = boot
        identify(objects)
        self._take_power()
        self._check_rated_current()
        self._check_mode()
        self.rpdo = PdoSetup(objects, RPDO).run(self._wished[0], milliseconds(s.rpdo_timeout))
        self.tpdo = PdoSetup(objects, TPDO).run(self._wished[1])
        self._describe_maps()
        obey(objects, self._wishes)
        self._set_ramp()
        self.protection = Supervision(objects, self._wishes.limits).run(self.rpdo)
        check_start_up(objects, s)
        self._describe_options()
        self._set_mode()
        self._node.nmt.send_command(cia402.NMT_START)
        objects.verify()

    def _take_power(self) -> None:
        take_power(self.objects, self._brake)

    def _check_rated_current(self) -> None:
        s = self._settings
        rated = self.objects.offered(cia402.RATED_CURRENT)
        self.description["rated current (0x6075)"] = NOT_OFFERED if rated is None else f"{rated * 1e-3:g} A"
        permille = s.command_object >> 8 == cia402.TARGET_TORQUE
        if permille and rated is not None and round(s.rated_current * 1e3) != rated:
            raise DriveError(
                f"rated_current = {s.rated_current:g} A, but node {s.node} reports {rated * 1e-3:g} A (0x6075), and its"
                f" command counts per mille of it; set 'rated_current: {rated * 1e-3:g} A' or parametrise the drive",
                place="rated_current",
                node=s.node,
                object_key=cia402.RATED_CURRENT << 8,
                value=rated * 1e-3,
            )
        self.description["current command"] = f"0x{s.command_object:06X}, {s.command_scale:g} A a count"
        measured = f"0x{s.current_object:06X}, {s.current_scale:g} A a count" if s.current_object else "none"
        self.description["measured current"] = measured

    def _describe_maps(self) -> None:
        for name, pdo in (("RPDO", self.rpdo), ("TPDO", self.tpdo)):
            listed = ", ".join(map(cia402.shown, pdo.objects))
            when = "at every SYNC" if pdo.transmission == 1 else f"transmission type {pdo.transmission}"
            self.description[name] = f"{pdo.number + 1}, identifier 0x{pdo.identifier:03X}, {when}: {listed}"

    def _set_ramp(self) -> None:
        scale, step = self._settings.deceleration_scale, self._wishes.encoder_step
        counts = round(self._settings.quick_stop_deceleration / (scale or step))
        unit = f"counts of {scale:.4g}" if scale else "counts/s^2"
        if not 1 <= counts < 2**32:
            raise DriveError(
                f"quick_stop_deceleration = {self._settings.quick_stop_deceleration:g} is {counts}"
                f" {unit}; must lie in [1, {2**32 - 1}] (0x6085); change it, or the drive's unit of"
                " acceleration and deceleration_scale",
                place="quick_stop_deceleration",
                value=self._settings.quick_stop_deceleration,
            )
        held = self.objects.hold(
            counts, cia402.QUICK_STOP_DECELERATION, 0, lambda value: abs(value - counts) <= ROUNDED * counts
        )
        if held.value is not None and not held.fits:
            raise self.objects.error(
                f": its stop ramp (0x6085) is {held.value} {unit} and does not become {counts};"
                f" set quick_stop_deceleration to {held.value * (scale or step):g}, or the ramp in the drive",
                cia402.QUICK_STOP_DECELERATION << 8,
                held.value,
                "quick_stop_deceleration",
            ) from held.refusal
        self.description["quick stop ramp (0x6085)"] = NOT_OFFERED if held.value is None else f"{held.value} {unit}"

    def _describe_options(self) -> None:
        for index, (name, _) in cia402.OPTIONS.items():
            if name not in self.description:
                code = self.objects.offered(index)
                self.description[name] = NOT_OFFERED if code is None else cia402.option(index, code)

    def _check_mode(self) -> None:
        modes = self.objects.offered(cia402.SUPPORTED_MODES)
        wanted = {cia402.CYCLIC_SYNCHRONOUS_TORQUE_BIT: "cyclic synchronous torque mode", cia402.HOMING_BIT: "homing"}
        for bit, words in list(wanted.items())[: 1 + self._wishes.homing.by_drive]:
            if modes is not None and not modes & bit:
                raise self.objects.error(
                    f" does not offer {words} (0x6502 = 0x{modes:08X}); enable it in the drive, or use another drive",
                    cia402.SUPPORTED_MODES << 8,
                    modes,
                )

    def _set_mode(self) -> None:
        """Ask for the mode; a drive that shows it only once it is enabled is watched from then on."""
        torque = cia402.CYCLIC_SYNCHRONOUS_TORQUE
        held = self.objects.hold(torque, cia402.MODE)
        if held.refusal is not None:
            raise held.refusal
        if held.value is not None and not held.fits:
            raise self.objects.error(
                f": mode of operation stays {held.value} (0x6060); must become {torque} (cyclic synchronous torque); is"
                " another mode forced in the drive's own set-up?",
                cia402.MODE << 8,
                held.value,
            )
        deadline = self._clock.now() + MODE_TIME
        while (mode := self.objects.read(cia402.MODE_DISPLAY)) != torque and self._clock.now() < deadline:
            pass
        self.mode_shown = mode == torque
        shown = "" if self.mode_shown else f"; 0x6061 shows {mode} until it is enabled"
        self.description["mode of operation"] = f"cyclic synchronous torque (10){shown}"


def identify(objects: ObjectAccess) -> None:
    """Describe the drive; compare it with the stage file and the EDS as CiA 302 does when a network boots.

    Raises DriveError where it is another one than they say.
    """
    eds, settings = objects.node.object_dictionary.device_information, objects.settings
    written = {"vendor": eds.vendor_number, "product": eds.product_number}  # None or 0: it does not say
    for subindex, name in enumerate(Identity._fields, start=1):
        value, stated = objects.offered(cia402.IDENTITY, subindex), getattr(settings.identity, name)
        objects.description[_SHOWN.get(name, name)] = NOT_OFFERED if value is None else f"0x{value:08X}"
        if stated is not None and value != stated:
            _refuse(objects, name, subindex, value, f"drive.wire.identity.{name} = 0x{stated:08X}", "the stage file")
        wanted = written.get(name)
        if stated is None and value is not None and wanted and value != wanted:
            _refuse(objects, name, subindex, value, f"0x{wanted:08X}", f"its EDS, {settings.eds}")
    for index, name in cia402.TEXTS.items():
        objects.description[name] = str(objects.offered(index) or NOT_OFFERED)


def _refuse(objects: ObjectAccess, name: str, subindex: int, value: int | None, wanted: str, source: str) -> None:
    shown = "not reported" if value is None else f"0x{value:08X}"
    raise objects.error(
        f": {name} (0x1018:{subindex:02X}) is {shown}; {source} says {wanted}. Probable cause: another drive"
        f" stands in its place. Check its settings; then state drive.wire.identity.{name}: {shown}",
        cia402.IDENTITY << 8 | subindex,
        value,
        f"drive.wire.identity.{name}",
    )
