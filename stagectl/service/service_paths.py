"""Files and addresses of a running service."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from stagectl.service.stop_link import beside


class ServicePaths(NamedTuple):
    """Files and addresses of a running service."""

    socket: Path
    state: Path  # folder: black boxes, and the mark of a service that runs
    foxglove: tuple[str, int] | None = None  # host and port of its live view; None: no live view

    @property
    def stop(self) -> Path:
        """The socket of the stop path."""
        return beside(self.socket)
