"""Many machines, a folder each: the diagnosis of every one of them, in one line."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from stagectl.gap.logs.session import GapError
from stagectl.gap.result import result_json
from stagectl.gap.result.diagnosis import Gap
from stagectl.units import StageError


class FleetMachine(NamedTuple):
    """One folder, for whichever process diagnoses it."""

    folder: str
    name: str  # in the table
    excluded: tuple[str, ...] = ()
    full: bool = False


def names_of(folders: Sequence[Path]) -> list[str]:
    """A name for each folder: as much of its path as distinguishes it from the others."""
    for parts in range(1, max((len(folder.parts) for folder in folders), default=1) + 1):
        names = ["/".join(folder.parts[-parts:]) for folder in folders]
        if len(set(names)) == len(names):
            return names
    return [str(folder) for folder in folders]


class MachineSummary(NamedTuple):
    """What was found on one machine."""

    machine: str
    verdict: str  # of VERDICTS; empty where it could not be diagnosed
    named: tuple[str, ...]
    gap: float  # rms on held-out runs, in `unit`
    left: float  # with what was found in the model
    unit: str
    drift: float | None  # of the gap since the folder's last diagnosis, as a share; None: it is the first
    words: str  # the sentence, or why it could not be diagnosed


def diagnosed(machine: FleetMachine) -> MachineSummary:
    """Diagnose one folder and write diagnosis.json into it.

    A folder that cannot be diagnosed gives a summary with the reason: the other machines must not suffer from it.
    """
    from stagectl.gap.diagnose import Options, diagnose
    from stagectl.gap.logs import load_session

    folder = Path(machine.folder)
    last = _last_gap(folder)
    try:
        options = Options(machine.excluded, machine.full)
        result = diagnose(load_session.load([folder]), options, lambda _: None).result
        result_json.save(result, folder)
    except Exception as error:  # whatever one machine's logs cause
        words = str(error) if isinstance(error, StageError) else f"{type(error).__name__}: {error}"
        return MachineSummary(machine.name, "", (), math.nan, math.nan, "", None, words)
    names, gap = tuple(effect.name for effect in result.named), result.gap
    change = drift(last, gap)
    return MachineSummary(machine.name, result.verdict, names, gap.before, gap.after, gap.unit, change, result.sentence)


def _last_gap(folder: Path) -> Gap | None:
    try:
        return result_json.load(folder).gap
    except GapError:
        return None


def drift(last: Gap | None, now: Gap) -> float | None:
    """Change of the gap since the last diagnosis, as a share of it."""
    if last is None or last.unit != now.unit or not last.before > 0.0:
        return None
    return now.before / last.before - 1.0
