"""Many machines, a folder each: what a diagnosis says of every one of them, in one line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from stagectl.gap.logs.session import GapError
from stagectl.gap.result import result_json
from stagectl.gap.result.diagnosis import Gap
from stagectl.units import StageError


class Machine(NamedTuple):
    """One folder, for whichever process diagnoses it."""

    folder: str
    name: str  # in the table
    excluded: tuple[str, ...] = ()
    full: bool = False


def names_of(folders: Sequence[Path]) -> list[str]:
    """A name for each folder: as much of its path as tells it from the others."""
    for parts in range(1, max((len(one.parts) for one in folders), default=1) + 1):
        names = ["/".join(one.parts[-parts:]) for one in folders]
        if len(set(names)) == len(names):
            return names
    return [str(one) for one in folders]


class Line(NamedTuple):
    """What was found on one machine."""

    machine: str
    verdict: str  # of VERDICTS; empty where it could not be diagnosed
    named: tuple[str, ...]
    gap: float  # rms on held-out runs, in `unit`
    left: float  # with what was found in the model
    unit: str
    drift: float | None  # of the gap since the folder's last diagnosis, as a share; None: it is the first
    words: str  # the sentence, or why it could not be diagnosed


def diagnosed(machine: Machine) -> Line:
    """Diagnose one folder, leave diagnosis.json in it; a folder that cannot be diagnosed is a line that says so."""
    from stagectl.gap import diagnose as pipeline
    from stagectl.gap.logs import load_session as folders

    folder = Path(machine.folder)
    before = _last(folder)
    try:
        session = folders.load([folder])
        found = pipeline.diagnose(session, pipeline.Options(machine.excluded, machine.full), lambda _: None).found
        result_json.save(found, folder)
    except Exception as error:  # whatever one machine's logs bring about, the others' lines stand
        words = str(error) if isinstance(error, StageError) else f"{type(error).__name__}: {error}"
        return Line(machine.name, "", (), math.nan, math.nan, "", None, words)
    named = tuple(one.name for one in found.named)
    gap = found.gap
    return Line(machine.name, found.verdict, named, gap.before, gap.after, gap.unit, drift(before, gap), found.sentence)


def _last(folder: Path) -> Gap | None:
    try:
        return result_json.load(folder).gap
    except GapError:
        return None


def drift(before: Gap | None, now: Gap) -> float | None:
    """Change of the gap since the last diagnosis, as a share of it."""
    if before is None or before.unit != now.unit or not before.before > 0.0:
        return None
    return now.before / before.before - 1.0
