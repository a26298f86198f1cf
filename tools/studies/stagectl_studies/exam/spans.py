"""When the gap is open: truth by rows against spans of time, F1 over all rows of the captures that were judged."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stagectl_studies.machine.reference import PERIOD

Flags = NDArray[np.bool_]


def rows_of(spans: Sequence[Sequence[float]], n: int) -> Flags:
    """Rows (n,) inside spans of seconds."""
    flags = np.zeros(n, dtype=np.bool_)
    for begin, end in spans:
        flags[max(round(begin / PERIOD), 0) : max(round(end / PERIOD), 0)] = True
    return flags


def open_rows(truth: Mapping[str, Any], arrays: Mapping[str, Any], file: str) -> Flags:
    """Rows of one capture where any hidden effect acts."""
    source = truth["noise_free"][file]
    each = [arrays[f"where/{effect['name']}/{source}"] for effect in truth["effects"]]
    return np.asarray(np.logical_or.reduce(each), dtype=np.bool_)


def judged(
    truth: Mapping[str, Any], arrays: Mapping[str, Any], captures: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Precision, recall and F1 of the answer's spans; captures for diagnosis that it does not list count as closed.

    `everywhere`: F1 of an answer that calls all rows open, which an answer has to surpass.
    """
    listed = {capture["file"]: capture["spans"] for capture in captures}
    files = [file for file in truth["noise_free"] if file in listed or not file.startswith("held-")]
    both = said = true = whole = 0
    for file in files:
        actual = open_rows(truth, arrays, file)
        flags = rows_of(listed.get(file, ()), actual.size)
        both, said, true = both + int((actual & flags).sum()), said + int(flags.sum()), true + int(actual.sum())
        whole += actual.size
    return {
        "precision": both / said if said else 0.0,
        "recall": both / true if true else 0.0,
        "f1": 2.0 * both / (said + true) if said + true else 0.0,
        "everywhere": 2.0 * true / (whole + true) if whole + true else 0.0,
    }
