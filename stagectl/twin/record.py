"""What the twin writes: a snapshot of now, a line a minute for the drift over days, and both in words.

A line holds values, not differences from the model: a stage file that changes in between leaves no step in a trend.
"""

import json
import math
import os
from pathlib import Path
from typing import Any

from stagectl.gap.logs.session import GapError
from stagectl.number_format import NORMAL
from stagectl.problem import why_unread
from stagectl.twin.candidates import FORM as FRICTION_FORM
from stagectl.twin.estimate import NamedDrift, ParameterDrift, TwinStatus
from stagectl.units import unit_on

FORMAT = "stagectl-twin/1"
SUFFIX = ".twin.json"  # of a snapshot
_SOURCE = "a run with --twin writes one next to its recording"


def _drift(drift: ParameterDrift, kind: str) -> dict[str, Any]:
    p = drift.candidate
    return {
        "value": drift.value,
        "error": drift.error * p.scale,
        "nominal": p.nominal,
        "scale": p.scale,
        "unit": unit_on(kind, p.unit),
        "told": drift.determined,
    }


def _drifts(p: TwinStatus, kind: str) -> dict[str, dict[str, Any]]:
    """All drifts by the name of their candidate."""
    return {drift.candidate.name: _drift(drift, kind) for fit in p.fits for drift in fit.drifts}


def line_of(about: dict[str, Any], p: TwinStatus, now: float) -> dict[str, Any] | None:
    """A line of the slow record at the time `now` (s since 1970); None where the motion determined nothing."""
    determined = {name: entry for name, entry in _drifts(p, about["kind"]).items() if entry["told"]}
    if not determined:
        return None
    return {
        "format": FORMAT,
        "time": now,
        "name": about["name"],
        "kind": about["kind"],
        "covered": p.covered,
        "residual": residuals(p),
        "drift": determined,
        "named": [named.drift.candidate.name for named in p.named],
    }


def residuals(p: TwinStatus) -> dict[str, float | None]:
    """Residual of each cut: A (worst), A rms, N m | N rms, s."""
    shift = None
    if p.mechanics_fit is not None:
        late = next((d for d in p.mechanics_fit.drifts if d.candidate.name == "time_shift"), None)
        shift = late.value if late is not None and late.determined else None
    return {"controller": p.controller, "drive": p.drive, "mechanics": p.mechanics, "sensor": shift}


def snapshot(p: TwinStatus, about: dict[str, Any]) -> dict[str, Any]:
    """All that is known now."""
    return {
        "format": FORMAT,
        **about,
        "time": p.time,
        "covered": p.covered,
        "residual": residuals(p),
        "lateness": p.lateness,
        "enough": p.mechanics_fit is not None,
        "left": p.mechanics_fit.after if p.mechanics_fit is not None else None,
        "drift": _drifts(p, about["kind"]),
        "named": [_named(named, about["kind"]) for named in p.named],
        "verdict": verdict(p, about["limit"]),
        "words": words(p, about),
        "form": form(p),
    }


def _named(named: NamedDrift, kind: str) -> dict[str, Any]:
    return {
        "name": named.drift.candidate.name,
        "alternatives": list(named.alternatives),
        "share": named.drift.size,
        "share_error": named.drift.error,
        **_drift(named.drift, kind),
    }


def verdict(p: TwinStatus, limit: float) -> str:
    """``controller``, ``effects`` or ``none`` as in a diagnosis; ``waiting`` before the axis has moved enough."""
    if p.controller is not None and p.controller > limit:
        return "controller"
    if p.named:
        return "effects"
    return "none" if p.mechanics_fit is not None else "waiting"


def words(p: TwinStatus, about: dict[str, Any]) -> str:
    """The verdict as a sentence."""
    match verdict(p, about["limit"]):
        case "controller":
            return (
                f"the logged command differs from the law's command by up to {p.controller:.3g} A: the controller that "
                "runs is not the stage file's"
            )
        case "effects":
            return "the machine differs from the model: " + "; ".join(map(effect_words, p.named))
        case "waiting":
            return "too little motion yet: the axis must travel through its friction, then a few seconds"
    effort = unit_on(about["kind"], "N m | N")
    return f"silent: nothing named, residual {p.mechanics:.3g} {effort} rms"


def form(p: TwinStatus) -> str:
    """A remark where the friction builds up in another way than the model's; empty where it does not."""
    drifts = p.mechanics_fit.drifts if p.mechanics_fit is not None else ()
    if not any(drift.significant for drift in drifts if drift.candidate.name in FRICTION_FORM):
        return ""
    return (
        "after a reversal the friction builds up in another way than the model's: that alone is no effect; "
        "`stagectl gap diagnose` looks closer"
    )


def effect_words(named: NamedDrift) -> str:
    """``viscous +20.0 % +- 0.2 % (or thermal_viscous)``."""
    drift, p, half = named.drift, named.drift.candidate, NORMAL * named.drift.error
    other = f" (or {', '.join(named.alternatives)})" if named.alternatives else ""
    if p.gauge == "%":
        return f"{p.name} {100 * drift.size:+.3g} % ± {100 * half:.2g} %{other}"
    return f"{p.name} {drift.value * 1e6:+.3g} µs ± {half * p.scale * 1e6:.2g} µs{other}"


def add(path: Path, line: dict[str, Any]) -> None:
    """Append one line, whole: several twins may write to one record."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(line, allow_nan=False) + "\n"
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    try:
        os.write(descriptor, text.encode())
    finally:
        os.close(descriptor)


def read(path: Path) -> list[dict[str, Any]]:
    """All lines of a slow record, oldest first; a last line that was cut off by a crash is dropped.

    Raises GapError where it is no slow record.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise GapError(
            f"{path} cannot be read: {why_unread(error)}; give the file that `run --twin --state` wrote"
        ) from error
    lines = text.split("\n")
    entries = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        entry = _entry(line)
        if entry is None:
            if number == len(lines):
                break  # no line break follows: it was never finished
            raise GapError(f"{path}:{number} is no line of a twin's record; give the file that `run --twin` wrote")
        entries.append(entry)
    return sorted(entries, key=lambda entry: float(entry["time"]))


def _entry(line: str) -> dict[str, Any] | None:
    try:
        entry = json.loads(line)
    except ValueError:
        return None
    sound = isinstance(entry, dict) and entry.get("format") == FORMAT
    return entry if sound and math.isfinite(entry.get("time", math.nan)) else None


def live_file(recording: Path) -> Path:
    """Where the twin of a run writes its snapshot."""
    return recording.with_name(recording.name.removesuffix(".h5") + SUFFIX)


def newest(folder: Path) -> Path | None:
    """The snapshot that was written last."""
    return max(folder.glob(f"*{SUFFIX}"), key=lambda path: path.stat().st_mtime, default=None)


def load_snapshot(path: Path) -> dict[str, Any]:
    """The snapshot that the twin wrote last.  Raises GapError where the file is not a twin's."""
    try:
        entry = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise GapError(f"{path} cannot be read: {why_unread(error)}; {_SOURCE}") from error
    if not isinstance(entry, dict) or entry.get("format") != FORMAT:
        raise GapError(f"{path} is no snapshot of a twin ({FORMAT}); {_SOURCE}")
    return entry
