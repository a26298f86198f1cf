"""The virtual drive as a process of its own: started where the embedded bus has no drive yet."""

from __future__ import annotations

import math
import os
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from stagectl.config.stage_file import Setup
from stagectl.drives.bus import open_bus
from stagectl.drives.drive import Canopen, DriveError
from stagectl.drives.node import VirtualNode
from stagectl.drives.simulated import Plant
from stagectl.words import length

_READY = "virtual drive"
_FRAME = struct.Struct("<IB3x8s")
_UPLOAD_DEVICE_TYPE = b"\x40\x00\x10\x00\x00\x00\x00\x00"  # SDO: upload 0x1000


def answers(wire: Canopen, patience: float = 0.2) -> bool:
    """Whether a node with the wire's id answers on its bus."""
    bus = open_bus(wire.interface, wire.channel, wire.bitrate)
    try:
        bus.send(_FRAME.pack(0x600 + wire.node, 8, _UPLOAD_DEVICE_TYPE))
        end = time.monotonic() + patience
        while (left := end - time.monotonic()) > 0.0:
            frame = bus.receive(left)
            if frame is not None and _FRAME.unpack(frame)[0] == 0x580 + wire.node:
                return True
        return False
    finally:
        bus.close()


def start(stage_file: Path, channel: str, seed: int) -> subprocess.Popen[str]:
    """Start ``stagectl virtual-drive`` with noise of this `seed` and wait until it is on the bus.

    Raises DriveError with what it printed where it is not.
    """
    options = ["--channel", channel, "--seed", str(seed), "--follow"]
    command = [sys.executable, "-m", "stagectl", "virtual-drive", str(stage_file), *options]
    process = subprocess.Popen(  # a session of its own: a Ctrl-C is for the controller, which stops the axis
        command, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True, start_new_session=True
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    if not line.startswith(_READY):
        process.kill()
        raise DriveError(f"the virtual drive did not start: {line.strip() or 'see the messages above'}")
    return process


def serve(setup: Setup, wire: Canopen, report: Callable[[str], None], until: Callable[[], bool]) -> None:
    """Be the virtual drive of this stage until told otherwise, and without power.

    Raises DriveError where there is one already, or the bus goes away.
    """
    if answers(wire):
        raise DriveError(f"node {wire.node} is on {wire.interface} {wire.channel} already: one drive is enough")
    p = setup.stage
    # The bus itself delays the command by one period; the plant's own delay line adds the rest of nd.
    inside = p._replace(drive=p.drive._replace(delay_samples=p.drive.delay_samples - 1))
    plant = Plant(inside, setup.file.simulation, setup.dt)
    bus = open_bus(wire.interface, wire.channel, wire.bitrate)
    damping = p.mechanics.inertia * 2.0 * math.pi * 20.0 / p.motor.force_constant  # a 20 Hz velocity loop
    axis = setup.file.axis
    node = VirtualNode(
        wire,
        plant,
        bus,
        setup.file.simulation.clock,
        setup.dt,
        damping,
        report,
        distance=lambda way: length(way * axis.travel_per_unit, axis.travel_unit),
    )
    report(f"{_READY} of {setup.file.name}: node {wire.node} on {wire.interface} {wire.channel}, process {os.getpid()}")
    try:
        node.run(lambda: until() and not node.axis.enabled)  # an axis in motion is brought to a stand first
    except OSError as error:  # its folder was removed, or the interface went down
        raise DriveError(f"the bus {wire.channel} is gone: {error}; start the virtual drive again") from error
    finally:
        bus.close()
