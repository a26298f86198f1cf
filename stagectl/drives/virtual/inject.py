"""Injection of faults into a running virtual drive: one JSON datagram to a socket of its user, one back.

The request does not travel over the bus, so that a bus fault can be cleared::

    stagectl inject  -- {"do": "add", "fault": {...}} -->  node-5.inject in the run-time folder
                     <-- {"words": "...", "active": [...]} --
"""

import contextlib
import json
import re
import select
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stagectl.drives.bus.embedded import folder_of, is_socket
from stagectl.drives.drive import DriveError
from stagectl.drives.faults import BLOCKS
from stagectl.drives.limits import INJECT_DATAGRAM, INJECT_TIME
from stagectl.runtime_folder import short_name
from stagectl.units import quantities_of


class InjectError(DriveError):
    """A fault that cannot be injected; the message says what can."""


class InjectionSocket:
    """The drive's end; `look` answers what has come, and never waits."""

    def __init__(self, path: Path) -> None:
        """Listen at `path`, in a folder of this user only."""
        self._path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        if is_socket(path):  # a drive that was killed has left it
            path.unlink(missing_ok=True)
        try:
            with short_name(path) as name:
                self._socket.bind(name)
        except OSError as error:
            self._socket.close()
            raise InjectError(
                f"{path}: {error.strerror or error}: no faults can be injected there", place=str(path)
            ) from error

    def look(self, obey: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        """Pass one waiting request to `obey` and send its answer; never waits."""
        try:
            raw, sender = self._socket.recvfrom(INJECT_DATAGRAM)
        except BlockingIOError:
            return
        try:
            answer = obey(json.loads(raw))
        except (ValueError, KeyError, TypeError) as error:
            answer = {"error": f"not a request of stagectl inject: {error}"}
        with contextlib.suppress(OSError):  # who asked has gone
            self._socket.sendto(json.dumps(answer).encode(), sender)

    def close(self) -> None:
        """Close the socket and remove its file."""
        self._socket.close()
        if is_socket(self._path):
            self._path.unlink(missing_ok=True)


def socket_path(interface: str, channel: str, node: int) -> Path:
    """Where the virtual drive of this node listens; on the embedded bus next to the bus itself."""
    if interface in ("embedded", "stagectl"):
        return folder_of(channel) / f"node-{node}.inject"
    folder = folder_of("inject-" + re.sub(r"[^A-Za-z0-9]+", "-", f"{interface}-{channel}")[-40:])
    folder.mkdir(mode=0o700, exist_ok=True)  # on the embedded bus its participants make it
    return folder / f"node-{node}.inject"


def ask(path: Path, request: dict[str, Any]) -> dict[str, Any]:
    """Send `request` to the virtual drive that listens at `path`; its answer.

    Raises InjectError where none listens there, or it refuses.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ours:
        ours.bind("")  # a name of the kernel's: one in a temporary folder may be too long
        try:
            with short_name(path) as name:
                ours.connect(name)
            ours.send(json.dumps(request).encode())
        except OSError as error:
            raise InjectError(
                f"no virtual drive listens at {path} ({error.strerror}); start one with 'stagectl virtual-drive"
                " STAGE.yaml'; a real drive takes no faults: see `stagectl selftest`",
                place=str(path),
            ) from error
        if not select.select([ours], [], [], INJECT_TIME)[0]:
            raise InjectError(
                f"the virtual drive at {path} does not answer within {INJECT_TIME:g} s; is it stopped?", place=str(path)
            )
        answer: dict[str, Any] = json.loads(ours.recv(INJECT_DATAGRAM))
    if "error" in answer:
        raise InjectError(answer["error"], place=str(path))
    return answer


def check_stage(path: Path, stage: str) -> None:
    """Raises InjectError where the virtual drive that listens at `path` is that of another stage."""
    there = ask(path, {"do": "who"}).get("stage", "an older stagectl")
    if there != stage:
        reason = f"the virtual drive there is of {there}, not of {stage}, and is left as it is"
        raise InjectError(f"{reason}: give the stage file of {there}, or another --channel", place=str(path))


def obey(faults: Any, now: float, request: dict[str, Any]) -> dict[str, Any]:
    """Carry out a request on these `faults` at `now` (s)."""
    if request["do"] == "clear":
        faults.clear()
    elif request["do"] == "add":
        faults.add(_block(request["fault"]), now)
    return {"active": faults.active}


def _block(parameters: dict[str, Any]) -> Any:
    """The fault with these parameters; raises ValueError, KeyError or TypeError where it cannot be."""
    kind = BLOCKS[parameters["fault"]]
    quantities = quantities_of(kind)
    for name, value in parameters.items():
        quantity = quantities.get(name)
        if quantity is not None and not (isinstance(value, int | float) and quantity.admits(value)):
            raise ValueError(f"{name} = {value}; must lie in {quantity.interval} {quantity.unit}".rstrip())
    return kind(**parameters)
