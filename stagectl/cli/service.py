"""Commands of the service: serve, and requests to a running one: status, enable, home, move, stop, fault ..."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from stagectl.cli import options
from stagectl.cli.addresses import foxglove_address, tcp_port
from stagectl.cli.options import argument, option
from stagectl.cli.show import console, emit, is_stage, reporter, without_compiler
from stagectl.extras import require
from stagectl.named_values import pairs
from stagectl.problem import Problem, ProblemKind
from stagectl.replacing import check_is_folder
from stagectl.service import shutdown_signals
from stagectl.units import StageError

fault = typer.Typer(help="What stopped the axes: list, reset.", no_args_is_help=True)


@shutdown_signals.held_back(*shutdown_signals.STOPS)
def serve(
    stages: options.Stages,
    socket: Annotated[Path | None, option("--socket PATH", "Control socket; default: $STAGECTL_SOCKET.")] = None,
    state: Annotated[
        Path | None, option("--state FOLDER", "Folder for black boxes; default: $STATE_DIRECTORY.")
    ] = None,
    channel: options.Channel = None,
    tcp: Annotated[
        str | None, option("--tcp HOST:PORT", "Serve the live page over TCP; a token allows reading.")
    ] = None,
    token: Annotated[Path | None, option("--token FILE", "File with the token; created if missing.")] = None,
    tcp_may_move: Annotated[bool, option("--tcp-may-move", "The token also allows moving.")] = False,
    foxglove: Annotated[
        str | None, option("--foxglove HOST:PORT", "Send every row to Foxglove; no access control.")
    ] = None,
    uncoupled: Annotated[bool, option("--uncoupled", "A fault of one axis does not stop the others.")] = False,
    json: options.Lines = None,
) -> None:
    """Run the machine as a service, for months: see docs/service.md.

    Example: stagectl serve config/ball-screw.yaml
    """
    without_compiler()
    require("service", "the service")
    from stagectl.runtime_folder import state_folder
    from stagectl.service.machine import machine, together, virtual
    from stagectl.service.service import Service, ServicePaths
    from stagectl.web.client import chosen_socket, own_socket
    from stagectl.web.server import run

    folder = state or state_folder()
    check_is_folder(folder)
    runtime = os.environ.get("RUNTIME_DIRECTORY")
    place = socket or chosen_socket() or (Path(runtime) / "control.sock" if runtime else own_socket())
    axes, coupled = machine(stages, channel), together(stages) and not uncoupled
    say = reporter(json, console.print)
    for name, axis in axes.items():
        if restless := axis.setup.having(control=axis.control).unrest:
            say(f"{name}: {restless}")
    service = Service(axes, ServicePaths(place, folder, foxglove_address(foxglove)), coupled, say)
    run(service, tcp_port(tcp, token or folder / "token", tcp_may_move, virtual(axes)))


def page(socket: options.Socket = None, json: options.Json = None) -> None:
    """Print the address of the live page, with the key that lets a browser move the axis.

    Example: stagectl page
    """
    result = ask_service(socket, "POST", "/v1/page")
    if json != "-":
        print(result["address"])
    emit(result, json)


def status(socket: options.Socket = None, json: options.Json = None) -> None:
    """Show the axes of the running service.

    Example: stagectl status
    """
    _show(ask_service(socket, "GET", "/v1/status"), json)


def _order(what: str, words: str, verb: str = "") -> Callable[..., None]:
    """The verb that gives one axis, or all, the order `what`; `words` are its help."""

    def order(axis: options.AxisName = "", socket: options.Socket = None, json: options.Json = None) -> None:
        _do(socket, f"{what}?axis={axis}", json)

    order.__doc__ = f"{words}\n\nExample: stagectl {verb or what}"
    return order


enable = _order("enable", "Switch power on; the axis holds its position.")
disable = _order("disable", "Stop, and switch power off.")
home = _order("home", "Find home by the method in the stage file's `homing`; without one, take the position as right.")


def move(
    target: Annotated[list[str], argument("POSITION...", "'10 mm', or x='10 mm' y='5 mm'.")],
    by: Annotated[bool, option("--by", "Distances from here instead of positions.")] = False,
    speed: Annotated[str | None, option("--speed SPEED", "For example '50 mm/s'.")] = None,
    acceleration: Annotated[str | None, option("--acceleration ACCELERATION", "For example '1 m/s^2'.")] = None,
    no_wait: options.NoWait = False,
    socket: options.Socket = None,
    json: options.Json = None,
) -> None:
    """Move, and return when the axes are in position.

    Example: stagectl move "10 mm" --speed "20 mm/s"
    """
    places = _places(target)
    body = {"by" if by else "to": places, "speed": speed, "acceleration": acceleration, "wait": not no_wait}
    _do(socket, "move", json, body)


def stop(
    axis: options.AxisName = "",
    quick: Annotated[bool, option("--quick", "Use the drive's ramp, then switch power off.")] = False,
    socket: options.Socket = None,
    json: options.Json = None,
) -> None:
    """Stop under control and hold; --quick: stop by the drive's ramp, power off.  Works even if the service hangs.

    Example: stagectl stop
    """
    from stagectl.web import client

    _show(answered(lambda: client.stop(socket or client.default_socket(), quick, axis)), json)


def follow(
    trajectory: options.TrajectoryArgument,
    axis: options.OneAxis = "",
    no_wait: options.NoWait = False,
    socket: options.Socket = None,
    json: options.Json = None,
) -> None:
    """Run a trajectory on the service, from the present position.

    Example: stagectl follow config/trajectories/sine-1.6hz.yaml
    """
    _do(socket, "trajectory", json, {**uploaded(trajectory), "axis": axis, "wait": not no_wait})


def uploaded(trajectory: Path) -> dict[str, Any]:
    """A trajectory file with its tables, as the service takes it."""
    from stagectl.config.source import read_text
    from stagectl.config.trajectory_file import tables_of

    if trajectory.is_file() and is_stage(trajectory):
        reason, remedy = f"{trajectory} is a stage file", "give a trajectory in its place"
        raise StageError(Problem(reason, ProblemKind.SHAPE, remedy=remedy, file=trajectory))
    text = read_text(trajectory)
    return {"name": trajectory.stem, "yaml": text, "tables": tables_of(trajectory, text)}


def parameters(
    changes: Annotated[list[str] | None, argument("[NAME=VALUE]...", "For example bandwidth='30 Hz'.")] = None,
    axis: options.AxisName = "",
    socket: options.Socket = None,
    json: options.Json = None,
) -> None:
    """Show or change gains of the running service, without a step of the current.

    Example: stagectl parameters bandwidth="30 Hz"
    """
    if changes:
        named = pairs("parameters", ",".join(changes), "NAME=VALUE", "bandwidth='30 Hz'")
        body = {"control": named, "axis": axis}
        for changed in ask_service(socket, "PATCH", "/v1/parameters", body)["axes"]:
            _warn(changed)
    for name, values in ask_service(socket, "GET", "/v1/parameters/written").items():
        console.print(f"{name}: " + ", ".join(f"{key} {value}" for key, value in values.items()))
    emit(ask_service(socket, "GET", "/v1/parameters"), json)


@fault.command("list")
def fault_list(socket: options.Socket = None, json: options.Json = None) -> None:
    """List what stopped axes or processes, oldest first.

    Example: stagectl fault list
    """
    result = ask_service(socket, "GET", "/v1/faults")
    for entry in result:
        console.print(f"{entry['time']} {entry['axis'] or 'service'}: {entry['fault']}: {entry['words']}")
    if not result:
        console.print("no faults since the service started")
    emit({"faults": result}, json)


_RESET = "Reset the fault: the drive is configured again and stays without power."
fault.command("reset")(_order("faults/reset", _RESET, "fault reset"))


def _places(target: list[str]) -> dict[str, str]:
    """The positions by their axes, "" where none is named.  Raises StageError where an axis has two."""
    places: dict[str, str] = {}
    for before, text in zip(["", *target], target, strict=False):
        name, equals, value = (part.strip() for part in text.rpartition("="))
        if before and not equals and value.isalpha():
            remedy = f'write `stagectl move "{before} {value}"`'  # the shell has taken a number and its unit apart
            raise StageError(Problem(f"{before} and {value} are two arguments", ProblemKind.SYNTAX, remedy=remedy))
        if name in places:
            twice = f"POSITION is given twice for {f'axis {name}' if name else 'one axis'}: {places[name]}, {value}"
            raise StageError(Problem(f"{twice}; nothing has moved", ProblemKind.REPEATED))
        places[name] = value
    return places


def _do(socket: Path | None, what: str, json: str | None, body: dict[str, Any] | None = None) -> None:
    _show(ask_service(socket, "POST", f"/v1/{what}", body), json)


def ask_service(socket: Path | None, method: str, what: str, body: dict[str, Any] | None = None) -> Any:
    """The answer of the service; exit code 1 for a refusal, 2 without an answer."""
    from stagectl.web.client import ask, default_socket

    return answered(lambda: ask(socket or default_socket(), method, what, body))


def answered(asked: Callable[[], Any]) -> Any:
    """What the service says; exit code 1 for a refusal."""
    from stagectl.web.client import RefusedError

    try:
        return asked()
    except RefusedError as error:
        console.print(f"refused: {error}", style="red")
        raise typer.Exit(1) from error


def _warn(axis: dict[str, Any]) -> None:
    for warning in axis["warnings"]:
        console.print(f"  warning: {warning}")


def _show(result: dict[str, Any], json: str | None) -> None:
    from stagectl.number_format import length

    for axis in result["axes"]:
        place = "" if axis["position"] is None else f" at {length(axis['position'], axis['unit'])}"
        home = "" if axis["homed"] else ", not homed"
        console.print(f"{axis['axis']}: {axis['state_words']}{place}{home}; {axis['late_cycles']} late cycles")
        _warn(axis)
        if axis["fault"]:
            console.print(f"  {axis['fault']}: {axis['words']}")
    if not result["alive"]:
        console.print("the real-time process does not respond; see `stagectl fault list`")
    emit(result, json)
