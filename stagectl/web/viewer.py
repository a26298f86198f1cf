"""One viewer's live connection: its requests, and what it gets, frame by frame.

::

    viewer --  {"key": ...}                                    first, over TCP
           --  {"strip": {"axis", "channels", "span", "points", "number"}}
           --  {"scope": {... "before", "trigger", "mode"}}     see `ScopeRequest`
           --  {"closer": {"start", "end", "points", "number"}}, {"hold": {"held"}}
           <-  {"status": ...}  ten times a second; {"error": ...}; {"waiting": {"low", "high"}} of a trigger
           <-  numbers, see `live`

It reads the ring, which costs the loop nothing; a slow reader gets fewer frames, and delays nobody.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Awaitable, Callable, Iterator
from typing import Any

from stagectl.recording.joined_rings import Joined, Source
from stagectl.recording.ring import Ring
from stagectl.recording.triggering import Settings, Trigger
from stagectl.service.axis_controller import AxisController, ServiceError
from stagectl.service.limits import WORK_SHARE
from stagectl.service.service import Service
from stagectl.web.channels import Channel, channels, chosen, level, side_by_side
from stagectl.web.limits import FREE_PAUSE, HELD_OFF, LEAST_PAUSE, LONGEST_SHARE, RATE, STATUS_PERIOD, WAITING
from stagectl.web.live import ScopeView, Strip, Window
from stagectl.web.viewer_request import DetailRequest, HoldRequest, ScopeRequest, StripRequest, read

Say = Callable[[str | bytes], Awaitable[None]]


class Viewer:
    """The state of one connection."""

    def __init__(self, service: Service, status: Callable[[], dict[str, Any]], say: Say) -> None:
        self._service, self._status, self._say = service, status, say
        self._strip: tuple[Strip, Ring, StripRequest] | None = None
        self._view: tuple[ScopeView, Source, ScopeRequest] | None = None
        self._held, self._last_status = False, 0.0
        self._captured = 0.0  # s: the last capture, or the last word that there is none
        self._cost = 0.0  # s of work for the present frame

    async def hear(self, text: str) -> None:
        """Take a request; answer in words what cannot be done.  Who asks for much is heard less often."""
        began = time.perf_counter()
        message = self._heard(text)
        cost = time.perf_counter() - began
        if message is not None:
            await self._say(message)
        await asyncio.sleep(cost / WORK_SHARE)

    def _heard(self, text: str) -> str | bytes | None:
        try:
            request = read(text)
            if isinstance(request, DetailRequest):
                return self._closer(request)
            if isinstance(request, HoldRequest):
                self._held = request.held
            elif isinstance(request, ScopeRequest):
                self._held, self._view = False, None if request.mode == "off" else self._scope(request)
            else:
                self._strip = self._stripes(request)
        except ServiceError as error:
            return json.dumps({"error": str(error)})
        return None

    async def show(self) -> None:
        """Frames, until cancelled; the more they cost, the fewer."""
        while True:
            began, self._cost = time.monotonic(), 0.0
            await self.frame(began)
            left = 1.0 / RATE - (time.monotonic() - began)
            await asyncio.sleep(max(left, self._cost / WORK_SHARE, LEAST_PAUSE))

    async def frame(self, now: float) -> None:
        """Send what is new."""
        messages = self._messages(now)
        while True:
            began = time.perf_counter()
            message = next(messages, None)
            self._cost += time.perf_counter() - began
            if message is None:
                return
            await self._say(message)

    def _messages(self, now: float) -> Iterator[str | bytes]:
        self._follow()
        if self._strip is not None:
            strip, _, request = self._strip
            if (message := strip.look(request.number)) is not None:
                yield message
        if self._view is not None and not self._held:
            view, _, scope = self._view
            if (message := view.look(scope.number)) is not None:
                self._captured = now
                yield message
            elif scope.mode != "auto" and view.waiting and now - self._captured >= WAITING:
                self._captured = now
                yield json.dumps({"waiting": dict(zip(("low", "high"), view.waiting, strict=True))})
        if now - self._last_status >= STATUS_PERIOD:
            self._last_status = now
            yield json.dumps({"status": self._status()})

    def _follow(self) -> None:
        """A new real-time process has a new ring."""
        if self._strip is not None and self._strip[1] is not self._service.axis(self._strip[2].axis).ring:
            self._strip = self._stripes(self._strip[2])
        if self._view is not None and not self._held and self._gone(self._view[1]):
            self._view = self._scope(self._view[2])

    def _gone(self, source: Source) -> bool:
        """Whether nobody writes there any more, or the axes began anew."""
        rings = [axis.ring for axis in self._service.axes.values()]
        looked_at = source.rings if isinstance(source, Joined) else (source,)
        return any(ring not in rings for ring in looked_at) or (isinstance(source, Joined) and source.apart)

    def _stripes(self, p: StripRequest) -> tuple[Strip, Ring, StripRequest]:
        axis = self._service.axis(p.axis)
        window = Window(tuple(chosen(channels(axis.setup), p.channels)), p.span, p.points)
        return Strip(axis.ring, axis.setup.dt, window), axis.ring, p

    def _field(self, axis: AxisController, names: list[str]) -> tuple[Source, dict[str, Channel]]:
        """Where a scope of `axis` reads, and what it finds there; another axis' channels have dotted names."""
        own = channels(axis.setup)
        others = {name.partition(".")[0] for name in names if "." in name and name not in own}
        if not others:
            return axis.ring, own
        wanted = {self._service.axis(name).name for name in others}
        wanted |= {axis.name} if any(name in own for name in names) else set()
        axes = {name: served for name, served in self._service.axes.items() if name in wanted}  # as they are served
        dotted = side_by_side({name: served.setup for name, served in axes.items()})
        plain = {name: dotted[f"{axis.name}.{name}"] for name in own if axis.name in axes}
        return Joined([served.ring for served in axes.values()]), {**plain, **dotted}

    def _scope(self, p: ScopeRequest) -> tuple[ScopeView, Source, ScopeRequest]:
        axis = self._service.axis(p.axis)
        source, known = self._field(axis, [*p.channels, *([p.trigger.channel] if p.trigger else [])])
        dt = axis.setup.dt
        longest = LONGEST_SHARE * source.capacity * dt
        if p.span > longest:
            raise ServiceError(f"span {p.span:g} s; a capture of {axis.name} has {longest:.3g} s at most")
        trigger = None
        if p.trigger is not None:
            (cause,) = chosen(known, [p.trigger.channel])
            trigger = Trigger(cause.column, level(cause, p.trigger.level), p.trigger.edge, cause.scale)
        rows = max(round(p.span / dt), 2)
        least, most = FREE_PAUSE
        pause = round(min(max(p.span, least), most) / dt)
        mode = "single" if p.mode == "off" else p.mode
        settings = Settings(rows, min(round(p.before * rows), rows - 1), trigger, mode, pause, round(HELD_OFF / dt))
        window = Window(tuple(chosen(known, p.channels)), p.span, p.points)
        return ScopeView(source, dt, window, settings), source, p

    def _closer(self, p: DetailRequest) -> bytes | None:
        return None if self._view is None else self._view[0].closer(p.start, p.end, p.points, p.number)
