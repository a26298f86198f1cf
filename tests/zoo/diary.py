"""The diary of a foreign drive: JSON lines that a test judges.

Every line has ``t`` (s, CLOCK_MONOTONIC: the same clock in all processes of a machine) and ``kind``:

=========  ==========================================================================================
start      variant and node id: the drive is on the bus, though perhaps not booted
boot       boot-up message sent; ``why``
nmt        new NMT ``state``; ``requests`` by SDO so far
sdo        ``key``, ``name``, ``value`` (hex, little endian), ``abort`` (0: confirmed), ``state``: a write
state      CiA 402 ``state`` and ``why``
lost       ``monitor`` that ran out, ``option`` of 0x6007 that was followed
emergency  ``code``
event      what the variant did in motion
sample     ``x`` (m), ``v`` (m/s), ``current`` and ``command`` (A), ``powered``, ``enabled``, ``monitors``: those
           that are armed and lead to a stop; ``rests``: without power it stays where it is
=========  ==========================================================================================
"""

from __future__ import annotations

import json
import time
from itertools import pairwise
from pathlib import Path
from typing import Any, TextIO

SAMPLE = 0.01  # s between samples
REST = 1e-4  # m/s: an axis that is held and slower counts as standing


class Writer:
    """Appends lines; each is complete on disk before the drive goes on."""

    def __init__(self, path: Path) -> None:
        """Begin the file at `path`."""
        self._file: TextIO = path.open("w", buffering=1)

    def note(self, kind: str, **fields: Any) -> None:
        """One line."""
        self._file.write(json.dumps({"t": time.monotonic(), "kind": kind, **fields}) + "\n")


class Diary:
    """What a drive wrote down, read back as often as asked."""

    def __init__(self, path: Path) -> None:
        """Of the file at `path`, which need not exist yet."""
        self.path = path

    def lines(self, kind: str = "") -> list[dict[str, Any]]:
        """The complete lines of this kind, oldest first; all without a kind."""
        text = self.path.read_text() if self.path.exists() else ""
        parsed = [json.loads(line) for line in text.split("\n")[:-1]]
        return [line for line in parsed if kind in ("", line["kind"])]

    @property
    def last(self) -> dict[str, Any]:
        """The newest sample."""
        return self.lines("sample")[-1]

    def moved(self) -> float:
        """Widest span of positions while it had power (m)."""
        positions = [line["x"] for line in self.lines("sample") if line["powered"]]
        return max(positions) - min(positions) if positions else 0.0

    def powered(self) -> bool:
        """Whether it ever had power."""
        return any(line["state"] == "operation enabled" for line in self.lines("state"))

    def moved_after(self, moment: float) -> float:
        """Longest way from where it was at that moment (m)."""
        samples = self.lines("sample")
        start = [line["x"] for line in samples if line["t"] <= moment][-1]
        return max((abs(line["x"] - start) for line in samples if line["t"] > moment), default=0.0)

    def stands(self, holding: bool = False) -> bool:
        """Whether it is without power and at rest; `holding`: or at rest by itself, in Quick stop active."""
        last = self.last
        if last["powered"]:
            return holding and not last["enabled"] and abs(last["v"]) <= REST
        return bool(last["rests"])

    def unsupervised(self) -> float:
        """Widest span of positions under power while no monitor could have stopped it (m); -1: it never was so."""
        bare = [line["x"] for line in self.lines("sample") if line["enabled"] and not line["monitors"]]
        return max(bare) - min(bare) if bare else -1.0

    def dropped(self) -> float:
        """How far a weight fell (m): in the first 0.12 s under power, and after each end of power."""
        return max([0.0, *self._sinking(True, 0.12), *self._sinking(False, 5.0)])

    def _sinking(self, powered: bool, seconds: float) -> list[float]:
        samples = self.lines("sample")
        turns = [new for old, new in pairwise(samples) if new["powered"] == powered != old["powered"]]
        return [
            turn["x"]
            - min(s["x"] for s in samples if turn["t"] <= s["t"] <= turn["t"] + seconds and s["powered"] == powered)
            for turn in turns
        ]

    def held(self) -> dict[int, str]:
        """The last confirmed write to each object since the last boot, by key."""
        values: dict[int, str] = {}
        for line in self.lines():
            if line["kind"] == "boot":
                values = {}
            if line["kind"] == "sdo" and not line["abort"]:
                values[line["key"]] = line["value"]
        return values
