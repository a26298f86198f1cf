"""Folders of a user or a service, and a name for a socket that fits, however deep its folder lies.

An AF_UNIX address holds 107 bytes (unix(7), sun_path), fewer than many paths have.  Through the open folder the name is
short: ``/proc/self/fd/7/control.sock`` (proc(5)).
"""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path


def runtime_folder() -> Path:
    """Where this user's sockets and locks lie; it need not exist yet."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    return Path(runtime) / "stagectl" if runtime else Path(tempfile.gettempdir()) / f"stagectl-{os.getuid()}"


def state_folder() -> Path:
    """Where a service keeps its keys and black boxes: as systemd says, else in this user's own state."""
    return Path(os.environ.get("STATE_DIRECTORY") or Path.home() / ".local" / "state" / "stagectl")


@contextlib.contextmanager
def short_name(path: Path) -> Iterator[str]:
    """A name of `path` for `bind` and `connect` of this process, for as long as the context lasts.

    Raises OSError where its folder cannot be opened.
    """
    folder = os.open(path.parent, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield f"/proc/self/fd/{folder}/{path.name}"
    finally:
        os.close(folder)
