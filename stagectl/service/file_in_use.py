"""The stage file that a service has read: whether the one on the disk still says the same."""

from __future__ import annotations

import time
from pathlib import Path


class FileInUse:
    """A file as it was when the service began."""

    def __init__(self, path: Path) -> None:
        self._path, self._since = path, time.strftime("%H:%M:%S")
        self._stamp, self._content, self._words = self._now(), self._read(), ""

    @property
    def text(self) -> str:
        """What it said then; empty where it could not be read."""
        return (self._content or b"").decode("utf-8-sig", "replace")

    def changed(self) -> list[str]:
        """A warning where it says something else now, or is gone; it is read again only where its stamp is new."""
        if (stamp := self._now()) != self._stamp:
            self._stamp = stamp
            what = "is gone" if stamp is None else "has changed"
            self._words = "" if self._read() == self._content else self._warning(what)
        return [self._words] if self._words else []

    def _warning(self, what: str) -> str:
        return f"{self._path} {what} since the start at {self._since}: the service runs the values that it read then"

    def _now(self) -> tuple[int, int] | None:
        try:
            found = self._path.stat()
        except OSError:
            return None
        return found.st_mtime_ns, found.st_size

    def _read(self) -> bytes | None:
        try:
            return self._path.read_bytes()
        except OSError:
            return None
