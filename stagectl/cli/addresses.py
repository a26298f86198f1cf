"""The address that ``--tcp`` names: HOST:PORT of a service's page."""

import ipaddress
from pathlib import Path
from typing import Any

from stagectl.problem import Problem, ProblemKind
from stagectl.units import StageError

_USUAL, _MOST_PORTS = 8402, 65535


def tcp_port(tcp: str | None, token: Path, writes: bool, virtual: bool) -> Any:
    """The requested port; a virtual machine serves its page by default."""
    from stagectl.web.server import Tcp

    if tcp is None:
        return Tcp("127.0.0.1", _USUAL, token, writes, virtual, any_port=True) if virtual else None
    return Tcp(*_address(tcp), token, writes, virtual)


def unit_port(tcp: str) -> tuple[str, int] | None:
    """Host and port of an installed service.  Raises StageError for a name: systemd resolves none."""
    if not tcp:
        return None
    host, port = _address(tcp)
    try:
        ipaddress.ip_address("127.0.0.1" if host == "localhost" else host.strip("[]"))
    except ValueError as error:
        raise StageError(f"--tcp {tcp}; HOST must be an IP address, such as 0.0.0.0 for all of them") from error
    return host, port


def _address(text: str) -> tuple[str, int]:
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdigit():
        raise StageError(f"--tcp {text}; must be HOST:PORT, such as 127.0.0.1:{_USUAL}")
    if not 0 < int(port) <= _MOST_PORTS:
        interval, remedy = f"[1, {_MOST_PORTS}]", f"usual is {_USUAL}"
        problem = Problem("", ProblemKind.RANGE, f"--tcp {text}: port", port, "", interval, remedy=remedy)
        raise StageError(problem)
    return host, int(port)
