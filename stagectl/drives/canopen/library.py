"""The `canopen` library, imported without python-can: the one place that imports it.

It takes two names from python-can, whose readers of log files, asyncio with them, are two fifths of what the real-time
process imports (0.13 s of processor time, 9 MiB).  Frames go by our own buses, so for the import two names stand in;
whoever asks the library for more of python-can, as its own `Network.connect` does, gets the true one.
"""

import contextlib
import importlib
import logging
import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Any


class Listener:
    """Receiver of messages of python-can's notifier; the library derives its own from it."""

    def __call__(self, message: Any) -> None:
        """Take a message."""
        self.on_message_received(message)

    def on_message_received(self, message: Any) -> None:
        """What the library does with it."""

    def stop(self) -> None:
        """No more will come."""


class CanError(Exception):
    """Never raised: our buses raise OSError, on which a request is not put again."""


class StandIn(ModuleType):
    """Python-can's two names; every other attribute is the true module's."""

    Listener, CanError = Listener, CanError

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # what Python itself asks a module for
            raise AttributeError(name)
        return getattr(importlib.import_module("can"), name)


@contextlib.contextmanager
def _without_python_can() -> Iterator[None]:
    """Let two names stand in for python-can, where it is not there already."""
    if "can" in sys.modules:
        yield
        return
    sys.modules["can"] = StandIn("can")
    try:
        yield
    finally:
        del sys.modules["can"]


with _without_python_can():
    import canopen
    from canopen.sdo.client import SdoClient
    from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError, SdoError

# What the library logs, it raises as well, and we say it in words: its own lines need not appear beside ours.
logging.getLogger("canopen").addHandler(logging.NullHandler())

__all__ = ["SdoAbortedError", "SdoClient", "SdoCommunicationError", "SdoError", "canopen"]
