"""The trend over days in a twin's slow record: which parameter drifts, how fast, and by which effect's name.

A line is fitted through all values, weighted by their own intervals.  Where they scatter more than these allow, by
another temperature or another motion, the interval of the slope grows with the scatter:

    slope +- t sqrt(cov max(1, chi^2/(n - 2)))

Source: P. R. Bevington, D. K. Robinson, Data Reduction and Error Analysis, 2003, section 6 and equation 4.35
(uncertainties scaled by the scatter).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from stagectl.gap.effects.library import FORCE_SCALED
from stagectl.gap.logs.session import GapError
from stagectl.twin.thresholds import FEWEST_LINES, LEAST_ERROR, MATERIAL_DRIFT, RISK

DAY = 86400.0  # s


class Trend(NamedTuple):
    """One parameter over time, SI per day."""

    name: str
    unit: str
    lines: int
    days: float  # from first to last
    start: float  # value of the line through all at the first
    slope: float  # per day
    half: float  # 95 % interval, either way
    scale: float

    @property
    def sure(self) -> bool:
        """Whether the interval excludes zero."""
        return abs(self.slope) > self.half

    @property
    def drifts(self) -> bool:
        """Whether it is sure, and over the whole record large enough to matter."""
        return self.sure and abs(self.slope) * self.days > MATERIAL_DRIFT * abs(self.scale)


class DriftReport(NamedTuple):
    """What drifts in a record."""

    trends: tuple[Trend, ...]
    named: tuple[str, ...]
    alternatives: tuple[str, ...]  # of the name, where there is one and others explain the record as well
    sentence: str


def drift(lines: Sequence[dict[str, Any]], axis: str | None = None) -> DriftReport:
    """Trends of all parameters in the `lines` of one `axis` (its name; None where the record holds one only).

    Raises GapError where there are too few, or several axes.
    """
    names = sorted({str(line["name"]) for line in lines})
    if axis is None and len(names) > 1:
        raise GapError(f"the record holds several axes: {', '.join(names)}; choose one with --axis")
    if axis is not None and axis not in names:
        raise GapError(f"--axis {axis}: the record holds {', '.join(names) or 'no axis'}")
    own = [line for line in lines if axis is None or line["name"] == axis]
    if len(own) < FEWEST_LINES:
        raise GapError(
            f"the record has {len(own)} lines; at least {FEWEST_LINES} are needed for a trend: run with --twin again"
        )
    known = sorted({name for line in own for name in line["drift"]})
    trends = tuple(trend for name in known if (trend := _trend(name, own)) is not None)
    return _named(trends)


def _trend(name: str, lines: Sequence[dict[str, Any]]) -> Trend | None:
    having = [line for line in lines if name in line["drift"]]
    if len(having) < FEWEST_LINES:
        return None
    entries = [line["drift"][name] for line in having]
    days = np.array([line["time"] for line in having]) / DAY
    span = float(days[-1] - days[0])
    if span <= 0.0:
        return None
    values, errors = (np.array([entry[key] for entry in entries], dtype=np.float64) for key in ("value", "error"))
    scale = float(entries[-1]["scale"])
    errors = np.maximum(errors, LEAST_ERROR * abs(scale))
    columns = np.column_stack([np.ones(len(days)), days - days[0]]) / errors[:, None]
    cov = np.linalg.inv(columns.T @ columns)
    start, slope = cov @ columns.T @ (values / errors)
    free = len(days) - 2
    chi = float(np.sum((values / errors - columns @ [start, slope]) ** 2)) / free
    half = float(stats.t.ppf(1.0 - RISK / 2.0, free) * np.sqrt(cov[1, 1] * max(1.0, chi)))
    return Trend(name, entries[-1]["unit"], len(days), span, float(start), float(slope), half, scale)


def _named(trends: tuple[Trend, ...]) -> DriftReport:
    drifting = sorted((trend for trend in trends if trend.drifts), key=lambda trend: -abs(trend.slope / trend.scale))
    if not drifting:
        return DriftReport(trends, (), (), f"nothing drifts beyond {100 * MATERIAL_DRIFT:.0f} % over {_span(trends)}")
    if (rate := _common_rate([trend for trend in trends if trend.name in FORCE_SCALED])) is not None:
        rest = [trend for trend in drifting if trend.name not in (*FORCE_SCALED, "bias")]
        words = f"force_constant or current_gain {100 * -rate:+.3g} % a day: inertia, viscous and coulomb drift alike"
        named = ("force_constant", *(trend.name for trend in rest))
        return DriftReport(trends, named, ("current_gain",), "; ".join([words, *map(_words, rest)]))
    return DriftReport(trends, tuple(t.name for t in drifting), (), "; ".join(map(_words, drifting)))


def _common_rate(common: Sequence[Trend]) -> float | None:
    """The factor per day by which inertia, viscous and coulomb rise, an exact ambiguity with Kt; None: not by one."""
    if len(common) < len(FORCE_SCALED) or sum(trend.drifts for trend in common) < 2:
        return None
    rates = np.array([trend.slope / trend.scale for trend in common])
    errors = np.array([trend.half / trend.scale for trend in common]) / stats.norm.ppf(1.0 - RISK / 2.0)
    mean = np.average(rates, weights=errors**-2.0)
    apart = float(np.sum(((rates - mean) / errors) ** 2))
    return float(mean) if apart < float(stats.chi2.ppf(1.0 - RISK, len(common) - 1)) else None


def _words(trend: Trend) -> str:
    low, high = trend.slope - trend.half, trend.slope + trend.half
    share = 100.0 * trend.slope / trend.scale
    if trend.unit == "s":
        return f"{trend.name} {trend.slope * 1e6:+.3g} µs a day [{low * 1e6:.3g}, {high * 1e6:.3g}]"
    return f"{trend.name} {share:+.3g} % a day ({trend.slope:+.3g} [{low:.3g}, {high:.3g}] {trend.unit} a day)"


def _span(trends: Sequence[Trend]) -> str:
    days = max((trend.days for trend in trends), default=0.0)
    return f"{days:.3g} days" if days >= 1.0 else f"{24.0 * days:.3g} hours"
