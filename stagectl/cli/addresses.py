"""Where `serve` listens: the options `--tcp` and `--foxglove`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stagectl.extras import require
from stagectl.units import StageError


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


def _address(option: str, text: str, usual: int) -> tuple[str, int]:
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdigit() or not 0 < int(port) < 65536:
        raise StageError(f"{option} {text}; must be HOST:PORT, such as 127.0.0.1:{usual}")
    return host, int(port)
