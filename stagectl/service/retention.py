"""How long recordings are kept: by age and by size, the oldest go first; nothing goes unless a limit is set."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from stagectl.config.stage_blocks import Retention

DAY, GIB = 86400.0, float(1 << 30)  # s, bytes


class Kept(NamedTuple):
    """A file there is."""

    path: Path
    bytes: int
    time: float  # s, of its last change


def kept(state: Path, axis: str = "*") -> list[Kept]:
    """Recordings and black boxes of a service, the newest first."""
    paths = [path for kind in ("recordings", "blackbox") for path in (state / kind).glob(f"{axis}/*.h5")]
    files = []
    for path in paths:
        with contextlib.suppress(FileNotFoundError):  # it has just gone
            about = path.stat()
            files.append(Kept(path, about.st_size, about.st_mtime))
    return sorted(files, key=lambda file: -file.time)


def expired(p: Retention, files: Iterable[Kept], now: float) -> list[Path]:
    """What goes of `files`, which are the newest first, at the time `now` (s); the newest always stays."""
    gone, size = [], 0
    for number, file in enumerate(files):
        size += file.bytes
        if number and (now - file.time > p.keep_days * DAY or size > p.keep_gib * GIB):
            gone.append(file.path)
    return gone


def in_words(p: Retention) -> str:
    """What goes when."""
    if p == Retention():
        return "none is ever removed"
    ends = {f"after {p.keep_days:g} days": p.keep_days, f"beyond {p.keep_gib:g} GiB": p.keep_gib}
    return "removed " + " or ".join(words for words, limit in ends.items() if limit < math.inf)
