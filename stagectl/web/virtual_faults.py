"""Faults for the virtual drive of an axis, from the page: what `stagectl inject` does.  A real drive takes none."""

import asyncio
from typing import Annotated, Any

from fastapi import FastAPI
from pydantic import BaseModel, Field

from stagectl.config.fault_words import read_fault
from stagectl.drives.drive import Canopen
from stagectl.drives.faults import BLOCKS, TABLE
from stagectl.drives.virtual.inject import ask, socket_path
from stagectl.service.axis_controller import AxisController, ServiceError
from stagectl.service.service import Service
from stagectl.units import StageError
from stagectl.web.bodies import Strict
from stagectl.web.limits import AXIS_NAME, FILE_NAME, QUANTITY, TABLES


class Injection(Strict):
    """A fault of the virtual drive; an empty name ends all of them."""

    axis: Annotated[str, Field(max_length=AXIS_NAME)] = ""
    fault: Annotated[str, Field(max_length=FILE_NAME, examples=["encoder-stuck"])]
    parameters: list[Annotated[str, Field(max_length=QUANTITY, examples=["duration=0.5 s"])]] = Field(
        default_factory=list, max_length=TABLES
    )


class FaultKind(BaseModel):
    """What can fail."""

    fault: str
    words: str


class Acting(BaseModel):
    """The faults that act now."""

    active: list[str]


def may_be_virtual(axis: AxisController) -> bool:
    """Whether the drive of this axis is on a bus that only virtual ones are on."""
    wire = axis.setup.file.drive.wire
    return isinstance(wire, Canopen) and wire.interface == "embedded"


def add(app: FastAPI, service: Service, refusals: dict[int | str, dict[str, Any]]) -> None:
    """Add it to the interface."""

    @app.get("/v1/virtual/faults", response_model=list[FaultKind])
    async def kinds() -> list[dict[str, str]]:
        """What can fail in a virtual drive."""
        return [{"fault": kind.name, "words": kind.words} for kind in TABLE if kind.name in BLOCKS]

    @app.post("/v1/virtual/faults", response_model=Acting, responses=refusals)
    async def inject(body: Injection) -> dict[str, Any]:
        """Let the virtual drive fail, or end all its faults."""
        axis = service.axis(body.axis)
        wire = axis.setup.file.drive.wire
        if not isinstance(wire, Canopen) or not may_be_virtual(axis):
            raise ServiceError(f"{axis.name}: faults can be injected on the embedded bus only: see `stagectl selftest`")
        try:
            request = {"do": "clear"}
            if body.fault:
                request = {"do": "add", "fault": read_fault(body.fault, body.parameters)._asdict()}
            return await asyncio.to_thread(ask, socket_path(wire.interface, wire.channel, wire.node), request)
        except StageError as error:
            raise ServiceError(str(error)) from error
