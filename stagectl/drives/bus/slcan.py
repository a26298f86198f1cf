"""What a CAN adapter on a serial line (slcan, the text protocol of Lawicel) can carry, and what it cannot.

A standard frame of n bytes is ``tIIILDD..DD<CR>``: 6 + 2 n characters, each ten bits on the line.  One cycle needs
three of them one after the other, SYNC out, the drive's answer in, the command out; the adapter acknowledges ours.
"""

from __future__ import annotations

from stagectl.drives.bus.frames import frame_bits
from stagectl.drives.drive import Canopen

BAUD = 115200.0  # bit/s where the channel names none, as python-can has it
_BITS = 10  # of a character: start, eight, stop
_ACKNOWLEDGED = 2  # characters, "z<CR>"


def baud(channel: str) -> float:
    """Baud rate in a channel such as ``/dev/ttyUSB0@3000000``; 0 where the text after @ is no number."""
    _, at, text = channel.partition("@")
    if not at:
        return BAUD
    return float(text) if text.isascii() and text.isdigit() else 0.0


def characters(length: int) -> int:
    """Characters of a standard data frame with `length` bytes."""
    return 6 + 2 * length


def cycle(baud_rate: float, bitrate: float) -> float:
    """Time (s) of one cycle with two PDOs of eight bytes: the line's and the bus's, one after the other."""
    line = characters(0) + 2 * characters(8) + 2 * _ACKNOWLEDGED
    return line * _BITS / baud_rate + sum(frame_bits(length) for length in (0, 8, 8)) / bitrate


def refused(wire: Canopen, period: float) -> list[str]:
    """Why this line cannot carry a cycle every `period` (s), with figures; empty where it can, or is no line."""
    if wire.interface != "slcan":
        return []
    rate = baud(wire.channel)
    if not 9600.0 <= rate <= 12e6:
        return [f"drive.wire.channel = {wire.channel}; after @ must stand a baud rate in [9600, 12000000]"]
    takes = cycle(rate, wire.bitrate)
    if takes <= wire.bus_load_limit * period:
        return []
    length, least = characters(0) + 2 * characters(8) + 2 * _ACKNOWLEDGED, takes / wire.bus_load_limit
    return [
        f"drive.wire.channel = {wire.channel}; at {rate:g} baud SYNC, answer and command, {length} characters, take "
        f"{takes * 1e3:.3g} ms of a period of {period * 1e3:g} ms, the limit is {100 * wire.bus_load_limit:.0f} %: "
        "take a faster line (an adapter on USB runs at its own speed: write @3000000), or control.period of at least "
        f"{least * 1e3:.3g} ms"
    ]
