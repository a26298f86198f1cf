"""The learned current as a file: HDF5, with what it was learned on, so that it is used nowhere else.

::

    /               format, meta: JSON - stage, trajectory, layers, dt, model (stage and law), trials, created, versions
    /learned   (n,) A, added to the command period by period
    /reference (n,) rad | m, the motion it belongs to, from the axis' position at the start
    /known     (n,) A, feedforward and friction compensation that act with it
"""

import io
import json
import math
import time
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.kernels import law
from stagectl.problem import ProblemKind
from stagectl.recording.constants import ALIKE, NEAR
from stagectl.recording.file_lock import DataFileError
from stagectl.recording.metadata import STAMP, flat, versions, written
from stagectl.replacing import check_ending, check_is_file, check_replaceable, replaced

FORMAT = "stagectl-learned/1"
_ARRAYS = ("learned", "reference", "known")


class LearnedError(DataFileError):
    """A learned current that cannot be read, or that belongs to something else."""


class Learned(NamedTuple):
    """A current, and what it belongs to."""

    current: NDArray[np.float64]  # (n,) A
    reference: NDArray[np.float64]  # (n,) rad | m
    known: NDArray[np.float64]  # (n,) A, feedforward and friction compensation
    meta: dict[str, Any]


def nothing(
    setup: Setup, running: law.Law, setpoints: NDArray[np.float64], trajectory: str, layers: list[str]
) -> Learned:
    """No current yet, and what one would belong to: `setpoints` (n, fields) of a `trajectory` under `layers`."""
    column = dict(zip(law.Setpoint._fields, setpoints.T, strict=True))
    meta = {
        "stage": setup.file.name,
        "trajectory": trajectory,
        "layers": sorted(layers),
        "dt": setup.dt,
        "model": {"stage": written(setup.stage), "law": written(running)},
    }
    known = column["feedforward"] + column["friction"]
    return Learned(np.zeros(len(setpoints)), column["reference"].copy(), known, meta)


def claim(path: Path) -> None:
    """Make sure, before there is anything to lose, that a learned current can be kept in `path`.

    Raises LearnedError where it cannot, StageError where its name is of another kind of file, or such a file is there.
    """
    check_ending(path, ".h5", "a learned current")
    check_is_file(path)
    check_replaceable(path, _ours)
    with _writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("ab").close()
    if not path.stat().st_size:
        path.unlink()


def save(path: Path, learned: Learned) -> None:
    """Write `learned`; a file that is not a learned current is left as it is.

    Raises LearnedError where it cannot be written; what was there is then as it was.
    """
    claim(path)
    meta = {**learned.meta, "created": time.strftime(STAMP), "versions": versions()}
    with _writing(path), replaced(path) as fresh:
        fresh.write_bytes(_whole(learned, meta))


def _whole(learned: Learned, meta: dict[str, Any]) -> bytes:
    """The file as HDF5 makes it in memory: it does not survive a write that fails, see `hdf5`."""
    place = io.BytesIO()
    with h5py.File(place, "w") as file:
        file.attrs.update({"format": FORMAT, "meta": json.dumps(meta)})
        for name, values in zip(_ARRAYS, learned[:3], strict=True):
            file[name] = values
    return place.getvalue()


def _writing(path: Path) -> AbstractContextManager[None]:
    return LearnedError.instead_of((OSError,), f"{path} cannot be written", path, ProblemKind.FILE)


def load(path: Path) -> Learned:
    """Read a learned current.  Raises LearnedError where the file is none."""
    if not path.is_file():
        raise LearnedError(f"{path}: no such file; `stagectl learn` writes one", path, ProblemKind.FILE)
    if not _ours(path):
        raise LearnedError(f"{path} is not a learned current; `stagectl learn` writes one", path, ProblemKind.SYNTAX)
    with h5py.File(path, "r") as file:
        current, reference, known = (file[name][:] for name in _ARRAYS)
        return Learned(current, reference, known, json.loads(file.attrs["meta"]))


def _ours(path: Path) -> bool:
    try:
        with h5py.File(path, "r") as file:
            return str(file.attrs.get("format")) == FORMAT and set(_ARRAYS) <= set(file)
    except OSError:
        return False


def check(path: Path, learned: Learned, here: Learned) -> None:
    """Whether `learned` belongs to the run `here`, of which the current is not looked at.

    Raises LearnedError naming the first thing that differs.
    """
    wrong = _motion(learned, here) or _circumstances(learned.meta, here.meta) or _beforehand(learned, here)
    if wrong:
        reason = (
            f"{path} was learned {wrong}; nothing has moved: a learned current fits only what it was learned on.  "
            "Learn again with `stagectl learn`, or run without --learned"
        )
        raise LearnedError(reason, path, ProblemKind.CONFLICT)


def _motion(learned: Learned, here: Learned) -> str:
    name, this, dt = learned.meta["trajectory"], here.meta["trajectory"], here.meta["dt"]
    if learned.meta["dt"] != dt:
        return f"at a period of {learned.meta['dt'] * 1e3:g} ms, this stage runs at {dt * 1e3:g} ms"
    if len(learned.reference) != len(here.reference):
        times = [len(rows) * dt for rows in (learned.reference, here.reference)]
        return f"on the trajectory {name} of {times[0]:.6g} s, this one ({this}) takes {times[1]:.6g} s"
    near = NEAR * here.meta["model"]["stage"]["encoder"]["step"]
    apart = np.abs(learned.reference - here.reference) > near
    if np.any(apart):
        at = int(np.argmax(apart)) * dt
        return f"on the trajectory {name}, whose reference differs from this one ({this}) from {at:.6g} s on"
    return ""


def _beforehand(learned: Learned, here: Learned) -> str:
    """Feedforward and friction compensation may come from another friction than the stage's own."""
    apart = float(np.max(np.abs(learned.known - here.known), initial=0.0))
    if apart > ALIKE * float(np.max(np.abs(here.known), initial=0.0)):
        return f"with another feedforward or friction compensation, by up to {apart:.3g} A"
    return ""


def _circumstances(there: dict[str, Any], here: dict[str, Any]) -> str:
    if there["layers"] != here["layers"]:
        return f"with the layers {_listed(there['layers'])}, this run has {_listed(here['layers'])}"
    before, now = flat(there["model"]), flat(here["model"])
    for name in sorted(before.keys() | now.keys()):
        if _plain(before.get(name)) != _plain(now.get(name)):
            return f"with {name} = {_plain(before.get(name))}, this stage has {_plain(now.get(name))} (SI)"
    return ""


def _listed(layers: list[str]) -> str:
    return "+".join(layers) or "none"


def _plain(value: Any) -> Any:
    """A number that is none as its word, so that two of them compare equal."""
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
