"""Tables of CiA 402 (IEC 61800-7-201) and CiA 301, as far as cyclic synchronous torque mode needs them.

::

    NOT READY -> SWITCH ON DISABLED <--2/7--> READY <--3/6--> SWITCHED ON <--4/5--> OPERATION ENABLED
                    ^         ^                                                         | 11
                    | 15      `---------------- 12 ---------- QUICK STOP ACTIVE <-------'
                  FAULT <--14-- FAULT REACTION ACTIVE <--13-- (any)
"""

import enum
from collections.abc import Iterable
from typing import TypeVar

_Member = TypeVar("_Member", bound=enum.Enum)

# objects of CiA 301
DEVICE_TYPE, ERROR_REGISTER, ERROR_HISTORY, SYNC_COB_ID, SYNC_COUNTER = 0x1000, 0x1001, 0x1003, 0x1005, 0x1019
CYCLE_PERIOD, GUARD_TIME, LIFE_TIME_FACTOR, ERROR_BEHAVIOUR = 0x1006, 0x100C, 0x100D, 0x1029
DEVICE_NAME, HARDWARE_VERSION, SOFTWARE_VERSION = 0x1008, 0x1009, 0x100A
TEXTS = {DEVICE_NAME: "device name", HARDWARE_VERSION: "hardware version", SOFTWARE_VERSION: "software version"}
CONSUMER_HEARTBEAT, PRODUCER_HEARTBEAT, IDENTITY = 0x1016, 0x1017, 0x1018
RPDO_PARAMETER, RPDO_MAPPING, TPDO_PARAMETER, TPDO_MAPPING = 0x1400, 0x1600, 0x1800, 0x1A00

# objects of CiA 402
ABORT_CONNECTION, ERROR_CODE, CONTROLWORD, STATUSWORD = 0x6007, 0x603F, 0x6040, 0x6041
QUICK_STOP_OPTION, SHUTDOWN_OPTION, DISABLE_OPTION, FAULT_REACTION = 0x605A, 0x605B, 0x605C, 0x605E
MODE, MODE_DISPLAY, SUPPORTED_MODES = 0x6060, 0x6061, 0x6502
POSITION, VELOCITY, TARGET_TORQUE, ACTUAL_TORQUE = 0x6064, 0x606C, 0x6071, 0x6077
RATED_CURRENT, QUICK_STOP_DECELERATION = 0x6075, 0x6085
FOLLOWING_WINDOW, MAX_TORQUE, MAX_CURRENT, POLARITY = 0x6065, 0x6072, 0x6073, 0x607E
MAX_SPEED, TORQUE_SLOPE, ENCODER, GEAR, FEED = 0x6080, 0x6087, 0x608F, 0x6091, 0x6092
INTERPOLATION_PERIOD, TORQUE_LIMITS = 0x60C2, (0x60E0, 0x60E1)  # the latter to positive and negative

REMOTE, LIMITED, FOLLOWS = 1 << 9, 1 << 11, 1 << 12  # statusword: remote, internal limit active, follows the command
DIGITAL_OUTPUTS, BRAKE_BIT = 0x60FE, 1  # subindex 1: the outputs, whose bit 0 sets the brake; 2: their mask

PROFILE, SERVO_DRIVE = 402, 0x0002_0000  # low word of 0x1000; its bit for a servo drive
CYCLIC_SYNCHRONOUS_TORQUE, HOMING = 10, 6  # modes of operation
CYCLIC_SYNCHRONOUS_TORQUE_BIT, HOMING_BIT = 1 << 9, 1 << 5  # in 0x6502
HOME_OFFSET, HOMING_METHOD, HOMING_SPEEDS, HOMING_ACCELERATION = 0x607C, 0x6098, 0x6099, 0x609A
HOMING_START = 1 << 4  # controlword in mode 6
TARGET_REACHED, HOMING_ATTAINED, HOMING_ERROR = 1 << 10, 1 << 12, 1 << 13  # statusword in mode 6
TORQUE_PERMILLE = 1e-3  # 0x6071 and 0x6077 count thousandths of the rated value

# NMT (CiA 301): commands and the states that a heartbeat carries
NMT_START, NMT_PRE_OPERATIONAL = 0x01, 0x80
NMT_RESETS = {"node": 0x81, "communication": 0x82}
INITIALISING, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
NMT_WORDS = {
    INITIALISING: "initialising",
    STOPPED: "stopped",
    OPERATIONAL: "operational",
    PRE_OPERATIONAL: "pre-operational",
}


class DriveState(enum.Enum):
    """States of the power drive system; the value is their statusword (mask, bits)."""

    NOT_READY = (0x4F, 0x00)
    SWITCH_ON_DISABLED = (0x4F, 0x40)
    READY = (0x6F, 0x21)
    SWITCHED_ON = (0x6F, 0x23)
    OPERATION_ENABLED = (0x6F, 0x27)
    QUICK_STOP_ACTIVE = (0x6F, 0x07)
    FAULT_REACTION_ACTIVE = (0x4F, 0x0F)
    FAULT = (0x4F, 0x08)

    @property
    def words(self) -> str:
        """Name as the standard writes it."""
        names = {DriveState.NOT_READY: "Not ready to switch on", DriveState.READY: "Ready to switch on"}
        return names.get(self, self.name.replace("_", " ").capitalize())


RAMPS = (DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION_ACTIVE)  # the drive brakes by itself
POWERED = (DriveState.OPERATION_ENABLED, *RAMPS)


class DeviceCommand(enum.Enum):
    """Device control commands; the value is their controlword (mask, bits)."""

    SHUTDOWN = (0x87, 0x06)
    SWITCH_ON = (0x8F, 0x07)  # "disable operation" where operation is enabled
    ENABLE_OPERATION = (0x8F, 0x0F)
    DISABLE_VOLTAGE = (0x82, 0x00)
    QUICK_STOP = (0x86, 0x02)
    FAULT_RESET = (0x80, 0x80)  # on its rising edge

    @property
    def controlword(self) -> int:
        """The controlword that gives this command and nothing else."""
        return self.value[1]


# Commands and where they lead from each state; the numbers are the standard's transitions.
TRANSITIONS: dict[tuple[DriveState, DeviceCommand], DriveState] = {
    (DriveState.SWITCH_ON_DISABLED, DeviceCommand.SHUTDOWN): DriveState.READY,  # 2
    (DriveState.READY, DeviceCommand.SWITCH_ON): DriveState.SWITCHED_ON,  # 3
    (DriveState.READY, DeviceCommand.ENABLE_OPERATION): DriveState.SWITCHED_ON,  # 3, and 4 with the next controlword
    (DriveState.SWITCHED_ON, DeviceCommand.ENABLE_OPERATION): DriveState.OPERATION_ENABLED,  # 4
    (DriveState.OPERATION_ENABLED, DeviceCommand.SWITCH_ON): DriveState.SWITCHED_ON,  # 5
    (DriveState.SWITCHED_ON, DeviceCommand.SHUTDOWN): DriveState.READY,  # 6
    (DriveState.READY, DeviceCommand.QUICK_STOP): DriveState.SWITCH_ON_DISABLED,  # 7
    (DriveState.READY, DeviceCommand.DISABLE_VOLTAGE): DriveState.SWITCH_ON_DISABLED,  # 7
    (DriveState.OPERATION_ENABLED, DeviceCommand.SHUTDOWN): DriveState.READY,  # 8
    (DriveState.OPERATION_ENABLED, DeviceCommand.DISABLE_VOLTAGE): DriveState.SWITCH_ON_DISABLED,  # 9
    (DriveState.SWITCHED_ON, DeviceCommand.QUICK_STOP): DriveState.SWITCH_ON_DISABLED,  # 10
    (DriveState.SWITCHED_ON, DeviceCommand.DISABLE_VOLTAGE): DriveState.SWITCH_ON_DISABLED,  # 10
    (DriveState.OPERATION_ENABLED, DeviceCommand.QUICK_STOP): DriveState.QUICK_STOP_ACTIVE,  # 11
    (DriveState.QUICK_STOP_ACTIVE, DeviceCommand.DISABLE_VOLTAGE): DriveState.SWITCH_ON_DISABLED,  # 12
    (DriveState.FAULT, DeviceCommand.FAULT_RESET): DriveState.SWITCH_ON_DISABLED,  # 15
    # 16: options 5 to 8
    (DriveState.QUICK_STOP_ACTIVE, DeviceCommand.ENABLE_OPERATION): DriveState.OPERATION_ENABLED,
}

# What a master sends in each state to come nearer to Operation enabled.
TOWARDS_ENABLED: dict[DriveState, DeviceCommand] = {
    DriveState.NOT_READY: DeviceCommand.DISABLE_VOLTAGE,
    DriveState.SWITCH_ON_DISABLED: DeviceCommand.SHUTDOWN,
    DriveState.READY: DeviceCommand.SWITCH_ON,
    DriveState.SWITCHED_ON: DeviceCommand.ENABLE_OPERATION,
    DriveState.OPERATION_ENABLED: DeviceCommand.ENABLE_OPERATION,
    DriveState.QUICK_STOP_ACTIVE: DeviceCommand.QUICK_STOP,  # until it stands; then Disable voltage
    DriveState.FAULT_REACTION_ACTIVE: DeviceCommand.DISABLE_VOLTAGE,
    DriveState.FAULT: DeviceCommand.FAULT_RESET,  # by a person's order alone
}

_COASTS = {0: "power off, the axis coasts"}
_SLOWS = {1: "slow down ramp", 2: "quick stop ramp", 3: "current limit", 4: "voltage limit"}
_SLOWS_THEN_OFF = _COASTS | {1: "slow down on the slow down ramp, then power off"}
BRAKING = (2, 3, 4, 6, 7, 8)  # options 0x605A and 0x605E that slow down on the quick stop ramp (0x6085), or sooner
OPTIONS: dict[int, tuple[str, dict[int, str]]] = {
    QUICK_STOP_OPTION: (
        "quick stop option (0x605A)",
        _COASTS
        | {n: f"slow down on the {how}, then Switch on disabled" for n, how in _SLOWS.items()}
        | {n + 4: f"slow down on the {how} and stay in Quick stop active" for n, how in _SLOWS.items()},
    ),
    SHUTDOWN_OPTION: ("shutdown option (0x605B)", _SLOWS_THEN_OFF),
    DISABLE_OPTION: ("disable operation option (0x605C)", _SLOWS_THEN_OFF),
    FAULT_REACTION: (
        "fault reaction option (0x605E)",
        _COASTS | {n: f"slow down on the {how}" for n, how in _SLOWS.items()},
    ),
    ABORT_CONNECTION: (
        "abort connection option (0x6007)",
        {
            0: "NO ACTION: the axis goes on when the controller is lost",
            1: "fault",
            2: "power off, the axis coasts",
            3: "quick stop",
        },
    ),
}

# Emergency error codes of CiA 301 and CiA 402, the most specific mask first.
EMERGENCIES: tuple[tuple[int, int, str], ...] = (
    (0xFFFF, 0x8130, "the heartbeat of the controller is lost"),
    (0xFFFF, 0x8140, "recovered from bus off"),
    (0xFFFF, 0x8210, "a PDO was not processed: wrong length"),
    (0xFFFF, 0x8220, "a PDO is longer than its mapping"),
    (0xFFFF, 0x8240, "unexpected length of SYNC"),
    (0xFFFF, 0x8250, "the cyclic command (RPDO) is lost"),
    (0xFF00, 0x0000, "error reset, or no error"),
    (0xFF00, 0x1000, "generic error"),
    (0xFF00, 0x2100, "current on the input side of the device"),
    (0xFF00, 0x2200, "current inside the device"),
    (0xFF00, 0x2300, "current on the output side of the device: short circuit or overload of the motor"),
    (0xF000, 0x2000, "current"),
    (0xFF00, 0x3100, "mains voltage"),
    (0xFF00, 0x3200, "voltage of the DC link"),
    (0xF000, 0x3000, "voltage"),
    (0xFF00, 0x4200, "temperature of the device"),
    (0xFF00, 0x4300, "temperature of the drive"),
    (0xF000, 0x4000, "temperature"),
    (0xF000, 0x5000, "hardware of the device"),
    (0xF000, 0x6000, "software or parameters of the device"),
    (0xFF00, 0x7100, "brake or power module"),
    (0xFF80, 0x7300, "sensor or encoder"),
    (0xF000, 0x7000, "additional module"),
    (0xFF00, 0x8100, "communication"),
    (0xFF00, 0x8200, "protocol"),
    (0xFF00, 0x8300, "torque control"),
    (0xFF00, 0x8400, "velocity control"),
    (0xFFFF, 0x8611, "following error"),
    (0xFF00, 0x8600, "position control"),
    (0xF000, 0x8000, "monitoring"),
    (0xF000, 0x9000, "external error"),
    (0xFF00, 0xF000, "additional function"),
    (0xFF00, 0xFF00, "specific to this device: see its manual"),
)
HEARTBEAT_LOST, PDO_LENGTH, RPDO_LOST = 0x8130, 0x8210, 0x8250
CONTROLLER_MISSED = (HEARTBEAT_LOST, RPDO_LOST)  # emergencies by which a drive says that it misses its controller
COMMUNICATION_ERROR = 0x10  # bit of the error register 0x1001
GENERIC_ERROR = 0x01

UPLOAD_DEVICE_TYPE = b"\x40\x00\x10\x00\x00\x00\x00\x00"  # SDO: the first question to a node (0x1000)

# SDO abort codes (CiA 301) that are sent or read here.
NO_OBJECT, NOT_MAPPABLE = 0x0602_0000, 0x0604_0041
PDO_TOO_LONG, WRONG_LENGTH, NO_SUBINDEX, OUT_OF_RANGE = 0x0604_0042, 0x0607_0010, 0x0609_0011, 0x0609_0030
WRONG_STATE = 0x0800_0022


def shown(key: int) -> str:
    """An object, index << 8 | subindex, as manuals write it: ``0x6040:00``."""
    return f"0x{key >> 8:04X}:{key & 0xFF:02X}"


def state(statusword: int) -> DriveState:
    """State in a statusword; Not ready to switch on where it holds none of the standard's states."""
    return _STATES[statusword & 0x6F]


def command(controlword: int) -> DeviceCommand | None:
    """Command in a controlword, None where it holds none; fault reset, an edge of bit 7, is not among them."""
    return None if controlword & 0x80 else _COMMANDS[controlword & 0x0F]


def option(index: int, value: int) -> str:
    """An option code in words; negative codes are the vendor's own."""
    known = OPTIONS[index][1]
    if value in known:
        return known[value]
    return f"{value}: specific to the vendor, see the drive's manual" if value < 0 else f"{value}: reserved"


def emergency(code: int) -> str:
    """Class of an emergency error code in words."""
    return next((words for mask, bits, words in EMERGENCIES if code & mask == bits), "unknown class")


def _matching(members: Iterable[_Member], bits: int) -> _Member | None:
    """The first whose value (mask, bits) fits."""
    return next((member for member in members if bits & member.value[0] == member.value[1]), None)


_STATES = [_matching(DriveState, bits) or DriveState.NOT_READY for bits in range(0x70)]
_LEVELS = [command for command in DeviceCommand if command is not DeviceCommand.FAULT_RESET]
_COMMANDS = [_matching(_LEVELS, bits) for bits in range(0x10)]
