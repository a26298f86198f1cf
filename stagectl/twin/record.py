"""What the twin writes: a snapshot for who looks now, a line a minute for the drift over days; and the line's words.

A line holds values, not differences to the model: a stage file that changes in between leaves no step in a trend.
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

from stagectl.gap.logs.session import GapError
from stagectl.twin.estimate import Drift, Fit, Named, Update, there
from stagectl.twin.live_model import BEND, PRESLIDING
from stagectl.units import Quantity

FORMAT = "stagectl-twin/1"


def _drift(one: Drift, kind: str) -> dict[str, Any]:
    at = one.candidate
    return {
        "value": one.value,
        "error": one.error * at.scale,
        "nominal": at.nominal,
        "scale": at.scale,
        "unit": Quantity(at.unit, "", "").unit_for(kind),
        "told": one.told,
    }


def _fits(p: Update) -> list[Fit]:
    return [fit for fit in (p.drive_fit, p.mechanics_fit) if fit is not None]


def line_of(about: dict[str, Any], p: Update, now: float) -> dict[str, Any] | None:
    """A line of the slow record at the time `now` (s since 1970); None where the motion told nothing."""
    told = {d.candidate.name: _drift(d, about["kind"]) for fit in _fits(p) for d in fit.drifts if d.told}
    if not told:
        return None
    return {
        "format": FORMAT,
        "time": now,
        "name": about["name"],
        "kind": about["kind"],
        "covered": p.covered,
        "residual": residuals(p),
        "drift": told,
        "named": [named.drift.candidate.name for named in p.named],
    }


def residuals(p: Update) -> dict[str, float | None]:
    """Residual of each cut: A (worst), A rms, N m | N rms, s."""
    shift = None
    if p.mechanics_fit is not None:
        late = next((d for d in p.mechanics_fit.drifts if d.candidate.name == "time_shift"), None)
        shift = late.value if late is not None and late.told else None
    return {"controller": p.controller, "drive": p.drive, "mechanics": p.mechanics, "sensor": shift}


def snapshot(p: Update, about: dict[str, Any]) -> dict[str, Any]:
    """All that is known now."""
    drifts = {d.candidate.name: _drift(d, about["kind"]) for fit in _fits(p) for d in fit.drifts}
    return {
        "format": FORMAT,
        **about,
        "time": p.time,
        "covered": p.covered,
        "residual": residuals(p),
        "lateness": p.lateness,
        "enough": p.mechanics_fit is not None,
        "left": p.mechanics_fit.after if p.mechanics_fit is not None else None,
        "drift": drifts,
        "named": [_named(one, about["kind"]) for one in p.named],
        "verdict": verdict(p, about["limit"]),
        "words": words(p, about),
        "form": form(p),
    }


def _named(one: Named, kind: str) -> dict[str, Any]:
    return {
        "name": one.drift.candidate.name,
        "alternatives": list(one.alternatives),
        "share": one.drift.size,
        "share_error": one.drift.error,
        **_drift(one.drift, kind),
    }


def verdict(p: Update, limit: float) -> str:
    """One of found.VERDICTS, as far as a twin can tell; ``waiting`` before enough has moved."""
    if p.controller is not None and p.controller > limit:
        return "controller"
    if p.named:
        return "effects"
    return "none" if p.mechanics_fit is not None else "waiting"


def words(p: Update, about: dict[str, Any]) -> str:
    """The verdict as a sentence."""
    found = verdict(p, about["limit"])
    if found == "controller":
        return (
            f"the logged command is not what the law answers to the logged position (off by up to {p.controller:.3g} "
            f"A): another controller runs than the stage file's"
        )
    if found == "effects":
        return "the machine differs from the model: " + "; ".join(told(one) for one in p.named)
    if found == "waiting":
        return "too little motion yet: the model must travel through its friction, then a few seconds"
    effort = Quantity("N m | N", "", "").unit_for(about["kind"])
    return f"silent: nothing named, residual {p.mechanics:.3g} {effort} rms"


def form(p: Update) -> str:
    """What to say where the friction builds up otherwise than the model's; empty where it does not."""
    fit = p.mechanics_fit
    curves = [d for d in fit.drifts if d.candidate.name in (PRESLIDING, BEND)] if fit is not None else []
    if not any(there(one) for one in curves):
        return ""
    return (
        "after a reversal the friction builds up otherwise than the model's: that alone is no effect; "
        "`stagectl gap diagnose` looks closer"
    )


def told(one: Named) -> str:
    """``viscous +20.0 % +- 0.2 % (or thermal_viscous)``."""
    at, half = one.drift.candidate, 1.96 * one.drift.error
    other = f" (or {', '.join(one.alternatives)})" if one.alternatives else ""
    if at.gauge == "%":
        return f"{at.name} {100 * one.drift.size:+.3g} % ± {100 * half:.2g} %{other}"
    return f"{at.name} {one.drift.value * 1e6:+.3g} µs ± {half * at.scale * 1e6:.2g} µs{other}"


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
    """All lines of a slow record, oldest first; a last line that was cut off by a crash is left out.

    Raises GapError where it is no slow record.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise GapError(f"{path} cannot be read: {error}; give the file that `run --twin --state` wrote") from error
    lines = text.split("\n")
    found = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        entry = _entry(line)
        if entry is None:
            if number == len(lines):
                break  # no line break behind it: it was never finished
            raise GapError(f"{path}:{number} is no line of a twin's record; give the file that `run --twin` wrote")
        found.append(entry)
    return sorted(found, key=lambda entry: float(entry["time"]))


def _entry(line: str) -> dict[str, Any] | None:
    try:
        entry = json.loads(line)
    except ValueError:
        return None
    sound = isinstance(entry, dict) and entry.get("format") == FORMAT
    return entry if sound and math.isfinite(entry.get("time", math.nan)) else None
