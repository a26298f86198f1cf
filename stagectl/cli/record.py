"""The command `record`: rows of a running service as a file."""

import contextlib
import time
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

import typer

from stagectl.api.arguments import Update, quantity
from stagectl.cli.options import Json, OneAxis, Socket, option
from stagectl.cli.service import ask_service
from stagectl.cli.show import console, emit, progress
from stagectl.problem import Problem, ProblemKind, why_unread
from stagectl.service.shutdown_signals import STOPS, held_back
from stagectl.units import Quantity, StageError
from stagectl.web.limits import REACHED_BACK

_LOOK = 0.1  # s between two looks at a recording
_LONGEST = 86400.0  # s of a recording without an end
_FOR = Quantity("s", f"(0, {_LONGEST:g}]", "duration")
_PAST = Quantity("s", f"[0, {REACHED_BACK:g}]", "time before now")


def record(
    output: Annotated[Path | None, option("--output -o FILE.h5", "Output file; default: the service keeps it.")] = None,
    time_: Annotated[str | None, option("--for TIME", "Duration; default: until Ctrl-C.")] = None,
    before: Annotated[str, option("--before TIME", "Include this much of the past, as far as available.")] = "0 s",
    end: Annotated[bool, option("--end", "End the recording that goes on, instead of beginning one.")] = False,
    name: Annotated[str, option("--name NAME", "Name of the service's file; default: the time.")] = "",
    axis: OneAxis = "",
    socket: Socket = None,
    json: Json = None,
) -> None:
    """Record an axis of the running service at full rate; the loop is not involved.

    Example: stagectl record --for "10 s" -o recordings/now.h5
    """
    if output is not None:
        from stagectl.recording.hdf5 import check_target

        check_target(output)
    seconds = quantity("for", time_, _FOR, "it such as '10 s'") if time_ else _LONGEST
    past = quantity("before", before, _PAST, "it such as '2 s'")
    body = {"axis": axis, "name": name, "before": past, "seconds": seconds}
    recorded = _ended(axis, socket) if end else _recorded(body, bool(time_), socket)
    result = {"axis": recorded["axis"], "recording": recorded["path"]}
    if output is not None:
        _fetched(recorded, output, socket)
        result["recording"] = str(output)
    console.print(f"recorded: {result['recording']}")
    emit(result, json)


def _ended(axis: str, socket: Path | None) -> dict[str, str]:
    """End the recording that goes on, whoever began it."""
    recorded: dict[str, str] = ask_service(socket, "POST", f"/v1/recordings/end?axis={quote(axis)}")
    return recorded


def _recorded(body: dict[str, Any], bounded: bool, socket: Path | None) -> dict[str, str]:
    """Begin a recording and wait for its end, or end it when the operator does.

    Who interrupts while the service begins it waits for the answer: the recording would go on unattended.  The bar is
    loaded before: an interrupt in an import ends the process by the signal, whatever is caught.  Its thread begins with
    the signals held back, too: one that any thread takes interrupts the main thread.
    """
    begun: dict[str, str] = {}
    seconds = body["seconds"] if bounded else 0.0
    try:
        with contextlib.ExitStack() as bar:
            with held_back(*STOPS):
                update = bar.enter_context(progress("record", max(round(10 * seconds), 1)))
                begun.update(ask_service(socket, "POST", "/v1/recordings", body))
            console.print(f"recording {begun['axis']}" + ("" if bounded else "; Ctrl-C ends"))
            _until_whole(begun, seconds, socket, update)
    except (KeyboardInterrupt, OSError):  # OSError: the terminal has gone, and takes no progress any more
        if not begun:
            raise
        _ended(begun["axis"], socket)
    return begun


def _fetched(begun: dict[str, str], output: Path, socket: Path | None) -> None:
    """Copy the service's file to `output`.  Raises StageError, which says where the rows are."""
    from stagectl.web.client import default_socket, fetch

    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        fetch(socket or default_socket(), begun["axis"], begun["file"], output)
    except (OSError, StageError) as error:
        remedy = f"the service keeps the rows in {begun['path']}: copy them from there"
        reason = f"{output} cannot be written: {why_unread(error)}"
        raise StageError(Problem(reason, ProblemKind.FILE, remedy=remedy, file=output)) from error


def _until_whole(begun: dict[str, str], seconds: float, socket: Path | None, update: Update) -> None:
    """Wait for the end of the file, with a bar if it is known.  Without rows there is no file: exit 1."""
    began = time.monotonic()
    while True:
        files = ask_service(socket, "GET", "/v1/recordings")
        mine = [file for file in files if (file["axis"], file["file"]) == (begun["axis"], begun["file"])]
        if not mine:
            words = f"nothing was recorded: {begun['axis']} gave no rows"
            console.print(f"{words}: see `stagectl status` and `stagectl fault list`", style="red")
            raise typer.Exit(1)
        if not mine[0]["going_on"]:
            return
        elapsed = time.monotonic() - began
        update(min(round(10 * elapsed), round(10 * seconds)), max(round(10 * seconds), 1), f"record {begun['file']}")
        time.sleep(_LOOK)
