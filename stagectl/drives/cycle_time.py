"""How long one cycle takes on a bus or a serial line: what a control period must leave room for.

A cycle of a CANopen drive is SYNC, the drive's answer and the command, one after the other.  A CAN adapter on a serial
line (slcan, the text protocol of Lawicel) sends a standard frame of n bytes as ``tIIILDD..DD<CR>``: 6 + 2 n characters.
A cycle of an ODrive is question, answer and command, and now and then the question for its state, as lines of text.
"""

CHARACTER_BITS = 10  # of a character on a serial line: start, eight, stop
CYCLE = (0, 8, 8)  # data bytes of SYNC, answer and command
_BESIDE = (1, 8, 8)  # of a heartbeat, and of a question by SDO and its answer
SLCAN_DEFAULT_BAUD = 115200.0  # bit/s where the channel names none, as python-can has it
_ACKNOWLEDGED = 2  # characters by which an slcan adapter acknowledges a frame of ours, "z<CR>"
SLCAN_CHARACTERS = sum(6 + 2 * length for length in CYCLE) + 2 * _ACKNOWLEDGED  # of one cycle
# Characters at most: "c 0 ...", "turns turns/s", "f 0", and the state both ways.
ODRIVE_COMMAND, ODRIVE_ANSWER, ODRIVE_REQUEST, ODRIVE_STATE = 17, 32, 4, 26
ODRIVE_CHARACTERS = ODRIVE_COMMAND + ODRIVE_ANSWER + ODRIVE_REQUEST + ODRIVE_STATE  # of the longest cycle


def frame_bits(length: int) -> int:
    """Longest a standard data frame with `length` bytes can be on the wire, with all stuff bits (bit).

    Source: R. I. Davis et al., Controller Area Network (CAN) schedulability analysis, Real-Time Systems 2007.
    """
    stuffed = 34 + 8 * length  # the bits that are subject to stuffing: one more per four, after the first
    return stuffed + 13 + (stuffed - 1) // 4


def bus_load(rate_hz: float, bitrate: float, lengths: tuple[int, ...] = CYCLE) -> float:
    """Share of the bus taken by frames of these data `lengths`, each sent `rate_hz` times a second."""
    return rate_hz * sum(frame_bits(length) for length in lengths) / bitrate


def has_room_for_sdo(dt: float, bitrate: float) -> bool:
    """Whether a heartbeat, a question by SDO and its answer fit into a period of `dt` (s) beside the cycle."""
    return bus_load(1.0 / dt, bitrate, CYCLE + _BESIDE) <= 1.0


def slcan_baud(channel: str) -> float:
    """Baud rate in a channel such as ``/dev/ttyUSB0@3000000``; 0 where the text behind ``@`` is not a number."""
    _, at, text = channel.partition("@")
    if not at:
        return SLCAN_DEFAULT_BAUD
    return float(text) if text.isascii() and text.isdigit() else 0.0


def slcan_cycle(baud: float, bitrate: float) -> float:
    """Time (s) of one cycle through an slcan adapter: the line's and the bus's, one after the other."""
    return SLCAN_CHARACTERS * CHARACTER_BITS / baud + sum(frame_bits(length) for length in CYCLE) / bitrate


def odrive_cycle(baud: float) -> float:
    """Time (s) of the longest cycle of an ODrive on its line."""
    return ODRIVE_CHARACTERS * CHARACTER_BITS / baud
