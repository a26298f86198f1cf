"""Figures of the frequency response, see `conventional`."""

from stagectl.report.conventional import pictures

__all__ = ["pictures"]
