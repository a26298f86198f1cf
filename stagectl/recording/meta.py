"""What a recording says about itself, besides its rows."""

from __future__ import annotations

import importlib.metadata
import platform
import time
from pathlib import Path
from typing import Any

from stagectl.config.stage_file import Setup
from stagectl.kernels import feedback, feedforward, friction, law
from stagectl.kernels.jit import source_hash, table
from stagectl.plan import Plan

_PACKAGES = ("stagectl", "numpy", "scipy", "h5py", "canopen", "python-can")


def describe(setup: Setup, plan: Plan, running: law.Law, trajectory: Path) -> dict[str, Any]:
    """Everything that is needed to read the rows, and to run them again."""
    axis, p = setup.file.axis, setup.stage
    return {
        "name": setup.file.name,
        "trajectory": trajectory.stem,
        "created": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        "axis": {
            "kind": axis.kind,
            "travel_per_unit": axis.travel_per_unit,
            "travel_unit": axis.travel_unit,
            "encoder_step": p.encoder.step,
        },
        "dt": setup.dt,
        "nd": p.drive.delay_samples,
        "nm": p.encoder.delay_samples,
        "steady": list(plan.steady),
        "duration": plan.duration,
        "law": written(running),
        "files": {path.name: path.read_text(encoding="utf-8") for path in (setup.path, trajectory)},
        "versions": versions(),
    }


def versions() -> dict[str, str]:
    """Of this program, its kernels, what it stands on, and the machine it ran on."""
    found = {"python": platform.python_version(), "kernels": source_hash(), "system": platform.platform()}
    for package in _PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def portable(p: law.Law) -> law.Law:
    """`p` with plain tuples for its tables: what another process, or JSON, can take."""
    plain = friction.StopOperators(*(tuple(float(x) for x in values) for values in p.friction))
    return p._replace(friction=plain)


def written(p: law.Law) -> dict[str, Any]:
    """The law as JSON values; floats survive bit for bit."""
    plain = portable(p)._asdict()
    return {name: value._asdict() if hasattr(value, "_asdict") else value for name, value in plain.items()}


def read_law(values: dict[str, Any]) -> law.Law:
    """The law that `written` wrote, ready to run in this process."""
    tables = friction.StopOperators(*(table(values["friction"][name]) for name in ("weight", "slip")))
    parts = {
        "feedback": feedback.Pid(**values["feedback"]),
        "plant": feedforward.Held(**values["plant"]),
        "friction": tables,
    }
    return law.Law(**{**values, **parts})
