"""The body of a request: taken whole, in time and of a bounded size, before anything else looks at it."""

import asyncio
import json
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from fastapi import HTTPException
from fastapi.routing import APIRoute
from pydantic import BaseModel, ConfigDict, model_validator
from pydantic_core import PydanticCustomError
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse

from stagectl.problem import below
from stagectl.service.axis_controller import ServiceError
from stagectl.service.limits import BODY, BODY_TIME, STRUCTURE, UPLOAD
from stagectl.units import StageError

STOPS = ("/v1/disable", "/v1/stop", "/v1/quick-stop")  # no form of a request keeps an axis from stopping
UPLOADS = ("/v1/trajectory",)  # take larger bodies


class Strict(BaseModel):
    """A body whose unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", strict=True)

    @model_validator(mode="before")
    @classmethod
    def _known(cls, given: Any) -> Any:
        """Refuse unknown keys with those that there are: pydantic's own error does not know them."""
        odd = [key for key in given if key not in cls.model_fields] if isinstance(given, dict) else []
        if odd:
            told = {"odd": ", ".join(map(str, odd)), "known": ", ".join(cls.model_fields)}
            raise PydanticCustomError("unknown_key", "{odd} is not known here; known are {known}", told)
        return given


_WORDS = {
    "extra_forbidden": "is not known here; GET /openapi.json says what is",
    "json_invalid": "the body is not JSON from this character on: names and texts need double quotes",
    "bool_type": "must be true or false, without quotes",
    **dict.fromkeys(("float_type", "float_parsing"), "must be a number, without quotes or unit"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "must be a whole number, without quotes or unit"),
    "finite_number": "must be a finite number",
    "dict_type": 'must be an object, such as {"x": "5 mm"}',
    "list_type": 'must be a list, such as ["error"]',
    "string_type": 'must be text, a number with its unit in quotes, such as "5 mm" or "30 Hz"',
    "string_too_short": "must not be empty: leave it out instead",
    **dict.fromkeys(("model_type", "model_attributes_type"), "must be a JSON object: keys and values in braces"),
    "missing": "is missing",
}
_BOUNDS = {
    "greater_than": "must be above {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be below {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "literal_error": "must be {expected}",
}


def wrong(details: Iterable[Mapping[str, Any]], place: str = "") -> str:
    """What pydantic found wrong with a message at this `place`, each entry with its own."""
    return "; ".join(
        below(place, _wrong_entry(one)) if one["loc"] else f"{place}{_wrong_entry(one)}" for one in details
    )


def _wrong_entry(one: Mapping[str, Any]) -> str:
    bound = _BOUNDS.get(one["type"])
    words = bound.format_map(one["ctx"]) if bound else _WORDS.get(one["type"], one["msg"])
    if one["type"] == "json_invalid":  # its place is a character, not a key
        return f"{one['loc'][0]}, character {one['loc'][-1] + 1}: {words}"
    shown = f" = {_shown(one['input'])}" if bound else ""
    return f"{'.'.join(map(str, one['loc']))}{shown}: {words}"


def _shown(given: Any) -> str:
    return json.dumps(given) if isinstance(given, str) else f"{given:g}"


class _JsonRequest(Request):
    """A request whose body is read by `parsed`."""

    async def json(self) -> Any:
        """The body."""
        return parsed(await self.body())


class JsonRoute(APIRoute):
    """A route whose body is read by `parsed`."""

    def get_route_handler(self) -> Callable[[Request], Any]:
        """What answers a request."""
        answer = super().get_route_handler()

        async def handle(request: Request) -> Any:
            return await answer(_JsonRequest(request.scope, request.receive))

        return handle


def parsed(body: bytes) -> Any:
    """JSON in UTF-8 that says every key once; raises HTTPException, or what `json.loads` raises."""
    try:
        text = body.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        words = f"the body is not UTF-8 from byte {error.start} on ({body[error.start]:#04x}): send UTF-8"
        raise HTTPException(400, words) from error
    return json.loads(text, object_pairs_hook=_each_once)


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object; of a key that it says twice nobody knows which is meant."""
    entries = dict(pairs)
    if len(entries) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise HTTPException(422, f"the body says {json.dumps(twice)} twice, and nothing was done: remove one")
    return entries


async def check_no_body(request: Request) -> None:
    """Raise StageError where a request has a body that is not read: all axes would go, not the one meant."""
    if await request.body() not in (b"", b"{}", b"null"):
        path = request.url.path
        raise StageError(f"{path} takes no body, and nothing was done: name one axis as {path}?axis=x")


async def check_query(link: HTTPConnection) -> None:
    """Raise StageError where an address has a word behind its path that would be ignored in silence."""
    route = link.scope["route"]
    if not isinstance(route, APIRoute) or not route.include_in_schema or route.path in STOPS:
        return
    taken = [field.alias for field in route.dependant.query_params]
    if odd := sorted(set(link.query_params) - set(taken)):
        known = " and ".join(f"`{name}`" for name in taken) or "nothing behind a ?"
        raise StageError(f"{route.path} takes {known}, not {', '.join(f'`{name}`' for name in odd)}; nothing was done")


class Bodies:
    """Hands requests on with their bodies; refuses those that are too large (413) or too slow (408)."""

    def __init__(self, app: Any) -> None:
        self._app = app

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """One request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        most = UPLOAD if scope["path"] in UPLOADS else BODY
        try:
            body = await asyncio.wait_for(_whole(scope, receive, most), BODY_TIME)
        except TimeoutError:
            await refusal(408, f"the body has not come within {BODY_TIME:g} s", Connection="close")(
                scope, receive, send
            )
            return
        if body is None or structure(body) > STRUCTURE:
            await refusal(413, _too_large(scope, body, most), Connection="close")(scope, receive, send)
            return
        await self._app(scope, _replayed(body, receive), send)


def _too_large(scope: Any, body: bytes | None, most: int) -> str:
    """Why a body is refused; None is one of more than `most` bytes."""
    if body is not None:
        return f"the body has {structure(body)} bytes of numbers, keys and brackets; must have at most {STRUCTURE}"
    length = _length(scope)
    return f"the body has {length if length > most else f'more than {most}'} bytes; must have at most {most}"


def _length(scope: Any) -> int:
    """Bytes of the body as the header says; 0 where it does not."""
    length = dict(scope["headers"]).get(b"content-length", b"0")
    return int(length[:20]) if length.isdigit() else 0


async def _whole(scope: Any, receive: Any, most: int) -> bytes | None:
    """The body; None where it is larger than `most`."""
    if _length(scope) > most:
        return None
    body = bytearray()
    while len(body) <= most:
        message = await receive()
        body += message.get("body", b"")
        if not message.get("more_body", False):
            return bytes(body)
    return None


def structure(body: bytes) -> int:
    """Bytes of JSON outside its texts: what a parser makes objects of."""
    if len(body) <= STRUCTURE:
        return len(body)
    plain = body.replace(b"\\\\", b"").replace(b'\\"', b"")
    return sum(map(len, plain.split(b'"')[::2]))


def _replayed(body: bytes, receive: Any) -> Any:
    """A `receive` that gives the body, then what comes after it: that the client goes."""
    waiting = [{"type": "http.request", "body": body, "more_body": False}]

    async def next_message() -> Any:
        return waiting.pop() if waiting else await receive()

    return next_message


def refusal(status: int, words: str, **headers: str) -> JSONResponse:
    """The answer of the interface to what it does not do."""
    return JSONResponse({"error": words}, status, headers)


async def for_client(request: Request, work: Any) -> Any:
    """The result of this coroutine; it is cancelled when the client goes.  Raises ServiceError then, to nobody."""
    task = asyncio.ensure_future(work)
    if task not in await first_ended(task, _gone(request)):
        raise ServiceError("the client has gone")
    return task.result()


async def first_ended(*works: Any) -> set[asyncio.Future[Any]]:
    """Those of these coroutines and tasks that have ended once one has; the others are cancelled and have ended."""
    tasks = [asyncio.ensure_future(work) for work in works]
    try:
        return (await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED))[0]
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _gone(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
