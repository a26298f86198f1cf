"""What a recording says about itself, in addition to its rows."""

import datetime
import functools
import importlib.metadata
import platform
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stagectl.compensation.forms import name_of
from stagectl.config.machine_file import text_of
from stagectl.config.stage_file import Setup
from stagectl.design import Controller
from stagectl.kernels import cascade, feedback, law, observer, unloading
from stagectl.kernels.jit import source_hash
from stagectl.plan import Plan

STAMP = "%Y-%m-%dT%H:%M:%S%z"  # of the instant at which something was made
_PACKAGES = ("stagectl", "numpy", "scipy", "h5py", "canopen", "python-can")


def describe(setup: Setup, plan: Plan, running: Controller, name: str, text: str) -> dict[str, Any]:
    """Everything that is needed to read the rows, and to run them again; `name` and `text` of the trajectory file."""
    common = of_axis(setup, running, setup.text or text_of(setup.path))
    return {
        **common,
        "trajectory": Path(name).stem,
        "steady": list(plan.steady),
        "duration": plan.duration,
        "excitation": [span._asdict() for span in plan.excitation],
        "encoder_mapped": plan.mapped,
        "effects_limited": max((one.periods for one in plan.limited), default=0),
        "files": {**common["files"], "trajectory": {"name": name, "text": text}},
    }


def of_axis(setup: Setup, running: Controller, text: str) -> dict[str, Any]:
    """What holds for any motion of an axis under this controller; `text`: its stage file's, as it was loaded."""
    axis, p = setup.file.axis, setup.stage
    return {
        "name": setup.file.name,
        "created": time.strftime(STAMP),
        "axis": {
            "kind": axis.kind,
            "travel_per_unit": axis.travel_per_unit,
            "travel_unit": axis.travel_unit,
            "encoder_step": p.encoder.step,
        },
        "current_step": getattr(setup.file.drive.wire, "current_scale", 0.0),
        "dt": setup.dt,
        "nd": p.drive.delay_samples,
        "nm": p.encoder.delay_samples,
        "law": written(running.law),
        "feedforward": written(running.feedforward),
        "compensation": {"form": name_of(setup.file.compensation), **written(setup.file.compensation)},
        "files": {"stage": {"name": setup.path.name, "text": text}},
        "versions": versions(),
    }


def made_at(meta: Mapping[str, Any]) -> float:
    """When a recording was made (s since the epoch).  Raises KeyError or ValueError where it does not say."""
    return datetime.datetime.strptime(meta["created"], STAMP).timestamp()


@functools.cache
def versions() -> dict[str, str]:
    """Versions of this program, its kernels, the packages it needs, and the machine; the same object for all."""
    known = {"python": platform.python_version(), "kernels": source_hash(), "system": platform.platform()}
    for package in _PACKAGES:
        try:
            known[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            known[package] = "not installed"
    return known


def portable(p: Any) -> Any:
    """A block of parameters with plain tuples for its tables: what another process can take."""
    if hasattr(p, "_fields"):
        return type(p)(*map(portable, p))
    return tuple(float(x) for x in p) if hasattr(p, "__len__") else p


def written(p: Any) -> Any:
    """A block of parameters as JSON values; floats survive bit for bit."""
    if hasattr(p, "_asdict"):
        return {name: written(value) for name, value in p._asdict().items()}
    return [float(x) for x in p] if hasattr(p, "__len__") and not isinstance(p, str) else p


def flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested values by dotted names: ``{"a": {"b": 1}}`` as ``{"a.b": 1}``."""
    named: dict[str, Any] = {}
    for name, value in values.items():
        named |= flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return named


def read_law(values: dict[str, Any]) -> law.Law:
    """The law that `written` wrote."""
    blocks = {
        "feedback": feedback.Pid(**values["feedback"]),
        "cascade": cascade.Cascade(**values["cascade"]),
        "observer": observer.Observer(**values["observer"]),
        "unloading": unloading.Unloading(**values.get("unloading", {})),
    }
    return law.Law(**{**values, **blocks})
