"""The drive protocol: what the loop requires of a drive, whatever the wire.

One control period, as every drive sees it::

      t_k                                             t_k+1
       |--- sample() ---> law ---> apply(i_k) ----------|--- sample() ...
       |    latches position        the drive holds i_k |    from t_k+1 on it acts (nd = 1)

`sample` and `apply` never raise: `Feedback.fault` holds the failure, and the loop's safety alone decides.
"""

import enum
import math
from typing import Annotated, Literal, NamedTuple, Protocol

from stagectl.units import Quantity, StageError


class DriveError(StageError):
    """A drive that cannot be reached, configured or enabled; the message names the next step.

    `place` is the parameter, file, port or interface at fault, `node` the CANopen node id, `object_key` the object
    (index << 8 | subindex), `abort_code` that of the SDO transfer (CiA 301) and `value` what was read there, in the
    unit of the place or object.  None or empty: the error has none.
    """

    def __init__(
        self,
        message: str,
        *,
        place: str = "",
        node: int | None = None,
        object_key: int | None = None,
        abort_code: int | None = None,
        value: float | str | None = None,
    ) -> None:
        super().__init__(message)
        self.place, self.node, self.object_key = place, node, object_key
        self.abort_code, self.value = abort_code, value


class Fault(enum.IntEnum):
    """Why the loop must stop, as one number that fits a recording's column."""

    NONE = 0
    FEEDBACK_LOST = 1  # no answer within the time-out
    DRIVE_FAULT = 2  # the drive reports a fault or left Operation enabled by itself
    EMERGENCY = 3  # EMCY frame (CiA 301)
    BUS = 4  # the bus itself failed
    REBOOTED = 5  # the drive's boot-up message in mid operation (CiA 301): its power or its firmware failed
    FOLLOWING_ERROR = 10  # the loop's own reasons, from here on
    TRAVEL = 11
    SPEED = 12
    LATE = 13
    OPERATOR = 14
    BRAKING = 15  # braking now no longer ends within the travel
    CURRENT = 16  # measured beyond what the drive may give
    OVERLOAD = 17  # I2t
    JUMP = 19  # of the encoder
    FREEZE = 20  # of the encoder, or an axis that is blocked
    STARVED = 21  # the setpoints ran out in mid motion
    UNATTENDED = 22  # the process that gives the orders is gone
    HOMING = 23  # no home within the distance it may take
    PARTNER = 24  # another axis of the group has stopped
    CLAMPED = 25  # the drive gives another current than it is told


class Feedback(NamedTuple):
    """What a drive reported in this cycle, in SI units of the axis."""

    position: float  # rad | m, at the instant of the latch
    current: float  # A, measured by the drive; NaN where it reports none
    statusword: int  # CiA 402 statusword; other drives map theirs onto it
    fault: Fault
    busy: bool = False  # the drive still looks for its home, see Power.HOME


class Power(enum.Enum):
    """The power state that a drive is brought to, period by period, while its cycle continues."""

    ON = "Operation enabled at zero current"
    QUICK_STOP = "stopped by its own ramp"
    ENGAGE = "Operation enabled until the brake holds, then no voltage"
    HOME = "looks for its home by itself, then as ON"
    OFF = "no voltage"


class Drive(Protocol):
    """A servo drive in current mode."""

    def sample(self) -> Feedback:
        """Latch position and current now; the drive starts to act on the last `apply`."""

    def apply(self, current: float) -> None:
        """Hand over the current command (A, positive current moves the axis to positive positions)."""

    def ask(self, power: Power) -> None:
        """Bring the drive to `power` with the periods that follow; `sample` and `apply` go on meanwhile.

        Power.ON is reached when `sample` reports no fault; a drive in Fault stays there, see `reset_fault`.
        """

    def position(self) -> float:
        """Where the axis stands (rad | m) as the drive counts, before the first cycle; NaN: it does not say."""

    def pending_fault(self) -> str:
        """The fault that a person must reset before the drive gets power, in words; empty where there is none."""

    def reset_fault(self) -> None:
        """Reset the drive's fault, without power; it takes its time, and no period passes meanwhile.

        Raises DriveError where the fault stays.
        """

    def describe(self) -> dict[str, str]:
        """Identity, option codes in words and scales, as read back from the drive (for the recording)."""

    def explain(self) -> str:
        """The last fault in words: what the drive reported, the probable causes, the next command."""

    def close(self) -> None:
        """Disable the power stage and leave the wire; safe to call twice."""


_U32 = Quantity("", "[0, 4294967295]", "as the drive must report it; absent: any")

Accepted = Literal[
    "no_supervision", "no_reaction", "nmt_reaction", "output_brake", "inverted_polarity", "encoder_resolution"
]
ACCEPTED: dict[str, str] = {
    "no_supervision": "the drive does not notice the loss of its controller: the axis goes on at its last current",
    "no_reaction": "the drive notices the loss of its controller and goes on: nothing stops the axis",
    "nmt_reaction": "the drive only leaves NMT operational when its controller is lost (0x1029): try whether it stops",
    "output_brake": "nobody sets the brake when the controller is lost, and the drive does not hold the axis: it drops",
    "inverted_polarity": "the drive inverts position, velocity or torque (0x607E): check the sign of the loop",
    "encoder_resolution": "the drive's encoder (0x608F) is another than the stage file's: distances may be wrong",
}


class Identity(NamedTuple):
    """Identity object 0x1018, as CiA 302 compares it when a drive boots: a drive that was exchanged is refused."""

    vendor: Annotated[int | None, _U32] = None
    product: Annotated[int | None, _U32] = None
    revision: Annotated[int | None, _U32] = None
    serial: Annotated[int | None, _U32] = None


class StartUp(NamedTuple):
    """An object that is written at each set-up, and must then hold its value."""

    object: Annotated[int, "index_subindex, such as 0x6065_00"]
    value: Annotated[int, "in the drive's unit"]


class Canopen(NamedTuple):
    """A CiA 402 drive in cyclic synchronous torque mode over CAN."""

    eds: Annotated[str, "EDS or DCF file, relative to the stage file (or to the config folder of the checkout)"]
    node: Annotated[int, Quantity("", "[1, 126]", "CANopen node id of the drive")]
    rated_current: Annotated[float, Quantity("A", "(0, 1000]", "rated current of the drive, which is 1000 per mille")]
    command_scale: Annotated[float, Quantity("A", "(0, 10]", "current of one count of the command object")]
    current_scale: Annotated[float, Quantity("A", "(0, 10]", "current of one count of the current object")]
    quick_stop_deceleration: Annotated[
        float, Quantity("rad/s^2 | m/s^2", "(0, 1e7]", "ramp of the drive's own stop (0x6085)")
    ]
    interface: Annotated[str, "embedded, socketcan, slcan, socketcand; others are passed on to python-can"] = "embedded"
    channel: Annotated[str, "can0; of socketcand can0@HOST:PORT; on the embedded bus a name or a folder"] = "stage"
    bitrate: Annotated[float, Quantity("bit/s", "[10e3, 1e6]", "bit rate of the bus")] = 1e6
    rpdo: Annotated[tuple[int, ...], "objects the drive receives each cycle, index_subindex"] = (0x604000, 0x607100)
    tpdo: Annotated[tuple[int, ...], "objects the drive sends each cycle, index_subindex"] = (
        0x604100,
        0x606400,
        0x607700,
    )
    command_object: Annotated[int, "object that takes the current command, index_subindex"] = 0x607100
    current_object: Annotated[int, "object with the measured current, index_subindex; 0: none"] = 0x607700
    heartbeat: Annotated[float, Quantity("s", "[0.001, 10]", "period of both heartbeats")] = 0.02
    heartbeat_timeout: Annotated[float, Quantity("s", "[0.002, 60]", "silence after which a partner is lost")] = 0.1
    rpdo_timeout: Annotated[
        float,
        Quantity("s", "[0, 60]", "silence of the RPDO that stops the drive; 0: off; absent: from limits.free_distance"),
    ] = math.nan
    feedback_timeout: Annotated[
        float, Quantity("s", "(0, 60]", "longest wait for the answer to SYNC; absent: 4 control periods")
    ] = math.nan
    reset: Annotated[Literal["none", "communication", "node"], "reset of the drive when we connect (NMT)"] = "none"
    bus_load_limit: Annotated[float, Quantity("", "(0, 1]", "share of the bus that the cycle may take")] = 0.8
    watched_bits: Annotated[
        tuple[int, ...] | None,
        "statusword bits that must stay set under power, by number; absent: 9 and 12 where the drive shows them",
    ] = None
    deceleration_scale: Annotated[
        float,
        Quantity("rad/s^2 | m/s^2", "[0, 1e6]", "one count of the ramps 0x6085, 0x609A; 0: a count a second squared"),
    ] = 0.0
    velocity_scale: Annotated[
        float,
        Quantity("rad/s | m/s", "[0, 1e6]", "one count of the homing speeds 0x6099; 0: an encoder count a second"),
    ] = 0.0
    boot_time: Annotated[float, Quantity("s", "[0.1, 120]", "longest time from power or reset to an answer")] = 10.0
    identity: Identity = Identity()
    accept: Annotated[tuple[Accepted, ...], "what the drive lacks for safety and a person accepts, by name"] = ()
    start_up: Annotated[tuple[StartUp, ...], "further objects that are written at each set-up"] = ()


class Offered(NamedTuple):
    """A CAN interface that socketcand offers on another computer: its name there, and where the server is."""

    channel: str
    host: str
    port: int


def offered(text: str) -> Offered | None:
    """What a channel such as ``can0@192.168.1.2:29536`` names; None where it is none of this kind."""
    channel, _, address = text.partition("@")
    host, _, port = address.rpartition(":")
    if not (channel and host and port.isascii() and port.isdigit() and 0 < int(port) <= 65535):
        return None
    return Offered(channel, host, int(port))


def accepted(wire: Canopen) -> list[str]:
    """What the drive lacks for safety and the stage file accepts, each with its consequence; said at every start."""
    return [f"accepted by the stage file: {name}: {ACCEPTED[name]}" for name in wire.accept]


class Odrive(NamedTuple):
    """An ODrive in torque mode over its ASCII protocol, on a serial line or USB."""

    port: Annotated[str, "serial port, such as /dev/ttyACM0; a virtual drive makes it"]
    torque_constant: Annotated[
        float, Quantity("N m/A", "(0, 1e3]", "torque constant in the drive's own motor configuration")
    ]
    baud: Annotated[float, Quantity("bit/s", "[9600, 12e6]", "baud rate of the line; USB runs at its own speed")] = (
        115200.0
    )
    axis: Annotated[int, Quantity("", "[0, 1]", "number of the axis in the drive")] = 0
    watchdog: Annotated[float, Quantity("s", "(0, 10]", "silence after which the drive stops")] = 0.1
    feedback_timeout: Annotated[float, Quantity("s", "(0, 60]", "longest wait for an answer")] = 0.05
    line_load_limit: Annotated[float, Quantity("", "(0, 1]", "share of a period that the line may take")] = 0.8


class Simulation(NamedTuple):
    """How the stage model is run in place of a machine."""

    substeps: Annotated[int, Quantity("", "[1, 10000]", "number of integration steps per control period")] = 10
    current_noise: Annotated[
        float, Quantity("A", "[0, 100]", "rms noise of the motor current, drawn once a period")
    ] = 0.0
    encoder_noise: Annotated[float, Quantity("rad | m", "[0, 1]", "rms noise before the encoder rounds")] = 0.0
    seed: Annotated[int, Quantity("", "[0, 2147483647]", "seed of that noise")] = 1
    clock: Annotated[
        Literal["sync", "wall"], "clock of a virtual drive's plant: Ts at each SYNC, or the wall clock"
    ] = "sync"
