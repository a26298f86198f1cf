"""The signed page: a person reads the HTML, a program the JSON next to it."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

from stagectl.number_format import length
from stagectl.report.page import Page, Table, write
from stagectl.workflows.acceptance.pictures import pictures
from stagectl.workflows.acceptance.result import Acceptance, StepResult

_HEAD = ["step", "what was tried", "result", "distance", "bound", "what was found"]
_SENTENCES = (1, 2, 5)  # columns
_VIRTUAL = (
    "a virtual drive: this page says nothing about a machine. With simulation.clock: sync its axis stands still while"
    " the bus is silent; then the distances of kill and silence are zero"
)


def write_pages(result: Acceptance, signature: dict[str, Any], path: Path) -> tuple[Path, Path]:
    """Write JSON and HTML next to each other, `path` without its suffix; the two files.

    The JSON is the signed one; the page shows its hash.  Raises OSError, too where one is there already.
    """
    machine, human = path.with_suffix(".json"), path.with_suffix(".html")
    path.parent.mkdir(parents=True, exist_ok=True)
    with machine.open("x", encoding="utf-8") as file:
        json.dump(signature, file, indent=2, ensure_ascii=False, allow_nan=False)
        file.write("\n")
    human.open("x").close()  # nothing that is there is written over
    return machine, write(_page(result, signature, machine), human)


def _page(result: Acceptance, signature: dict[str, Any], machine: Path) -> Page:
    missing = [step for step in result.steps if step.outcome.value != "passed"]
    answer = (
        f"Accepted: all {len(result.steps)} steps were done and passed."
        if result.accepted
        else "NOT ACCEPTED: " + "; ".join(f"{step.name} {step.outcome.value}" for step in missing) + "."
    )
    return Page(
        f"Acceptance of {result.stage}",
        answer,
        _notes(result, signature),
        pictures(result.steps, result.unit),
        [
            Table("Steps", _HEAD, [_row(step, result.unit) for step in result.steps], _SENTENCES),
            Table("Drive", ["", ""], [[name, value] for name, value in result.drive.items()]),
        ],
        [
            f"stagectl drive accept {result.stage_file} --person {shlex.quote(result.person)}",
            f"stagectl drive verify {machine.name}",
        ],
        result.software,
    )


def _notes(result: Acceptance, signature: dict[str, Any]) -> list[str]:
    drive = _VIRTUAL if result.virtual else "a drive on the bench"
    code = signature["hmac_sha256"]
    return [
        f"Each step was permitted by {result.person}, who signed on {result.date}. The drive is {drive}.",
        f"Stage file {result.stage_file}, SHA-256 {result.stage_sha256}; EDS, SHA-256 {result.eds_sha256}.",
        f"SHA-256 of the content: {signature['sha256']}. "
        + (f"HMAC-SHA-256: {code}." if code else "No key was configured: there is no HMAC."),
        "STO, emergency stop and end switches are no part of this: they are tried by hand, before it.",
    ]


def _row(step: StepResult, unit: str) -> list[str]:
    distances = ["" if way is None else length(way, unit) for way in (step.measured, step.bound)]
    return [step.name, step.title, step.outcome.value, *distances, step.words]
