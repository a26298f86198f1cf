"""The page's part of the interface: its files, who may do what, recordings, and the live connection."""

import asyncio
import contextlib
import json
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from fastapi import FastAPI, Query, Request, Response, WebSocket, WebSocketDisconnect
from fastapi import Path as InPath
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field

from stagectl.service.axis_controller import ServiceError
from stagectl.service.limits import MOVING_VIEWERS, READING_VIEWERS
from stagectl.service.recordings import LONGEST
from stagectl.service.service import Service
from stagectl.web import assets, virtual_faults
from stagectl.web.access_control import Permission
from stagectl.web.bodies import Strict, first_ended, for_client, refusal
from stagectl.web.channels import channels, described
from stagectl.web.export import Exports
from stagectl.web.limits import AXIS_NAME, FILE_NAME, KEY_TIME, PATH_PART, REACHED_BACK, RECORDED
from stagectl.web.seats import leaves, seated, stays
from stagectl.web.status_feed import StatusFeed
from stagectl.web.viewer import Viewer

LIVE = "/v1/live"
STATIC = Path(__file__).parent / "static"
_VIEWERS = {Permission.READ: READING_VIEWERS, Permission.MOVE: MOVING_VIEWERS}
_UNASKED = 1008, 1013  # close codes: who may not, too many
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}
Part = Annotated[str, InPath(max_length=PATH_PART)]


class Record(Strict):
    """A recording to be begun."""

    axis: Annotated[str, Field(max_length=AXIS_NAME)] = ""
    name: Annotated[str, Field(max_length=FILE_NAME, description="Of the file; empty: the time.")] = ""
    before: float = Field(0.0, ge=0.0, le=REACHED_BACK, description="s before now, as far as they are still there.")
    seconds: float = Field(RECORDED, gt=0.0, le=LONGEST, description="s after which it ends by itself.")


class Granted(BaseModel):
    """Your permissions."""

    read: bool
    move: bool


class File(BaseModel):
    """One file that can be downloaded."""

    kind: str
    axis: str
    file: str
    bytes: int
    time: float
    going_on: bool


Refusals = dict[int | str, dict[str, Any]]


class Port(NamedTuple):
    """The TCP port, if there is one."""

    address: str | None = None
    key: str = ""  # what moves there


def add(app: FastAPI, service: Service, port: Port, refusals: Refusals) -> None:
    """Add it to the interface; `refusals` are what the OpenAPI document says of orders that cannot be carried out."""
    _files(app)
    _reading(app, service)
    _recording(app, service, refusals)
    _live(app, service)
    virtual_faults.add(app, service, refusals)

    @app.post("/v1/page", response_model=dict[str, str], responses=refusals)
    async def page() -> dict[str, str]:
        """The page's address, with the key that may move the axis."""
        if port.address is None:
            raise ServiceError("the service has no TCP port: start it with `stagectl serve ... --tcp 127.0.0.1:8402`")
        return {"address": f"{port.address}#{port.key}"}


def _files(app: FastAPI) -> None:
    def sent(folder: Path, name: str) -> Response:
        path = folder / name
        if not path.is_file() or path.parent != folder:
            return Response(status_code=404)
        return FileResponse(path, headers=_HEADERS)

    @app.get("/", include_in_schema=False)
    async def index() -> Response:
        return sent(STATIC, "index.html")

    @app.get("/page/{name}", include_in_schema=False)
    async def static(name: Part) -> Response:
        return sent(STATIC, name)

    @app.get("/page/plots/{name}", include_in_schema=False)
    async def plots(name: Part) -> Response:
        folder = assets.available()
        return sent(folder, name) if folder is not None and name in assets.FILES else Response(status_code=404)


def _reading(app: FastAPI, service: Service) -> None:
    @app.get("/v1/me", response_model=Granted)
    async def me(request: Request) -> dict[str, bool]:
        """The permissions of this request."""
        may = request.scope.get("may", Permission.MOVE)
        return {"read": may >= Permission.READ, "move": may >= Permission.MOVE}

    @app.get("/v1/channels", response_model=dict[str, dict[str, dict[str, str]]])
    async def known() -> dict[str, dict[str, dict[str, str]]]:
        """What a scope can show, by axis: unit and meaning."""
        return {axis.name: described(channels(axis.setup)) for axis in service.axes.values()}


def _recording(app: FastAPI, service: Service, refusals: Refusals) -> None:
    exports = Exports()

    @app.get("/v1/recordings", response_model=list[File])
    async def files() -> list[dict[str, Any]]:
        """Recordings and black boxes, the newest first."""
        return await asyncio.to_thread(service.recordings.files)

    @app.post("/v1/recordings", response_model=dict[str, str], responses=refusals)
    async def begin(body: Record) -> dict[str, str]:
        """Begin to record an axis."""
        axis = service.axis(body.axis)
        path = service.recordings.begin(axis, body.name, body.before, body.seconds)
        return {"axis": axis.name, "file": path.name, "path": str(path)}

    @app.post("/v1/recordings/end", response_model=dict[str, str], responses=refusals)
    async def end(axis: Annotated[str, Query(max_length=AXIS_NAME)] = "") -> dict[str, str]:
        """End the recording of an axis."""
        recorded = service.axis(axis)
        path = await asyncio.to_thread(service.recordings.end, recorded.name)
        return {"axis": recorded.name, "file": path.name, "path": str(path)}

    absent = {**refusals, 404: {**refusals[409], "description": "There is no such recording."}}

    @app.get("/v1/recordings/{kind}/{axis}/{file}", response_class=FileResponse, responses=absent)
    async def one(
        request: Request, kind: Part, axis: Part, file: Part, to: Literal["h5", "csv", "parquet", "mat", "mcap"] = "h5"
    ) -> Response:
        """A file, as it is or for other programs."""
        path = await asyncio.to_thread(service.recordings.path, kind, axis, file)
        machine = service.axes[axis].setup.file.name if axis in service.axes else ""
        answer: Response = await for_client(request, exports.file(path, to, machine))
        return answer


def _live(app: FastAPI, service: Service) -> None:
    viewers: dict[Viewer, Permission] = {}
    feed = StatusFeed(service)

    @app.websocket(LIVE)
    async def live(link: WebSocket) -> None:
        try:
            with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):  # it has gone
                await link.accept()
                await seen(link, await _may(link))
        finally:
            leaves(link.scope)

    @app.websocket("/{path:path}")
    async def elsewhere(link: WebSocket) -> None:
        words = f"{link.url.path}: there is no live connection here; connect to {LIVE}"
        await link.send_denial_response(refusal(404, words))

    async def seen(link: WebSocket, may: Permission) -> None:
        if may is Permission.NOTHING:
            await link.close(_UNASKED[0], 'the key is missing or wrong; it goes first, as {"key": "..."}')
            return
        if list(viewers.values()).count(may) >= _VIEWERS[may] or not seated(link.scope, may):
            await link.close(_UNASKED[1], f"{_VIEWERS[may]} viewers are connected")
            return
        stays(link.scope)

        async def say(what: str | bytes) -> None:
            await (link.send_bytes(what) if isinstance(what, bytes) else link.send_text(what))

        viewer = Viewer(service, feed.status, say)
        viewers[viewer] = may
        try:
            await say(json.dumps({"may": {"move": may is Permission.MOVE}, "machine": feed.machine()}))
            await _served(link, viewer)
        finally:
            del viewers[viewer]


async def _may(link: WebSocket) -> Permission:
    """What its first message grants; on the Unix socket, everything without one."""
    keys = link.scope.get("keys")
    if keys is None:
        return Permission.MOVE
    with contextlib.suppress(WebSocketDisconnect, asyncio.TimeoutError, ValueError, AttributeError):
        message = json.loads(await asyncio.wait_for(_text(link), KEY_TIME))
        return Permission(keys.grant(str(message.get("key", ""))))
    return Permission.NOTHING


async def _served(link: WebSocket, viewer: Viewer) -> None:
    """Hear and show until either ends."""
    for task in await first_ended(viewer.show(), _heard(link, viewer)):
        with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):  # it has gone
            task.result()


async def _heard(link: WebSocket, viewer: Viewer) -> None:
    while True:
        await viewer.hear(await _text(link))


async def _text(link: WebSocket) -> str:
    """The next message; one of bytes is none, and empty.  Raises WebSocketDisconnect."""
    message = await link.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message["code"])
    return message.get("text") or ""
