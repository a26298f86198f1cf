"""One cycle's messages against python-canopen's CiA 402 profile and moteus's Python library, in turn in one process.

What each does, so that the ratio can be judged::

    ours            TPDO -> statusword, unwrapped position, current (A); controlword and current (A) -> RPDO
    python-canopen  TPDO -> `BaseNode402.tpdo_values`; controlword and target torque into RPDO1 (it sends into the void)
    moteus          reply -> `Result` of registers; `make_current` with a query -> the bytes of a command

A whole cycle is SYNC, TPDO, RPDO with the same virtual drive on the embedded bus, without power, one after another as
fast as the drive answers: CPU time of the process with all its threads.  moteus speaks to its own controllers only: its
codec is measured, and its cycle is not.
"""

import contextlib
import importlib.util
import struct
import threading
import time
from collections.abc import Callable
from typing import Any

import canopen
from canopen.profiles.p402 import BaseNode402
from measure import Against, Contender, interleaved, versus
from scene import STAGE, scene

from stagectl.config.stage_file import canopen as wire_of
from stagectl.drives.bus.interfaces import open_bus
from stagectl.drives.canopen.drive import CanopenDrive
from stagectl.drives.canopen.network import load_eds
from stagectl.drives.canopen.object_rules import Wishes
from stagectl.drives.canopen.pdo import CommandPdo, FeedbackPdo
from stagectl.drives.drive import Canopen

CALLS = 2000  # of the codec in a round
CYCLES = 1000  # on the bus in a round
_SETTINGS = wire_of(scene("sine-1.6hz").setup)
_ANSWER = struct.pack("<Hih", 0x0627, 123_456, -321)
_CONTROLWORD, _TARGET = 0x000F, 0x6071
_MOTEUS = bytes([0x21, 0x00, 10, 0x2F, 0x01]) + struct.pack("<fff", 0.25, 1.5, 0.1) + bytes([0x23, 0x0D, 48, 25, 0])


def rows(channel: str, rounds: int) -> tuple[list[Against], dict[str, str]]:
    """Comparisons, and what could not be compared; the drive must be on the bus `channel`, and nobody else."""
    codecs = {"ours": _ours(_SETTINGS), "python-canopen, p402": _p402()}
    skipped = {}
    if importlib.util.find_spec("moteus"):
        codecs["moteus"] = _moteus()
    else:
        skipped["codec against moteus"] = "moteus is not installed: pip install -e '.[bench]'"
    found = interleaved([Contender(name, _many(one), CALLS) for name, one in codecs.items()], 4 * rounds)
    method = f"decode and encode: elapsed time, {CALLS} calls a round, interleaved, interpreted"
    lines = [
        versus(("Codec and cycle", name, "decode and encode"), (found["ours"], found[name]), ("us", 1e6), method)
        for name in found
        if name != "ours"
    ]
    skipped["cycle against moteus"] = "its library speaks to moteus controllers only, and there is none"
    return [*lines, _cycle(channel, rounds)], skipped


def _many(one: Callable[[], object]) -> Callable[[], None]:
    def call() -> None:
        for _ in range(CALLS):
            one()

    return call


def _ours(wire: Canopen) -> Callable[[], object]:
    od = load_eds(wire.eds, wire.node)
    command, answer = CommandPdo(wire, od), FeedbackPdo(wire, od)
    raw = answer.head + bytes(3) + _ANSWER

    def call() -> object:
        return answer.decode(raw), command.encode(_CONTROLWORD, 1.25)

    return call


def _mapped(network: canopen.Network) -> BaseNode402:
    """A node of the profile with our two PDOs."""
    node = BaseNode402(_SETTINGS.node, load_eds(_SETTINGS.eds, _SETTINGS.node))
    network.add_node(node)
    for pdo, objects, identifier in ((node.tpdo[1], _SETTINGS.tpdo, 0x180), (node.rpdo[1], _SETTINGS.rpdo, 0x200)):
        pdo.clear()
        pdo.cob_id = identifier + _SETTINGS.node
        for key in objects:
            pdo.add_variable(key >> 8, key & 0xFF)
        pdo.enabled, pdo.trans_type = True, 1
    return node


def _torque(node: BaseNode402) -> Any:
    """The target in our RPDO; the library's annotation says PdoMap, and it is a variable of one."""
    return node.rpdo_pointers[_TARGET]


def _p402() -> Callable[[], object]:
    network = canopen.Network()
    setattr(network, "send_message", lambda *_: None)  # noqa: B010 - a stub in the method's place
    node = _mapped(network)
    node.setup_pdos(upload=False)
    tpdo, torque = node.tpdo[1], _torque(node)
    identifier = 0x180 + _SETTINGS.node
    data = bytearray(_ANSWER)

    def call() -> object:
        tpdo.on_message(identifier, data, 0.0)
        torque.raw = 125
        node.controlword = _CONTROLWORD
        return node.statusword, node.tpdo_values[0x6064]

    if call() != struct.unpack("<Hi", _ANSWER[:6]):
        raise SystemExit("bench: python-canopen does not read what was sent: nothing was measured")
    return call


def _moteus() -> Callable[[], object]:
    import moteus
    from moteus.transport_device import Frame

    controller = moteus.Controller(id=1, transport=object())
    reply = Frame(arbitration_id=0x100, data=_MOTEUS)

    def call() -> Any:
        command = controller.make_current(d_A=0.0, q_A=1.25, query=True)
        return command.parse(reply).values[moteus.Register.POSITION]

    if call() != 0.25:
        raise SystemExit("bench: moteus does not read what was sent: nothing was measured")
    return call


def _cycle(channel: str, rounds: int) -> Against:
    found: dict[str, list[float]] = {"ours": [], "theirs": []}
    for _ in range(rounds):
        found["theirs"].append(_cycle_p402(channel))
        found["ours"].append(_cycle_ours(channel))
    method = f"cycle: CPU time of the process over {CYCLES} cycles on the embedded bus, one after another, in turn"
    told = ("Codec and cycle", "python-canopen, p402", "a cycle on the bus")
    return versus(told, (found["ours"], found["theirs"]), ("us", 1e6), method)


def _cycle_ours(channel: str) -> float:
    setup = scene("sine-1.6hz").setup
    with contextlib.closing(open_bus("embedded", channel, 1e6)) as bus:
        drive = CanopenDrive(Wishes(_SETTINGS, setup.stage.encoder.step, setup.dt), bus)
        begin = time.process_time()
        for _ in range(CYCLES):
            drive.sample()
            drive.apply(0.0)
        spent = time.process_time() - begin
        drive.close()
    return spent / CYCLES


def _cycle_p402(channel: str) -> float:
    with canopen.Network() as network:
        network.connect(interface="stagectl", channel=channel)
        node = _mapped(network)
        node.nmt.state = "PRE-OPERATIONAL"
        for pdo in (node.tpdo[1], node.rpdo[1]):
            pdo.save()
        node.tpdo[1].subscribe()
        node.nmt.state = "OPERATIONAL"
        node.setup_pdos(upload=False)
        torque, came = _torque(node), threading.Event()
        node.tpdo[1].add_callback(lambda _: came.set())  # `wait_for_reception` misses what comes before it
        begin = time.process_time()
        for _ in range(CYCLES):
            came.clear()
            network.sync.transmit()
            if not came.wait(1.0):
                raise SystemExit(f"bench: {STAGE.name}'s drive does not answer python-canopen's SYNC")
            _ = node.statusword, node.tpdo_values[0x6064]
            torque.raw = 0
            node.controlword = 0
        return (time.process_time() - begin) / CYCLES
