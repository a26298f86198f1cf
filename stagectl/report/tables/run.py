"""What a run achieved, in a sentence and in a table."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl.drives.drive import Fault
from stagectl.evaluation import after_start
from stagectl.number_format import length
from stagectl.recording.in_memory import lacking
from stagectl.report.page import Table


def answer(result: dict[str, Any], samples: NDArray[Any]) -> str:
    """How it went, in a sentence."""
    unit, error = result["unit"], result["tracking_error"]
    fault = next((Fault(int(code)) for code in samples["fault"] if code != Fault.NONE), None)
    if fault is not None:
        at = float(samples["time"][np.flatnonzero(samples["fault"] != Fault.NONE)[0]])
        return f"Stopped after {at:.3g} s: {fault.name.lower().replace('_', ' ')}."
    if would := result.get("fault"):  # of a model, which nothing stops
        return f"{would[0].upper()}{would[1:]}. Its error goes up to {length(error['peak'], unit)}."
    lost = lacking(result.get("lost_rows", 0), len(samples))
    if lost and error["peak"] is None:
        return f"{lost[0].upper()}{lost[1:]}, and without them nobody knows how it went."
    if result["open_loop"]:
        low, high = (length(end, unit) for end in result["travelled"])
        return f"The loop was open; the axis moved from {low} to {high}."
    if error["peak"] is None:
        return "The run ended before the window in which its error is taken."
    stands = "" if result["in_position"] or lost else " At the end the axis did not come to stand in position."
    stands += f" But {lost}." if lost else ""
    after = "".join(f"; {words}" for words in filter(None, [after_start(result)]))
    return f"The stage tracks within {length(error['peak'], unit)}, rms {length(error['rms'], unit)}{after}.{stands}"


def achieved(result: dict[str, Any], meta: dict[str, Any]) -> Table:
    """What `evaluate` has found, a figure a row."""
    unit = result["unit"]
    rows = []
    for name, words in (
        ("tracking_error", "tracking error"),
        ("tracking_error_true", "tracking error of the true position (simulated)"),
    ):
        error = result.get(name)
        if error and error["peak"] is not None:
            rows += [[f"{words}, {kind}", length(error[kind], unit)] for kind in ("peak", "rms")]
    low, high = (length(end, unit) for end in result["travelled"])
    rows += [
        ["travelled", f"{low} to {high}"],
        ["peak current", f"{result['peak_current']:.3g} A"],
        ["cycles at the current limit", f"{result['saturated_cycles']} of {result['cycles']}"],
        ["late cycles", f"{result['late_cycles']} of {result['cycles']}"],
        ["duration", f"{result['cycles'] * meta['dt']:.4g} s"],
    ]
    if result["current_at_rest"] is not None:
        rows.append(["current at rest, peak to peak", f"{result['current_at_rest']:.2g} A"])
    return Table("In figures", ["", ""], rows)
