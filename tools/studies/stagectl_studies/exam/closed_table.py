"""Rows and table of the machines that were closed: how far from what is possible, and whether it was foretold."""

from collections.abc import Mapping, Sequence
from typing import Any

from stagectl.number_format import length, percent
from stagectl.report.page import Section, Table
from stagectl_studies.exam.closed import AFTER, BEFORE, ORACLE
from stagectl_studies.exam.plan import CLOSED
from stagectl_studies.exam.rows import Asked, Row, median, rate

Record = Mapping[str, Any]
RATIO, POINTS = 1.3, 5.0  # of the tracking error over the oracle's, and between closures; from the issue that asked
HEAD = ["trial", "friction", "hidden", "named", "before", "after", "oracle", "foretold", "on the machine"]


def of(records: Sequence[Record]) -> list[Record]:
    """Those of the stratum that have a score."""
    return [record for record in records if record["stratum"] == CLOSED and "closing" in record]


def rows(records: Sequence[Record]) -> list[Row]:
    """What must be reached on `records` of machines that were closed; none where there are none."""
    if not records:
        return []
    rms, true = ([record["closing"][kind] for record in records] for kind in ("rms", "true"))
    foretold = [record["closing"] for record in records if record["closing"]["foretold"] is not None]
    return [
        median("closed: tracking error over the oracle's", [_over(x, ORACLE) for x in rms], Asked(RATIO, RATIO, True)),
        median("  closed: the same of the true position", [_over(x, ORACLE) for x in true]),
        rate("  closed: worse than at the start", [_worse(record) for record in records], Asked(0.0, 0.0, True)),
        median("  closed: over the error at the start", [_over(x, BEFORE) for x in rms]),
        median("  closed: foretold against realised closure, points", _missed(foretold), Asked(POINTS, POINTS, True)),
    ]


def _worse(record: Record) -> bool:
    """As measured, or in the true position: a wrong map of the encoder shows only there."""
    return any(_over(record["closing"][kind], BEFORE) > 1.0 for kind in ("rms", "true"))


def _over(rms: Mapping[str, float], other: str) -> float:
    return rms[AFTER] / rms[other]


def _missed(closings: Sequence[Record]) -> list[float]:
    return [100.0 * abs(one["foretold"] - one["realised"]) for one in closings]


def section(records: Sequence[Record]) -> Section | None:
    """One machine a line; None where none was closed."""
    mine = of(records)
    remark = (
        "Tracking error, rms, on motions that neither diagnosis nor tuning saw, as measured; that of the true position "
        "in brackets. Closure is of the square."
    )
    table = Table("", HEAD, [_line(record) for record in mine])
    return Section("Machines that were closed", [remark], [], [table]) if mine else None


def _line(record: Record) -> list[str]:
    truth, closing = record["truth"], record["closing"]
    hidden = ", ".join(f"{name} x{size:.2g}" for name, size in truth["effects"].items())
    errors = [
        f"{length(closing['rms'][name], 'm')} ({length(closing['true'][name], 'm')})"
        for name in (BEFORE, AFTER, ORACLE)
    ]
    closures = ["" if closing[name] is None else percent(closing[name]) for name in ("foretold", "realised")]
    return [str(record["number"]), truth["law"], hidden, ", ".join(record["answer"]["named"]), *errors, *closures]
