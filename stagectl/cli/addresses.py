"""The addresses that options of a service name: HOST:PORT of its page, and of Foxglove."""

import ipaddress
from pathlib import Path
from typing import Any

from stagectl.extras import require
from stagectl.problem import Problem, ProblemKind
from stagectl.units import StageError

_MOST_PORTS = 65535


def tcp_port(tcp: str | None, token: Path, writes: bool, virtual: bool) -> Any:
    """The requested port; a virtual machine serves its page by default."""
    from stagectl.web.server import Tcp

    if tcp is None:
        return Tcp("127.0.0.1", 8402, token, writes, virtual, any_port=True) if virtual else None
    return Tcp(*_address("--tcp", tcp, 8402), token, writes, virtual)


def foxglove_address(text: str | None) -> tuple[str, int] | None:
    """Host and port of Foxglove's server."""
    if text is None:
        return None
    require("foxglove", "--foxglove")
    return _address("--foxglove", text, 8765)


def unit_port(tcp: str) -> tuple[str, int] | None:
    """Host and port of an installed service.  Raises StageError for a name: systemd resolves none."""
    if not tcp:
        return None
    host, port = _address("--tcp", tcp, 8402)
    try:
        ipaddress.ip_address("127.0.0.1" if host == "localhost" else host.strip("[]"))
    except ValueError as error:
        raise StageError(f"--tcp {tcp}; HOST must be an IP address, such as 0.0.0.0 for all of them") from error
    return host, port


def _address(option: str, text: str, usual: int) -> tuple[str, int]:
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdigit():
        raise StageError(f"{option} {text}; must be HOST:PORT, such as 127.0.0.1:{usual}")
    if not 0 < int(port) <= _MOST_PORTS:
        interval, remedy = f"[1, {_MOST_PORTS}]", f"usual is {usual}"
        problem = Problem("", ProblemKind.RANGE, f"{option} {text}: port", port, "", interval, remedy=remedy)
        raise StageError(problem)
    return host, int(port)
