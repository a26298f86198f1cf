"""The client of the control socket: one request, one answer."""

import contextlib
import http.client
import json
import os
import shutil
import socket
import time
import urllib.parse
from pathlib import Path
from typing import Any

from stagectl.problem import Problem, ProblemKind, why_unread
from stagectl.replacing import replaced
from stagectl.runtime_folder import runtime_folder, short_name
from stagectl.service.stop_link import QUICK_STOP, STATUS, STOP, StopLink, beside
from stagectl.units import StageError
from stagectl.web.limits import ANSWER_TIME, MOTION_TIME, STOP_ANSWER, STOP_LOOK, STOPPED

SYSTEM = Path("/run/stagectl/control.sock")
MOTIONS = ("/v1/move", "/v1/home", "/v1/trajectory")  # are answered when they have ended
_UNPOWERED = ("disabled", "fault", "offline")
_NOBODY = "start one with `stagectl serve STAGE.yaml`, or see `systemctl status stagectl`"
_BY_HAND = "press the emergency stop, then `systemctl restart stagectl`"


class ControlError(StageError):
    """A service that does not answer, or refuses."""


class RefusedError(ControlError):
    """The service refused the request, with its reason."""


class _UnixConnection(http.client.HTTPConnection):
    def __init__(self, path: Path, patience: float) -> None:
        super().__init__("localhost", timeout=patience)
        self._path = path

    def connect(self) -> None:
        self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.sock.settimeout(self.timeout)
        with short_name(self._path) as name:
            self.sock.connect(name)


def default_socket() -> Path:
    """Where the service of this machine is: $STAGECTL_SOCKET, the system's, or the user's own."""
    return chosen_socket() or (SYSTEM if SYSTEM.exists() else own_socket())


def chosen_socket() -> Path | None:
    """What $STAGECTL_SOCKET names, to a service as to those who ask it."""
    chosen = os.environ.get("STAGECTL_SOCKET")
    return Path(chosen) if chosen else None


def own_socket() -> Path:
    """Of a service that a user starts."""
    return runtime_folder() / "control.sock"


def _group(path: Path) -> str:
    """Of the socket, or of the service where it cannot be seen."""
    try:
        return path.group()
    except (OSError, KeyError):
        return "stagectl"


def ask(path: Path, method: str, what: str, body: dict[str, Any] | None = None, patience: float | None = None) -> Any:
    """The answer to a request; a service that is stuck is not waited for, but for a motion, or `patience` (s).

    Who interrupts a motion, or ends the process that waits for it, stops its axis.
    Raises RefusedError with the service's reason, ControlError where there is none to ask, StageError where the
    operator has stopped it.
    """
    moves = what.partition("?")[0] in MOTIONS
    if patience is None:
        patience = MOTION_TIME if moves else ANSWER_TIME
    link = _UnixConnection(path, patience)
    try:
        content = None if body is None else json.dumps(body)
        link.request(method, what, content, {"Content-Type": "application/json"} if content else {})
        answer = link.getresponse()
        result = json.loads(answer.read())
    except KeyboardInterrupt:
        if not moves:
            raise
        raise _interrupted(path, _axis_of(what, body or {})) from None
    except PermissionError as error:
        raise _not_allowed(path) from error
    except TimeoutError as error:
        raise ControlError(
            f"the service on {path} has not answered for {patience:g} s: run `systemctl restart stagectl`, "
            "or kill it and start it again; both stop the axes"
        ) from error
    except (OSError, http.client.HTTPException, ValueError) as error:
        raise nobody(path, error) from error
    finally:
        link.close()
    if answer.status >= 400:
        raise RefusedError(str(result.get("error", result)))
    return result


def nobody(path: Path, cause: Exception) -> ControlError:
    """What to say where nothing answers on `path`: no socket, a service that has lost its own, or no service."""
    if path.exists() and not path.is_socket():
        set_so = os.environ.get("STAGECTL_SOCKET") == str(path)
        remedy = (
            f"name the control socket of a service, or {'unset $STAGECTL_SOCKET' if set_so else 'leave out --socket'}"
        )
        return ControlError(Problem(f"{path} is no socket", ProblemKind.FILE, remedy=remedy, file=path))
    if _runs(path):
        runs = "a service runs, or still stops its axes"
        reason = f"{runs}, but nothing answers on its control socket {path} ({why_unread(cause)})"
        remedy = "wait where it has just begun; else end it, by Ctrl-C in its terminal or `systemctl restart stagectl`"
        problem = Problem(reason, ProblemKind.CONFLICT, remedy=f"{remedy}; `stagectl stop` stops its axes", file=path)
        return ControlError(problem)
    return ControlError(f"no service answers on {path} ({why_unread(cause)}); {_NOBODY}")


def _runs(path: Path) -> bool:
    """Whether the stop path that belongs to this control socket answers."""
    try:
        link = StopLink(beside(path))
    except OSError:
        return False
    with contextlib.closing(link):
        try:
            return bool(link.ask(STATUS, "", STOP_ANSWER))
        except OSError:
            return False


def _axis_of(what: str, body: dict[str, Any]) -> str:
    """The axis that a motion is for; empty for several, or where it names none."""
    asked = urllib.parse.parse_qs(what.partition("?")[2]).get("axis", [])
    names = {*asked, *(body.get("to") or {}), *(body.get("by") or {}), body.get("axis", "")} - {""}
    return names.pop() if len(names) == 1 else ""


def _interrupted(path: Path, axis: str) -> StageError:
    """Stop what a motion moves whose operator interrupts it; the error that says whether that went well."""
    try:
        axes = stop(path, False, axis)["axes"]
    except (StageError, KeyboardInterrupt) as error:
        why = str(error) or "a second Ctrl-C came before it stood"
        reason = f"interrupted, and {axis or 'the axis'} MAY GO ON, as its stop did not succeed: {why}"
        return StageError(Problem(reason, ProblemKind.LIMIT, remedy="run `stagectl stop`, or press the emergency stop"))
    states = "; ".join(f"{one['axis']}: {one['state_words']}" for one in axes if axis in ("", one["axis"]))
    return StageError(Problem(f"interrupted: the motion was stopped ({states})", ProblemKind.STOPPED))


def stop(path: Path, quick: bool, axis: str) -> dict[str, Any]:
    """Stop by the stop path, and wait until the axes stand; `path` is the control socket.  The machine then.

    Raises RefusedError where there is no such axis, ControlError where nobody answers or the axes go on.
    """
    place = beside(path)
    try:
        link = StopLink(place)
    except PermissionError as error:
        raise _not_allowed(place) from error
    except OSError as error:
        raise nobody(place, error) from error
    with contextlib.closing(link):
        try:
            answer = link.ask(QUICK_STOP if quick else STOP, axis, STOP_ANSWER)
            if "error" in answer:
                raise RefusedError(answer["error"])
            return _stood(link, axis, quick)
        except OSError as error:
            raise _unstopped(path) from error


def _stood(link: StopLink, axis: str, quick: bool) -> dict[str, Any]:
    """The machine when the loop has heeded the stop, and the axes stand.  Raises ControlError, OSError."""
    ends, end = (_UNPOWERED if quick else (*_UNPOWERED, "standing")), time.monotonic() + STOPPED
    while True:
        answer = link.ask(STATUS, "", STOP_ANSWER)
        heeded = answer.pop("heeded")
        going = [shown for shown in answer["axes"] if axis in ("", shown["axis"]) and shown["state"] not in ends]
        if heeded and not going:
            return answer
        if time.monotonic() > end:
            states = "; ".join(f"{shown['axis']}: {shown['state_words']}" for shown in going)
            raise ControlError(f"the stop is given and not carried out ({states}): {_BY_HAND}")
        time.sleep(STOP_LOOK)


def _unstopped(path: Path) -> ControlError:
    """What a person must do where the stop path is silent, with what the service knows of its axes."""
    words = "the service does not answer, either"
    with contextlib.suppress(ControlError):
        axes = ask(path, "GET", "/v1/status", patience=STOP_ANSWER)["axes"]
        words = "; ".join(f"{axis['axis']}: {axis['state_words']}" for axis in axes)
        if all(axis["state"] == "connecting" for axis in axes):
            return ControlError(f"not stopped by us: {words}. Where an axis still moves, press the emergency stop")
    return ControlError(f"the stop path on {beside(path)} does not answer ({words}): {_BY_HAND}")


def _not_allowed(path: Path) -> ControlError:
    return ControlError(
        f"{path}: only its group may use it: `sudo usermod -aG {_group(path)} $USER`, then log in again"
    )


def status_of(path: Path, axis: str) -> dict[str, Any]:
    """The status of an axis, of the first one where none is named."""
    axes: list[dict[str, Any]] = ask(path, "GET", "/v1/status")["axes"]
    return next(each for each in axes if axis in ("", each["axis"]))


def fetch(path: Path, axis: str, name: str, target: Path) -> None:
    """Write the recording of an axis whose file is called `name` to `target`.

    Raises RefusedError with the service's reason, ControlError where there is none to ask, RecordingError where
    `target` is not ours to write.
    """
    from stagectl.recording.hdf5 import check_target

    check_target(target)
    what = f"/v1/recordings/recordings/{axis}/{name}"
    try:
        with contextlib.closing(_UnixConnection(path, MOTION_TIME)) as link:
            link.request("GET", urllib.parse.quote(what))
            answer = link.getresponse()
            if answer.status >= 400:
                raise RefusedError(str(json.loads(answer.read()).get("error")))
            with replaced(target) as fresh, fresh.open("wb") as file:
                shutil.copyfileobj(answer, file)
    except (http.client.HTTPException, ConnectionError) as error:
        raise ControlError(f"the service on {path} ended while it sent {what} ({error})") from error
