"""One viewer's live connection: its requests, and what it gets, frame by frame.

::

    viewer --  {"key": ...}                                    first, over TCP; on the Unix socket nothing needs it
           --  {"strip": {"axis", "channels", "span", "points", "number"}}
           --  {"scope": {... "before", "trigger", "mode"}}     see `ScopeRequest`
           --  {"closer": {"start", "end", "points", "number"}}, {"hold": {"held"}}
           <-  {"status": ...}  ten times a second; {"error": ...}; {"waiting": {"low", "high"}} of a trigger
           <-  numbers, see `live`

It reads the ring, which costs the loop nothing; a slow reader gets fewer frames, and delays nobody.
"""

import asyncio
import json
import time
from collections.abc import Awaitable, Callable, Iterator
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from stagectl.recording.joined_rings import Joined, Source
from stagectl.recording.ring import Ring
from stagectl.recording.triggering import Settings, Trigger
from stagectl.service.axis_controller import AxisController, ServiceError
from stagectl.service.limits import WORK_SHARE
from stagectl.service.service import Service
from stagectl.web import limits
from stagectl.web.bodies import wrong
from stagectl.web.channels import Channel, channels, chosen, level, side_by_side
from stagectl.web.limits import FREE_PAUSE, HELD_OFF, LEAST_PAUSE, LONGEST_SHARE, RATE, STATUS_PERIOD, WAITING
from stagectl.web.live import ScopeView, Strip, Window

_Name = Annotated[str, Field(max_length=limits.AXIS_NAME)]
_Channels = Annotated[
    list[Annotated[str, Field(max_length=limits.CHANNEL_NAME)]], Field(max_length=limits.CHANNELS_NAMED)
]
_Points = Annotated[int, Field(ge=limits.LEAST_POINTS, le=limits.MOST_POINTS)]
_Number = Annotated[int, Field(ge=0, le=limits.LARGEST_NUMBER)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class StripRequest(_Strict):
    """Channels of a continuous strip chart."""

    axis: _Name = ""
    channels: _Channels
    span: float = Field(10.0, gt=0.0, le=limits.LONGEST_STRIP, description="s that the viewer shows.")
    points: _Points = 600
    number: _Number = 0  # comes back with each message


class TriggerRequest(_Strict):
    """The trigger of a scope."""

    channel: Annotated[str, Field(max_length=limits.CHANNEL_NAME)]
    level: str = Field(max_length=limits.LEVEL, description="With its unit: '1 um'.")
    edge: Literal["rising", "falling", "both"] = "rising"


class ScopeRequest(_Strict):
    """A scope; `off`: none."""

    axis: _Name = ""
    channels: _Channels
    span: float = Field(1.0, ge=limits.SHORTEST_SCOPE, le=limits.LONGEST_SCOPE, description="s of a capture.")
    before: float = Field(0.2, ge=0.0, le=1.0, description="Share of it before the trigger.")
    points: _Points = 1000
    trigger: TriggerRequest | None = None
    mode: Literal["auto", "normal", "single", "off"] = "auto"
    number: _Number = 0


class DetailRequest(_Strict):
    """A part of the held capture, at finer resolution."""

    start: float  # s, from the trigger
    end: float
    points: _Points = 1000
    number: _Number = 0


class HoldRequest(_Strict):
    """Whether the scope stays with what it has; the next scope goes on."""

    held: bool = True


_KINDS: dict[str, type[_Strict]] = {
    "strip": StripRequest,
    "scope": ScopeRequest,
    "closer": DetailRequest,
    "hold": HoldRequest,
}


_FORM = (
    f'a message is a JSON object with one key of {", ".join(_KINDS)}, such as {{"strip": {{"channels": ["error"]}}}}'
)


def read(text: str) -> StripRequest | ScopeRequest | DetailRequest | HoldRequest | None:
    """One message; None for a key, or ``{}``, which may go first everywhere.  Raises ServiceError where it is none."""
    try:
        message = json.loads(text)
        if message == {} or message.keys() == {"key"}:
            return None
        (kind, body), *more = message.items()
        if more or kind not in _KINDS:
            raise ServiceError(_FORM)
        request = _KINDS[kind].model_validate(body)
    except ValidationError as error:
        raise ServiceError(wrong(error.errors(), kind)) from error
    except (ValueError, AttributeError) as error:
        raise ServiceError(_FORM) from error
    assert isinstance(request, StripRequest | ScopeRequest | DetailRequest | HoldRequest)
    return request


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
            if request is None:
                return None
            if isinstance(request, DetailRequest):
                view, part = self._view, request
                return view[0].closer(part.start, part.end, part.points, part.number) if view else None
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
        if self._strip is not None and self._strip[1] is not self._axis(self._strip[2].axis).ring:
            self._strip = self._stripes(self._strip[2])
        if self._view is not None and not self._held and self._gone(self._view[1]):
            self._view = self._scope(self._view[2])

    def _gone(self, source: Source) -> bool:
        """Whether nobody writes there any more, or the axes began anew."""
        rings = [axis.ring for axis in self._service.axes.values()]
        looked_at = source.rings if isinstance(source, Joined) else (source,)
        return any(ring not in rings for ring in looked_at) or (isinstance(source, Joined) and source.apart)

    def _axis(self, name: str) -> AxisController:
        """The axis called `name`; the first one where it is empty: to look at one moves nothing."""
        return self._service.axis(name or next(iter(self._service.axes)))

    def _stripes(self, p: StripRequest) -> tuple[Strip, Ring, StripRequest]:
        axis = self._axis(p.axis)
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
        axis = self._axis(p.axis)
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
