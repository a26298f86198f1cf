"""The self-test's result as JSON values, with what one needs to answer for it."""

from __future__ import annotations

import hashlib
import math
import platform
import time
from collections.abc import Callable
from typing import Any

from stagectl.config.machine_file import text_of
from stagectl.config.stage_file import Setup
from stagectl.drives.faults import FAULT_TYPES
from stagectl.selftest import matrix, remote
from stagectl.selftest.matrix import Bench
from stagectl.selftest.remote import Gentle
from stagectl.units import StageError


def bench(setup: Setup, only: list[str] | None, gentle: Gentle | None) -> Bench:
    """What is tried: all faults or `only` some, on the virtual drive, or on the real one at a low current.

    Raises StageError where there is no such fault, and where the drive must not or cannot be moved so.
    """
    for name in only or ():
        if name not in FAULT_TYPES:
            raise StageError(f"--only {name}; must be one of {', '.join(FAULT_TYPES)}")
    chosen = frozenset(only or ())
    return matrix.virtual(setup, chosen) if gentle is None else remote.real(setup, gentle, chosen)


def run(setup: Setup, tried: Bench, signed: str, command: str, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Run the matrix; `faults` is the list of all cases, in axis units."""
    total, cases = len(tried.rows) * len(tried.states), []
    for outcome in matrix.matrix(tried):
        cases.append({name: _finite(value) for name, value in outcome._asdict().items()})
        progress(len(cases), total)
    passed = sum(case["passed"] for case in cases)
    axis = setup.file.axis
    return {
        "stage": setup.file.name,
        "file": setup.path.name,
        "file_digest": hashlib.sha256(text_of(setup.path).encode()).hexdigest(),
        "mode": tried.mode,
        "created": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        "host": platform.node(),
        "signed": signed,
        "command": command,
        "words": _words(passed, len(cases)),
        "speed": tried.speed * axis.travel_per_unit,
        "unit": axis.travel_unit,
        "travel_per_unit": axis.travel_per_unit,
        "passed": passed,
        "faults": cases,
    }


def _words(passed: int, total: int) -> str:
    if passed == total:
        return f"All {total} cases ended as they must: in the state, within the time and within the distance."
    return f"{total - passed} of {total} cases did not end as they must."


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
