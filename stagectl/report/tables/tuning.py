"""A designed feedback: gains, margins and closed loop."""

from stagectl.config.stage_file import Setup
from stagectl.report.page import Table
from stagectl.tuning.search import Tuned
from stagectl.tuning.sheet import closed, gains, margins, rows


def design(setup: Setup, tuned: Tuned) -> list[Table]:
    """Gains and margins."""
    table = [
        [f"{gain.name} {gain.symbol}", f"{gain.value:.6g}", gain.unit, f"{gain.running:.6g}", gain.running_unit]
        for gain in gains(setup, tuned.control)
    ]
    head = ["gain", "continuous", "unit", f"as it runs every {tuned.control.period * 1e3:g} ms", "unit"]
    return [Table("Gains", head, table), Table("Margins", ["", *tuned.reached], margins(tuned))]


def tables(setup: Setup, tuned: Tuned) -> list[Table]:
    """Gains, margins and what the closed loop does."""
    return [*design(setup, tuned), Table("Closed loop", ["", ""], rows(setup, closed(setup, tuned)))]
