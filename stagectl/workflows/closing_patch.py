"""The model that a diagnosis leads to, as a change of the stage file that the stage file takes."""

import contextlib
from pathlib import Path

from stagectl.config.source import read_text
from stagectl.config.stage_file import load_stage
from stagectl.gap.diagnose import Diagnosis
from stagectl.gap.effects.library import label
from stagectl.gap.inference.patch_fields import fields_of
from stagectl.gap.result import patch
from stagectl.gap.result.diagnosis import DiagnosisResult
from stagectl.kernels.stage import Stage
from stagectl.units import StageError
from stagectl.workflows.motion import Say


def patch_of(found: Diagnosis, nominal: Stage, path: Path, stage: Path, say: Say) -> patch.Patch:
    """The patch of the version `stage` of the stage file `path` with the whole model that was fitted.

    That is more than what is named: also the form of the friction, and what no effect explains as a table.  Where the
    stage file takes no such model, the patch holds what it takes of the named effects.  Raises StageError where that
    is none.
    """
    text = read_text(stage)
    try:
        whole = patch.patch_with(dict(fields_of(nominal, found.improved)), path, text)
        load_stage(path, text=whole.after)
    except StageError as error:
        if not found.result.named:
            raise
        return of_named(found.result, path, text, error, say)
    return whole


def of_named(found: DiagnosisResult, path: Path, text: str, refused: StageError, say: Say) -> patch.Patch:
    """As much of the named effects as the stage file with this `text` takes; raises `refused` where it takes none."""

    def of(names: tuple[str, ...]) -> patch.Patch:
        change = patch.patch_of(found, path, names, text=text)
        load_stage(path, text=change.after)
        return change

    taken = tuple[str, ...]()
    for effect in found.named:
        with contextlib.suppress(StageError):
            of((*taken, effect.name))
            taken = (*taken, effect.name)
    if not taken:
        raise refused
    say(f"applied without the rest: {', '.join(map(label, taken))}; {refused}")
    return of(taken)
