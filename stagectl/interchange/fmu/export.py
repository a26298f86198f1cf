"""A stage as an FMU, checked and run by FMPy at once."""

from __future__ import annotations

from pathlib import Path

import fmpy

from stagectl.config.stage_file import Setup
from stagectl.interchange.exported import ExportedModel, ExportError
from stagectl.interchange.fmu import archive, run
from stagectl.interchange.losses import lost, random_numbers
from stagectl.interchange.round_trip import compared
from stagectl.problem import ProblemKind

NO_COMPILER = (
    "no C compiler on this machine (CC, cc, gcc, clang): the FMU has its sources only and was not run. "
    "Where there are a compiler and cmake: fmpy compile {path}"
)


def to_fmu(setup: Setup, path: Path) -> ExportedModel:
    """Write the FMU `path`; with a binary of this platform and run by FMPy where there is a C compiler.

    Raises ExportError where it cannot be written, or where FMPy's validation finds something.
    """
    command = archive.compiler()
    with ExportError.instead_of((OSError,), f"{path} cannot be written", path, ProblemKind.FILE):
        archive.write(setup, path, command)
    findings = run.findings(path)
    if findings:
        raise ExportError(f"FMPy's validation finds in {path}: {'; '.join(findings)}")
    simulator, losses = f"FMPy {fmpy.__version__}", [*lost(setup, _HELD), *random_numbers(setup)]
    if command is None:
        return ExportedModel(simulator, (path,), {}, losses, (NO_COMPILER.format(path=path),))
    variants = {path.name: compared(setup, run.simulated(setup, path))}
    return ExportedModel(simulator, (path,), variants, losses, ("FMPy's validation: no findings.",))


# All of the plant, as the source is that of the kernels; only random numbers are drawn outside.
_HELD: dict[str, set[str]] = {"residual": set()}
