"""What cannot be separated, and what is doubtful, in words: judged from the fit, not from the method."""

from __future__ import annotations
from typing import Any

from stagectl.config.stage_file import StageFile
from stagectl.identification.delay_search import Fit, Problem
from stagectl.identification.found import Parameter
from stagectl.identification.intervals import Known


def written(
    problem: Problem, fit: Fit, known: Known, parameters: dict[str, Parameter], file: StageFile, details: dict[str, Any]
) -> tuple[str, ...]:
    return ()
