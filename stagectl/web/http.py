"""The control interface: HTTP, described by its OpenAPI document at ``/openapi.json``.

On the Unix socket the permissions of the socket decide who may move the axis.  On TCP a token is asked for, see `door`.
A request ends at the board; the loop never sees it.  The live page's part of it is in ``page/``.
"""

import json
from collections.abc import Awaitable, Callable
from typing import Annotated, Any

from fastapi import Depends, FastAPI, Query, Request, Response
from pydantic import BaseModel, Field

from stagectl.config.bounds import LARGEST_FILE
from stagectl.service import planning
from stagectl.service.axis_controller import AxisController
from stagectl.service.axis_status import noted
from stagectl.service.jog import Jogs
from stagectl.service.orders import OrderHandler
from stagectl.service.service import Service
from stagectl.web import refusals, routes
from stagectl.web.bodies import STOPS, JsonRoute, Strict, check_no_body, check_query, for_client
from stagectl.web.limits import AXES, AXIS_NAME, EFFECTS, FILE_NAME, GAINS, LARGEST_NUMBER, PLACE, QUANTITY, TABLES

AxisName = Annotated[str, Query(max_length=AXIS_NAME, description="Name of the axis; empty: all of them.")]
NamedAxis = Annotated[str, Field(max_length=AXIS_NAME)]  # a constrained key is looked at: it must be text
NamedPlace = Annotated[str, Field(max_length=PLACE, examples=["motor.cogging"])]
Length = Annotated[str, Field(min_length=1, max_length=QUANTITY, examples=["10 mm"], description="With its unit.")]


class Refusal(BaseModel):
    """Why it was not done, and what to do instead."""

    error: str


class Axis(BaseModel):
    """One axis now."""

    axis: str
    state: str
    state_words: str
    fault: str
    words: str
    unit: str
    position: float | None
    speed: float | None
    reference: float | None
    error: float | None
    current: float | None
    statusword: int
    warnings: list[str]
    homed: bool
    in_position: bool
    progress: float | None
    cycles: int
    late_cycles: int
    faults: int
    stop_time: float
    stop_distance: float | None


class Machine(BaseModel):
    """All axes now."""

    axes: list[Axis]
    alive: bool
    refused: list[str]


class Entry(BaseModel):
    """One entry of the fault list."""

    time: str
    axis: str
    fault: str
    words: str


class Move(Strict):
    """A move of one or several axes, which begin in one period; positions or distances."""

    to: dict[NamedAxis, Length] = Field(default_factory=dict, description="Position by axis.", max_length=AXES)
    by: dict[NamedAxis, Length] = Field(default_factory=dict, description="Distance by axis.", max_length=AXES)
    speed: Length | None = None
    acceleration: Length | None = None
    wait: bool = True


class Jog(Strict):
    """A key that is held: sent again and again until it is released, then `/v1/stop`."""

    axis: NamedAxis = ""
    press: float = Field(ge=0, le=LARGEST_NUMBER, description="Another number for each press.")
    speed: Length = Field(examples=["-5 mm/s"], description="Its sign is the direction.")


class Upload(Strict):
    """A trajectory file for one axis."""

    name: Annotated[str, Field(max_length=FILE_NAME)] = "trajectory"
    yaml: Annotated[
        str, Field(max_length=LARGEST_FILE, examples=["{type: sine, amplitude: 1 mm, frequency: 1 Hz, periods: 2}"])
    ]
    tables: dict[Annotated[str, Field(max_length=FILE_NAME)], str] = Field(
        default_factory=dict,
        max_length=TABLES,
        description="Text of the CSV files that it names; no other file is read.",
    )
    axis: NamedAxis = ""
    wait: bool = True
    unanswered: list[NamedPlace] = Field(
        default_factory=list, max_length=EFFECTS, description="Effects that this motion leaves to the feedback."
    )


class Effects(Strict):
    """Effects of one axis that the feedback alone answers from the next motion on, by the names of the list."""

    unanswered: list[NamedPlace] = Field(max_length=EFFECTS)
    axis: NamedAxis = ""


class Parameters(Strict):
    """Changes of `control`, values with units."""

    control: dict[NamedAxis, Length] = Field(max_length=GAINS)
    axis: NamedAxis = ""


_REFUSALS: dict[int | str, dict[str, Any]] = {
    400: {"model": Refusal, "description": "The body is not JSON."},
    409: {"model": Refusal, "description": "It cannot be done now."},
    422: {"model": Refusal, "description": "It can never be done: a wrong value, a limit."},
}
_GUARDED: dict[int | str, dict[str, Any]] = {
    408: {"model": Refusal, "description": "The body has not come in time."},
    413: {"model": Refusal, "description": "The body is too large."},
    503: {"model": Refusal, "description": "All seats for readers, or all for owners, are taken."},
    401: {"model": Refusal, "description": "TCP: the token is missing or wrong."},
    403: {"model": Refusal, "description": "TCP: reading only."},
}


def application(service: Service, port: routes.Port = routes.Port()) -> FastAPI:  # noqa: B008  # a constant
    """The whole interface; `port` is the TCP port that the page reports."""
    app = FastAPI(
        title="stagectl",
        version="1",
        docs_url=None,
        redoc_url=None,
        responses=_GUARDED,
        dependencies=[Depends(check_query)],
        redirect_slashes=False,  # to a client that does not follow, an empty answer
    )
    app.router.route_class = JsonRoute
    refusals.add(app)
    _reading(app, service)
    orders = OrderHandler(service)
    _moving(app, orders)
    _changing(app, orders)
    routes.add(app, service, port, _REFUSALS)
    return app


def _reading(app: FastAPI, service: Service) -> None:
    @app.get("/v1/status", response_model=Machine)
    async def status() -> Response:
        """All axes, now."""
        text = json.dumps(service.machine_json())
        return Response(text, media_type="application/json")  # not validated: requested often

    @app.get("/v1/faults", response_model=list[Entry])
    async def faults() -> list[dict[str, Any]]:
        """What stopped axes or processes, oldest first."""
        return list(service.faults)

    @app.get("/v1/parameters", response_model=dict[str, dict[str, float]])
    async def parameters() -> dict[str, dict[str, float]]:
        """The numbers of `control` by axis, SI."""
        return {name: axis.parameters() for name, axis in service.axes.items()}

    @app.get("/v1/parameters/written", response_model=dict[str, dict[str, str]])
    async def written() -> dict[str, dict[str, str]]:
        """The same with their units, angles in degrees, as `PATCH /v1/parameters` takes them."""
        return {name: axis.written_parameters() for name, axis in service.axes.items()}

    @app.get("/v1/effects", response_model=dict[str, dict[str, bool]])
    async def effects() -> dict[str, dict[str, bool]]:
        """Effects of the model by axis: whether a current answers each."""
        return {name: axis.effects() for name, axis in service.axes.items()}


def _moving(app: FastAPI, orders: OrderHandler) -> None:
    def verb(path: str, order: Callable[[list[AxisController]], Awaitable[dict[str, str] | None]]) -> None:
        async def do(request: Request, axis: AxisName = "") -> dict[str, Any]:
            if f"/v1/{path}" not in STOPS:
                await check_no_body(request)
            return noted(await order(orders.service.chosen(axis)), orders.service.machine_json())

        do.__name__ = path.replace("-", "_").replace("/", "_")
        app.post(f"/v1/{path}", response_model=Machine, responses=_REFUSALS, description=order.__doc__)(do)

    verb("enable", orders.enable)
    verb("home", orders.home)
    for path, stop in (("disable", orders.disable), ("stop", orders.stop), ("quick-stop", orders.quick_stop)):
        verb(path, stop)
    verb("faults/reset", orders.reset)

    @app.post("/v1/move", response_model=Machine, responses=_REFUSALS)
    async def move(body: Move, request: Request) -> dict[str, Any]:
        """Move axes to positions or by distances; with `wait` it answers when they stand in position."""
        await for_client(request, orders.move(body.to, body.by, (body.speed, body.acceleration), body.wait))
        return orders.service.machine_json()

    jogs = Jogs(orders)

    @app.post("/v1/jog", response_model=Machine, responses=_REFUSALS)
    async def jog(body: Jog) -> dict[str, Any]:
        """Move while a key is held; the axis brakes 0.3 s after the last of these requests, and before the limits."""
        await jogs.hold(body.axis, body.press, body.speed)
        return orders.service.machine_json()

    @app.post("/v1/trajectory", response_model=Machine, responses=_REFUSALS)
    async def trajectory(body: Upload, request: Request) -> dict[str, Any]:
        """Run a trajectory file from where the axis stands; a client that goes before it begins calls it off."""
        upload = planning.Upload(body.yaml, body.tables, tuple(body.unanswered))
        await for_client(request, orders.trajectory(body.axis, body.name, upload, body.wait))
        return orders.service.machine_json()


def _changing(app: FastAPI, orders: OrderHandler) -> None:
    @app.patch("/v1/effects", response_model=dict[str, bool], responses=_REFUSALS)
    async def leave(body: Effects) -> dict[str, bool]:
        """Leave effects to the feedback from the next motion on, as their compensation makes the error grow."""
        orders.leave(body.axis, body.unanswered)
        return orders.service.axis(body.axis).effects()

    @app.patch("/v1/parameters", response_model=Machine, responses=_REFUSALS)
    async def change(body: Parameters) -> dict[str, Any]:
        """Change gains while it runs, without a jump of the current."""
        return noted(await orders.change(body.axis, body.control), orders.service.machine_json())
