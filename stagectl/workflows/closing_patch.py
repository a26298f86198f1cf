"""What a diagnosis found, as a change of the stage file that the stage file takes."""

from __future__ import annotations

import contextlib
from pathlib import Path

from stagectl.config.source import read_text
from stagectl.config.stage_file import load_stage
from stagectl.gap.effects.library import label
from stagectl.gap.result import patch
from stagectl.gap.result.diagnosis import DiagnosisResult
from stagectl.units import StageError
from stagectl.workflows.motion import Say


def patch_of(found: DiagnosisResult, path: Path, stage: Path, say: Say) -> patch.Patch:
    """The patch of the version `stage` of the stage file `path` with all that was found.

    Where it would be refused with all of it, the patch holds what the stage file takes.  Raises StageError where it
    takes nothing.
    """
    text = read_text(stage)

    def of(names: tuple[str, ...]) -> patch.Patch:
        change = patch.patch_of(found, path, names, text=text)
        load_stage(path, text=change.after)
        return change

    try:
        return of(())
    except StageError as error:
        refused, taken = error, tuple[str, ...]()
    for effect in found.named:
        with contextlib.suppress(StageError):
            of((*taken, effect.name))
            taken = (*taken, effect.name)
    if not taken:
        raise refused
    say(f"applied without the rest: {', '.join(map(label, taken))}; {refused}")
    return of(taken)
