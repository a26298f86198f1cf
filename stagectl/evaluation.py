"""What a run achieved, from its rows: the numbers that `run` and `simulate` report."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl.drives.drive import Fault
from stagectl.number_format import length

WINDOW_COUNTS = 50.0  # in position: within so many encoder counts of the reference, over the last DWELL
DWELL = 0.05  # s
START = 0.1  # s of a motion in which its error tells of the friction's state before it, which nobody knows
REST = 0.08  # s at the end of a run: the axis has settled, and its current shows whether the loop does


def evaluate(samples: NDArray[Any], meta: dict[str, Any]) -> dict[str, Any]:
    """Tracking error over the steady window, and how the run went.

    `samples` is a recording's structured rows; lengths come out in the unit of travel, m or rad.
    """
    scale = meta["axis"]["travel_per_unit"]
    inside = window(samples["time"], meta["steady"])
    inside &= closed(samples)  # an open loop has no tracking error
    if not len(samples) or samples["time"][-1] < meta["steady"][1] - 1.5 * meta["dt"]:
        inside[:] = False  # the run ended within its window: no figure is better than one of another window
    error = tracking_error(samples, meta)
    result: dict[str, Any] = {
        "stage": meta["name"],
        "trajectory": meta["trajectory"],
        "unit": meta["axis"]["travel_unit"],
        "steady": meta["steady"],
        "tracking_error": size(error[inside]),
        "tracking_error_after_start": size(error[inside & started(samples, meta)]),
        "nd": meta["nd"],
        "nm": meta["nm"],
        "cycles": len(samples),
        "late_cycles": int(np.sum(samples["late"])),
        "effects_limited_cycles": meta.get("effects_limited", 0),
        "saturated_cycles": int(np.sum(samples["command"] != samples["current"])),
        "peak_current": float(np.max(np.abs(samples["current"]), initial=0.0)),
        "current_at_rest": current_at_rest(samples, meta),
        "travelled": travelled(samples["measured"] * scale),
        "open_loop": not bool(np.any(closed(samples))),
        "in_position": in_position(samples, meta),
    }
    true = (samples["reference"] - samples["true_position"]) * scale
    if np.all(np.isfinite(true)):
        result["tracking_error_true"] = size(true[inside])
    return result


def closed(samples: NDArray[Any]) -> NDArray[np.bool_]:
    """Rows (n,) in which the loop was closed."""
    return np.asarray(samples["closed"] != 0.0, dtype=np.bool_)


def travelled(position: NDArray[np.float64]) -> list[float]:
    """Lowest and highest position, from where the run began."""
    moved = position - position[:1]
    return [float(moved.min(initial=0.0)), float(moved.max(initial=0.0))]


def latched_reference(samples: NDArray[Any], meta: dict[str, Any]) -> NDArray[np.float64]:
    """Reference (n,) of the instant at which each measured position was latched, nm periods before."""
    late = int(meta["nm"] or 0)  # an imported log does not say it
    reference: NDArray[np.float64] = np.concatenate([np.repeat(samples["reference"][:1], late), samples["reference"]])
    return reference[: len(samples)]


def tracking_error(samples: NDArray[Any], meta: dict[str, Any]) -> NDArray[np.float64]:
    """Reference minus measured (n,) m | rad of travel, both of the instant at which the position was latched.

    Where the controller has a map of the encoder's errors, that is what the encoder should read minus what it reads.
    """
    should = samples["target"] if meta.get("encoder_mapped") else latched_reference(samples, meta)
    error: NDArray[np.float64] = (should - samples["measured"]) * meta["axis"]["travel_per_unit"]
    return error


def window(time: NDArray[np.float64], steady: list[float]) -> NDArray[np.bool_]:
    """Rows within the steady window (s)."""
    return (time >= steady[0]) & (time < steady[1])


def started(samples: NDArray[Any], meta: dict[str, Any]) -> NDArray[np.bool_]:
    """Rows (n,) after the start of the motion, where the steady window holds it."""
    after: NDArray[np.bool_] = samples["time"] >= meta["steady"][0] + (START if meta["steady"][0] == 0.0 else 0.0)
    return after


def after_start(result: dict[str, Any]) -> str:
    """The peak error after the start in words, where it is less than half of the whole peak; else empty."""
    whole, later = result["tracking_error"]["peak"], result["tracking_error_after_start"]["peak"]
    if whole is None or later is None or later > 0.5 * whole:
        return ""
    return f"after the first {START:g} s within {length(later, result['unit'])}"


def current_at_rest(samples: NDArray[Any], meta: dict[str, Any]) -> float | None:
    """Peak to peak (A) of the current at the end of the run; None where the axis is not held at rest there."""
    last = samples[-round(REST / meta["dt"]) :]
    if not in_position(samples, meta) or not closed(last).all() or np.ptp(last["reference"]):
        return None
    measured = last["measured_current"]
    return float(np.ptp(measured if np.isfinite(measured).all() else last["current"]))


def size(error: NDArray[np.float64]) -> dict[str, float | None]:
    """Peak and root mean square; None where the run ended before the window."""
    if not error.size:
        return {"peak": None, "rms": None}
    return {"peak": float(np.max(np.abs(error))), "rms": float(np.sqrt(np.mean(np.square(error))))}


def in_position(samples: NDArray[Any], meta: dict[str, Any]) -> bool:
    """Whether the run ended without a fault, standing within the window for the whole dwell; without rows nobody knows.

    Where the loop is open at the end there is no target position: then whether the run ended without a fault.
    """
    last = slice(-max(1, round(DWELL / meta["dt"])), None)
    axis = meta["axis"]
    allowed = WINDOW_COUNTS * (axis["encoder_step"] or 1e-9) * axis["travel_per_unit"]
    near = np.abs(tracking_error(samples, meta)[last]) <= allowed
    near |= ~closed(samples)[last]
    whole = samples["time"][-1:] >= meta["duration"]
    return bool(len(samples) and whole.all() and near.all() and np.all(samples["fault"] == Fault.NONE))
