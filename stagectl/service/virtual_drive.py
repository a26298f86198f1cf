"""The virtual drive as a separate process, started where the embedded bus has no drive yet."""

import contextlib
import math
import os
import re
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from stagectl.config.stage_file import Setup
from stagectl.drives.bus.frames import Bus
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.bus.other_masters import holder
from stagectl.drives.canopen.probe import answering
from stagectl.drives.clock import WALL, Clock
from stagectl.drives.drive import Canopen, DriveError, Odrive
from stagectl.drives.simulated import Plant
from stagectl.drives.virtual.inject import InjectionSocket, ask, obey, socket_path
from stagectl.drives.virtual.node import VirtualNode
from stagectl.drives.virtual.odrive import Pty, VirtualOdrive
from stagectl.realtime.scheduling import settle
from stagectl.service.child_process import PYTHON, environment

VELOCITY_LOOP = 20.0  # Hz, of the virtual drive's own stops
_READY = "virtual drive"
_SOCKETCAN = re.compile(r"v?can[0-9]+")  # what the kernel calls its interfaces


def answers(wire: Canopen, patience: float = 0.2) -> bool:
    """Whether a node with the wire's id answers on its bus."""
    with contextlib.closing(open_bus(wire.interface, wire.channel, wire.bitrate)) as bus:
        return bool(answering(bus, nodes=(wire.node,), patience=patience))


def wanted(wire: Canopen) -> bool:
    """Whether a virtual drive must be started: the embedded bus has neither a master nor a drive with the wire's id."""
    return wire.interface == "embedded" and holder(wire) is None and not answers(wire)


def _found(wire: Canopen) -> str:
    """The virtual drive that somebody else has started, in words: its machine may not be the stage file's."""
    try:
        answer = ask(socket_path(wire.interface, wire.channel, wire.node), {"do": "who"})
    except DriveError:  # it is none, or says nothing
        return ""
    return "" if answer["parent"] == os.getpid() else f"a drive is there already: {answer['words']}"


@contextlib.contextmanager
def present(setup: Setup, say: Callable[[str], object]) -> Iterator[None]:
    """Make sure that the embedded bus of the stage has a drive: a virtual one where none answers."""
    wire = setup.file.drive.wire
    if not isinstance(wire, Canopen) or not wanted(wire):
        if isinstance(wire, Canopen) and (found := _found(wire)):
            say(found)
        yield
        return
    if setup.text:
        raise DriveError(
            f"the virtual drive reads its stage from a file, and this version of {setup.path} is in memory only: "
            "save it first, `stage = stage.save('my-stage.yaml')`"
        )
    real = f" (`interface: socketcan` is the computer's {wire.channel})" if _SOCKETCAN.match(wire.channel) else ""
    say(f"no drive answers on the embedded bus `{wire.channel}`{real}: starting a virtual one")
    machine = setup.file.virtual_drive.machine_of_the_day
    process = start(setup.path, wire.channel, setup.file.simulation.seed, machine)
    try:
        yield
    finally:
        process.terminate()
        process.wait()


def start(stage_file: Path, channel: str, seed: int, machine: int = 0) -> subprocess.Popen[str]:
    """Start ``stagectl virtual-drive`` with noise of this `seed` and wait until it is on the bus.

    `machine` is the seed of a machine of the day, or 0.

    Nobody reads its later messages, so the pipe is closed: a full one would block the drive in mid motion.
    Raises DriveError with what it printed where it is not.
    """
    options = ["--channel", channel, "--seed", str(seed), "--machine-of-the-day", str(machine), "--follow"]
    command = [*PYTHON, "-m", "stagectl", "virtual-drive", str(stage_file), *options]
    process = subprocess.Popen(  # a new session: Ctrl-C is for the controller, which stops the axis
        command,
        stdout=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
        env=environment(),
    )
    assert process.stdout is not None
    with process.stdout:
        line = process.stdout.readline()
    if not line.startswith(_READY):
        process.kill()
        process.wait()
        raise DriveError(f"the virtual drive did not start: {line.strip() or 'see the messages above'}")
    return process


def serve(setup: Setup, wire: Canopen, report: Callable[[str], None], until: Callable[[], bool]) -> None:
    """Be the virtual drive of this stage `until` it is to end and the axis has no power.

    Raises DriveError where there is one already, or the bus goes away.
    """
    if answers(wire):
        who = _found(wire) or f"node {wire.node} is on {wire.interface} {wire.channel} already"
        raise DriveError(f"{who}: end it first, or choose another --channel")
    _compile(setup)
    bus = open_bus(wire.interface, wire.channel, wire.bitrate)
    door = InjectionSocket(socket_path(wire.interface, wire.channel, wire.node))
    node = virtual_node(setup, wire, bus, report)
    settle()  # a collection of all that was imported takes longer than a period
    words = f"{_name(setup)}: node {wire.node} on {wire.interface} {wire.channel}, process {os.getpid()}"
    report(words)

    def answer(request: dict[str, Any]) -> dict[str, Any]:
        who = {"words": words, "parent": os.getppid(), "stage": setup.file.name}
        return who if request["do"] == "who" else obey(node.faults, node.now(), request)

    def over() -> bool:
        door.look(answer)
        return until() and not node.axis.enabled  # an axis in motion is brought to a stand first

    try:
        node.run(over)
    except OSError as error:  # its folder was removed, or the interface went down
        raise DriveError(f"the bus {wire.channel} is gone: {error}; start the virtual drive again") from error
    finally:
        door.close()
        bus.close()


def _name(setup: Setup) -> str:
    machine = setup.file.virtual_drive.machine_of_the_day
    return f"{_READY} of {setup.file.name}{f', machine of the day {machine}' if machine else ''}"


def _compile(setup: Setup) -> None:
    """Before the drive is on its bus: on a new machine compiling takes longer than a controller waits for an answer."""
    Plant(setup.stage, setup.file.simulation, setup.dt).compile()


def virtual_node(
    setup: Setup, wire: Canopen, bus: Bus, report: Callable[[str], None], time: Clock | None = None
) -> VirtualNode:
    """The virtual drive of a stage on `bus`, faults and all; with a `time` the plant follows it."""
    p = setup.stage
    # The bus itself delays the command by one period; the plant's own delay line adds the rest of nd.
    inside = p._replace(drive=p.drive._replace(delay_samples=p.drive.delay_samples - 1))
    plant = Plant(inside, setup.file.simulation, setup.dt, setup.file.brake.holding(p, 0.0))
    damping = p.mechanics.inertia * 2.0 * math.pi * VELOCITY_LOOP / p.motor.force_constant
    return VirtualNode(
        wire,
        plant,
        bus,
        "wall" if time else setup.file.simulation.clock,
        damping,
        report,
        distance=setup.file.axis.travel.length,
        time=time or WALL,
        faults=setup.file.virtual_drive.faults,
        brake=setup.file.brake,
        mark=setup.file.virtual_drive.mark,
    )


def serve_odrive(setup: Setup, wire: Odrive, report: Callable[[str], None], until: Callable[[], bool]) -> None:
    """Be a virtual ODrive on a pty `until` it is to end.  Raises DriveError where its port's name is taken."""
    p = setup.stage
    inside = p._replace(drive=p.drive._replace(delay_samples=0))  # the line itself is the delay
    _compile(setup)
    drive = VirtualOdrive(wire, Plant(inside, setup.file.simulation, setup.dt))
    pty = Pty(drive, wire.port, wire.baud)
    settle()
    report(f"{_READY} of {setup.file.name}: ODrive axis {wire.axis} on {wire.port}, process {os.getpid()}")
    try:
        pty.run(until)
    finally:
        pty.close()
