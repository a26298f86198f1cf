"""The comparison of the friction family in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stagectl.identification.capture import Capture

REPEATS = 0.999  # correlation of a reference with itself a period later


def _line(row: dict[str, Any], lowest: float) -> str:
    """One model of the comparison, in words."""
    said = (
        f"{row['words']}, {row['count']} parameters: leaves {row['force_residual_percent']:.3g} % of the force, "
        f"{row['held_out']['fastest']:.3g} % of the fastest rows held out, BIC {row['bic'] - lowest:+.1f}"
    )
    return said + (f"; closed loop {four(row['closed_loop'])}" if "closed_loop" in row else "")


def four(errors: Mapping[str, float]) -> str:
    """The four errors in closed loop, as text."""
    return " / ".join(f"{value:.4g}" for value in errors.values()) + " %"


def words(rows: list[dict[str, Any]], best: int, captures: list[Capture]) -> list[str]:
    """The comparison of all `rows`, the `best` first, and what the captures do to it."""
    chosen, first = rows[best], min(rows, key=lambda row: float(row["bic"]))
    notes = [_praise(chosen, rows[0], "of those that a stage file can have whole")]
    if first is not chosen:
        notes.append(_praise(first, rows[0], f"of all {len(rows)}"))
    period = next((found for one in captures if (found := repeats(one)) is not None), None)
    if period is not None:
        notes.append(
            f"the reference repeats every {period:.4g} s: the later half holds the same motion as the earlier, so it "
            "shows how far machine and noise repeat, not how a model does on another motion; the fastest rows, held "
            "out, show how it reaches beyond the speeds that it saw"
        )
    notes += [_line(row, float(first["bic"])) for row in rows]
    if "closed_loop" in chosen:
        notes.append(
            "closed loop: errors of position / velocity / acceleration / force; table and rheology model run as the "
            "stop operators with their curve, without the creep"
        )
    return notes


def _praise(row: dict[str, Any], simplest: dict[str, Any], among: str) -> str:
    return (
        f"{row['words']} ({row['count']} parameters) has the lowest BIC {among}: it leaves "
        f"{row['force_residual_percent']:.3g} % of the force, {simplest['words']} ({simplest['count']}) "
        f"{simplest['force_residual_percent']:.3g} %"
    )


def repeats(capture: Capture) -> float | None:
    """Period (s) of a reference that repeats at least twice; None where it does not, or there is none."""
    if capture.reference is None:
        return None
    x = capture.reference - capture.reference.mean()
    size = len(x)
    spectrum = np.fft.rfft(x, 2 * size)
    product = np.fft.irfft(spectrum * np.conj(spectrum))[: size // 2]
    power = np.concatenate([[0.0], np.cumsum(x * x)])
    lags = np.arange(size // 2)
    likeness = product / np.sqrt(np.maximum(power[size - lags] * (power[size] - power[lags]), 1e-300))
    turned = np.flatnonzero(likeness < 0.5)
    if not len(turned):
        return None
    later = int(turned[0] + np.argmax(likeness[turned[0] :]))
    return later * capture.dt if likeness[later] > REPEATS else None
