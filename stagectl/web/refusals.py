"""How an error becomes an answer of the interface: status and words."""

from collections.abc import Awaitable, Callable
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from starlette.routing import Match, Route, WebSocketRoute

from stagectl.problem import nearest
from stagectl.realtime.shared_memory import BoardFullError
from stagectl.service.axis_controller import AbsentError, ServiceError
from stagectl.units import StageError
from stagectl.web.bodies import refusal, wrong

_STATUS: dict[int | type[Exception], int] = {
    **{AbsentError: 404, ServiceError: 409, BoardFullError: 409, StageError: 422},
    **{status: status for status in (400, 422)},
}


def add(app: FastAPI) -> None:
    """Let the interface answer so."""
    for cause, status in _STATUS.items():
        app.add_exception_handler(cause, _refusal(status))
    app.add_exception_handler(404, _absent)
    app.add_exception_handler(405, _not_allowed)
    app.add_exception_handler(RequestValidationError, _malformed)


def _refusal(status: int) -> Callable[[Request, Exception], Awaitable[Response]]:
    async def answer(_: Request, error: Exception) -> Response:
        return refusal(status, str(getattr(error, "detail", error)))

    return answer


async def _not_allowed(request: Request, _: Exception) -> Response:
    """405 with every method of the path; each is a route."""
    known = (route for route in request.app.routes if isinstance(route, Route))
    fitting = [route for route in known if route.matches(request.scope)[0] != Match.NONE]
    methods = ", ".join(sorted({name for route in fitting for name in route.methods or ()}))
    return refusal(405, f"{request.method} {request.url.path}: only {methods}", Allow=methods)


async def _malformed(request: Request, error: Exception) -> Response:
    details: list[dict[str, Any]] = getattr(error, "errors", list)()
    if [(one["type"], tuple(one["loc"])) for one in details] == [("missing", ("body",))]:
        names = ", ".join(request.scope["route"].dependant.body_params[0].field_info.annotation.model_fields)
        hint = f"send a JSON object with some of {names}; GET /openapi.json describes them"
        return refusal(422, f"the body is missing: {hint}")
    unread = request.headers.get("content-length", "0") != "0" and "json" not in request.headers.get("content-type", "")
    words = "the body is not read as JSON: send the header Content-Type: application/json" if unread else wrong(details)
    return refusal(422, words or str(error))


async def _absent(request: Request, _: Exception) -> Response:
    path = request.url.path
    near = nearest(path, [route.path for route in request.app.routes if isinstance(route, Route)])
    meant = f"did you mean {near}? " if near else ""
    words = f"there is no such path; {meant}GET /openapi.json lists all"
    if any(isinstance(route, WebSocketRoute) and route.path == path for route in request.app.routes):
        words = "it is a WebSocket: connect to it by ws://, see docs/page.md"
    return refusal(404, f"{request.method} {path}: {words}")
