"""How the service and its planning process talk: a length, then so many bytes."""

from __future__ import annotations

import socket
import struct

LENGTH = struct.Struct("<Q")


def received(link: socket.socket, count: int) -> bytes:
    """So many bytes.  Raises EOFError where the other end has gone."""
    parts = []
    while count:
        part = link.recv(min(count, 1 << 20))
        if not part:
            raise EOFError
        parts.append(part)
        count -= len(part)
    return b"".join(parts)
