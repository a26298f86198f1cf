"""The stage file that a service has read: whether the one on the disk still says the same."""

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
            what = f"{self._path} {'is gone' if stamp is None else 'has changed'} since the start at {self._since}"
            same = self._read() == self._content
            self._words = "" if same else f"{what}: the service runs the values that it read then"
        return [self._words] if self._words else []

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
