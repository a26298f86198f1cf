"""Figure of the low-speed examination, see `conventional`."""

from stagectl.report.conventional import pictures

__all__ = ["pictures"]
