"""A CAN interface of another computer that socketcand offers there: ``channel: can0@192.168.1.2:29536``."""

from __future__ import annotations

from typing import NamedTuple

_LAST_PORT = 65535


class Offered(NamedTuple):
    """An interface by its name there, and where the server is."""

    channel: str
    host: str
    port: int


def offered(text: str) -> Offered | None:
    """What a channel names; None where it is none of this kind."""
    channel, _, address = text.partition("@")
    host, _, port = address.rpartition(":")
    if not (channel and host and port.isascii() and port.isdigit() and 0 < int(port) <= _LAST_PORT):
        return None
    return Offered(channel, host, int(port))
