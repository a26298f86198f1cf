"""`watch_friction`: the friction compensation of a running service, kept current."""

import contextlib
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from stagectl.api.identification import identify
from stagectl.api.record import MotionRecord, load_log
from stagectl.api.stage import DesignedStage, StageLike, as_stage
from stagectl.kernels import stage as stage_model
from stagectl.units import StageError
from stagectl.web.client import ask, default_socket, fetch, status_of
from stagectl.workflows.friction_watch import FrictionWatch, Look, Verdict, legs

_POLL = 0.2  # s between two looks whether another motion has begun
_FILE = 120.0  # s that the service may take to write some seconds of rows


class Watched(NamedTuple):
    """An axis of a running service."""

    socket: Path
    axis: str


def watch_friction(
    stage: StageLike, *, socket: Path | None = None, axis: str = "", every: float = 10.0, within: float = 0.3
) -> Iterator[Verdict]:
    """Identify the friction of a running axis again and again, and keep ``control.friction_scale`` current.

    Every `every` seconds the last `every` seconds of the `axis` are identified; they need reversals.  The scale follows
    the Coulomb friction from the next motion on, between 1 - `within` and 1 + `within`, and comes back where the
    tracking error has not become smaller.  Each verdict says what was seen and done; the last one says why it ends.

    Raises ControlError where no service answers, or it refuses; StageError where the stage has no friction.
    """
    designed, watched = as_stage(stage), Watched(socket or default_socket(), axis)
    coulomb = stage_model.sliding(designed.setup.stage.friction)
    if not coulomb:
        raise StageError(f"{designed.path}: the stage has no friction that could be followed; identify it first")
    keeper = FrictionWatch(coulomb, _parameters(watched)["friction_scale"], within)
    with tempfile.TemporaryDirectory(prefix="stagectl-") as folder:
        while True:
            _pass(watched, round(every / designed.setup.dt))
            before = keeper.scale
            verdict = _seen(keeper, designed, _recorded(watched, every, Path(folder)))
            if verdict.scale != before:
                body = {"control": {"friction_scale": f"{verdict.scale:.6g}"}, "axis": axis}
                ask(watched.socket, "PATCH", "/v1/parameters", body)
            yield verdict
            if verdict.ended:
                return
            if verdict.scale != before:
                _next_motion(watched)


def _seen(keeper: FrictionWatch, stage: DesignedStage, record: MotionRecord) -> Verdict:
    try:
        coulomb = identify(stage, record)["coulomb"]
    except StageError as error:
        return Verdict(keeper.scale, f"not identified: {error.problems[0]}")
    each, speed = legs(record.samples, record.recording.meta)
    return keeper.see(Look(coulomb.value, coulomb.low, coulomb.high, each, speed))


def _parameters(watched: Watched) -> dict[str, float]:
    axes: dict[str, dict[str, float]] = ask(watched.socket, "GET", "/v1/parameters")
    if watched.axis and watched.axis not in axes:
        raise StageError(f"no axis {watched.axis}; the axes are: {', '.join(axes)}")
    return axes[watched.axis or next(iter(axes))]


def _recorded(watched: Watched, seconds: float, folder: Path) -> MotionRecord:
    """The last seconds of the axis."""
    request = {"axis": watched.axis, "name": f"friction-{time.time_ns()}", "before": seconds, "seconds": 0.1}
    begun: dict[str, str] = ask(watched.socket, "POST", "/v1/recordings", request)
    end, path = time.monotonic() + _FILE, folder / "look.h5"
    while any(
        file["file"] == begun["file"] and file["going_on"] for file in ask(watched.socket, "GET", "/v1/recordings")
    ):
        if time.monotonic() > end:
            raise StageError(f"the service has not written {begun['file']} in {_FILE:g} s; see its messages")
        time.sleep(_POLL)
    fetch(watched.socket, begun["axis"], begun["file"], path)
    with contextlib.suppress(OSError):  # of another user: the service keeps it as long as any recording
        Path(begun["path"]).unlink()
    record = load_log(path)
    assert isinstance(record, MotionRecord)
    return record


def _next_motion(watched: Watched) -> None:
    """Wait until the motion that was laid out before has ended."""
    progress = -1.0
    while (now := status_of(*watched))["state"] == "moving" and (now["progress"] or 0.0) >= progress:
        progress = now["progress"] or 0.0
        time.sleep(_POLL)


def _pass(watched: Watched, rows: int) -> None:
    """Wait until the loop has written so many rows more: where it is late, that takes longer than they say."""
    seen, left = int(status_of(*watched)["cycles"]), rows
    while left > 0:
        time.sleep(_POLL)
        now = int(status_of(*watched)["cycles"])
        left, seen = left - max(now - seen, 0), now  # another loop counts from 0
