"""What a foreign drive watches of its controller: heartbeat, node guarding, time-out of the RPDO (CiA 301)."""

from __future__ import annotations

from collections.abc import Callable

Number = Callable[[int], int]
EMERGENCIES = {"heartbeat": 0x8130, "guarding": 0x8130, "rpdo": 0x8250}


class Monitors:
    """Each is armed by the first frame of its kind and reports its loss once."""

    def __init__(self, number: Number) -> None:
        """`number` reads an object by its key; 0 where it is absent."""
        self._number = number
        self._heard: dict[str, float] = {}
        self._toggle = 0

    def forget(self) -> None:
        """As after a boot."""
        self._heard, self._toggle = {}, 0

    def limits(self) -> dict[str, float]:
        """The time-out of each monitor that is configured (s)."""
        times = {f"heartbeat {node}": time for node, time in self._consumed()}
        times["guarding"] = self._number(0x100C00) * self._number(0x100D00) / 1000.0
        times["rpdo"] = self._number(0x140005) / 1000.0
        return {name: time for name, time in times.items() if time > 0.0}

    def _consumed(self) -> list[tuple[int, float]]:
        entries = (self._number(0x101601), self._number(0x101602))
        return [(entry >> 16 & 0x7F, (entry & 0xFFFF) / 1000.0) for entry in entries if entry >> 16 & 0x7F]

    def heartbeat(self, node: int, now: float) -> None:
        """A heartbeat of another node."""
        if any(node == watched for watched, _ in self._consumed()):
            self._heard[f"heartbeat {node}"] = now

    def command(self, now: float) -> None:
        """The cyclic command, RPDO 1, has come."""
        self._heard["rpdo"] = now

    def guarded(self, nmt_state: int, now: float) -> bytes:
        """The controller's remote frame has come: the answer, with its toggle bit."""
        self._heard["guarding"] = now
        answer, self._toggle = nmt_state | self._toggle, self._toggle ^ 0x80
        return bytes([answer])

    def armed(self) -> list[str]:
        """Those that would notice a silent controller now."""
        return sorted(self.limits().keys() & self._heard.keys())

    def lost(self, now: float) -> str:
        """The monitor that has run out, or nothing; it is armed again by the next frame."""
        for name, limit in self.limits().items():
            if now - self._heard.get(name, now) > limit:
                del self._heard[name]
                return name
        return ""
