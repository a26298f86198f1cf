"""The requests of a viewer, strictly checked."""

from __future__ import annotations

import json
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from stagectl.service.axis_controller import ServiceError
from stagectl.web import limits

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


def read(text: str) -> StripRequest | ScopeRequest | DetailRequest | HoldRequest:
    """One message.  Raises ServiceError where it is none."""
    try:
        (kind, body), *more = json.loads(text).items()
        if more or kind not in _KINDS:
            raise ServiceError(f"a message has one key of {', '.join(_KINDS)}")
        request = _KINDS[kind].model_validate(body)
    except ValidationError as error:
        words = "; ".join(f"{'.'.join(map(str, detail['loc']))}: {detail['msg']}" for detail in error.errors())
        raise ServiceError(words) from error
    except (ValueError, AttributeError) as error:
        raise ServiceError("a message is JSON with one key") from error
    assert isinstance(request, StripRequest | ScopeRequest | DetailRequest | HoldRequest)
    return request
