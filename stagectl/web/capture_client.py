"""The other end of the live connection, for programs: captures of a running loop over the control socket."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stagectl.runtime_folder import short_name
from stagectl.web.client import ControlError, RefusedError, nobody
from stagectl.web.limits import CONNECTION_TIME
from stagectl.web.live import CAPTURE, FREE, HEAD

_TRIGGER = re.compile(r"\s*([\w.]+)\s*(>|<|=)\s*(.+?)\s*")
_EDGES = {">": "rising", "<": "falling", "=": "both"}


class ReceivedCapture(NamedTuple):
    """One capture."""

    time: NDArray[np.float64]  # (n,) s, from the trigger; of the first row of each bucket
    low: NDArray[np.float64]  # (channels, n), in the channels' units
    high: NDArray[np.float64]
    step: float  # s between two buckets
    triggered: bool


class WithoutTrigger(NamedTuple):
    """No trigger has come yet: where its channel lay since the last capture, in its unit."""

    low: float
    high: float


def trigger(text: str) -> dict[str, str]:
    """``error > 1 um``: rises above; ``<`` falls below, ``=`` crosses either way.

    Raises ControlError where it cannot be understood.
    """
    match = _TRIGGER.fullmatch(text)
    if match is None:
        raise ControlError(f"--trigger {text!r}; must be CHANNEL > LEVEL, CHANNEL < LEVEL or =, such as 'error > 1 um'")
    return {"channel": match[1], "edge": _EDGES[match[2]], "level": match[3]}


Seen = ReceivedCapture | WithoutTrigger


def captures(path: Path, request: dict[str, Any]) -> Iterator[tuple[dict[str, Any], Seen]]:
    """The machine's description and each capture, without an end; `request` as in `viewer.ScopeRequest`.

    Where its trigger does not come, now and then what its channel did meanwhile.

    Raises RefusedError with the service's reason, ControlError where there is none to ask.
    """
    from websockets.exceptions import ConnectionClosed, InvalidHandshake
    from websockets.sync.client import unix_connect

    try:
        with (
            short_name(path) as name,
            unix_connect(
                name, uri="ws://localhost/v1/live", open_timeout=CONNECTION_TIME, compression=None, max_size=None
            ) as link,
        ):
            link.send("{}")
            machine = json.loads(link.recv())["machine"]
            link.send(json.dumps({"scope": request}))
            for message in link:
                if isinstance(message, bytes):
                    yield machine, unpacked(message)
                elif "error" in (answer := json.loads(message)):
                    raise RefusedError(answer["error"])
                elif "waiting" in answer:
                    yield machine, WithoutTrigger(**answer["waiting"])
        raise ControlError("the service has ended")
    except ConnectionClosed as error:
        raise ControlError(f"the service has closed the connection: {error.reason or 'it has ended'}") from error
    except (OSError, InvalidHandshake, ValueError) as error:
        raise nobody(path, error) from error


def unpacked(message: bytes) -> ReceivedCapture:
    """A message of numbers, see `live`."""
    numbers = np.frombuffer(message, dtype="<f8")
    kind, channels, buckets, size, start, period, at, _ = numbers[:HEAD]
    values = numbers[HEAD:].reshape(-1, int(channels), int(buckets))
    time = start - at + np.arange(int(buckets)) * size * period
    assert kind in (CAPTURE, FREE)
    return ReceivedCapture(time, values[0], values[-1], float(size * period), bool(kind == CAPTURE))
