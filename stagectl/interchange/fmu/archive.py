"""A stage as an FMU: descriptions, sources, a binary where there is a C compiler; checked and run by FMPy at once."""

import os
import re
import shutil
import subprocess
import uuid
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

import fmpy
import numpy as np
from fmpy.validation import validate_fmu

from stagectl.config.stage_file import Setup
from stagectl.interchange.export import ExportedModel, ExportError
from stagectl.interchange.fmu import description
from stagectl.interchange.fmu.variables import variables
from stagectl.interchange.round_trip import Array, Simulated, compared
from stagectl.problem import ProblemKind
from stagectl.replacing import check_replaceable, replaced
from stagectl.units import StageError

SOURCE = "fmi3.c"
COMPILERS = ("cc", "gcc", "clang")
_SPACE = uuid.UUID("7c9df1f2-6d6f-4d2c-9a3e-2f4c0c1f5a10")  # of the tokens of these models


class CompileError(StageError):
    """A C compiler that did not accept the model."""


def compiler() -> str | None:
    """The C compiler: that of the environment's CC, else the first on the path; None where there is none."""
    named = os.environ.get("CC")
    return next((found for name in ([named] if named else COMPILERS) if (found := shutil.which(name))), None)


def write(setup: Setup, path: Path, with_compiler: str | None) -> None:
    """Write the FMU `path`; without a compiler it has its sources only.

    Raises CompileError, and OSError where the file cannot be written.
    """
    check_replaceable(path, _ours)
    identifier = re.sub(r"\W", "_", path.stem, flags=re.ASCII)
    identifier = f"_{identifier}" if identifier[0].isdigit() else identifier
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        _sources(setup, folder, identifier)
        if with_compiler is not None:
            _compile(with_compiler, folder, identifier)
        with replaced(path) as fresh, zipfile.ZipFile(fresh, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in sorted(each for each in folder.rglob("*") if each.is_file()):
                archive.write(file, file.relative_to(folder))


def _ours(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return b'generationTool="stagectl' in archive.read("modelDescription.xml")
    except (zipfile.BadZipFile, KeyError):
        return False


def _sources(setup: Setup, folder: Path, identifier: str) -> None:
    each = variables(setup)
    header = description.header(setup, each)
    token = f"{{{uuid.uuid5(_SPACE, header)}}}"
    sources = folder / "sources"
    shutil.copytree(Path(fmpy.__file__).parent / "c-code", sources, ignore=shutil.ignore_patterns("*.txt", "fmi[12]*"))
    shutil.copy(Path(__file__).parent / SOURCE, sources)
    texts = {
        "sources/model.h": f'#define TOKEN "{token}"\n{header}',
        "sources/buildDescription.xml": description.build_description(identifier, SOURCE),
        "modelDescription.xml": description.model_description(setup, each, identifier, token),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")


def _compile(command: str, folder: Path, identifier: str) -> None:
    binary = folder / "binaries" / fmpy.platform_tuple / f"{identifier}{fmpy.sharedLibraryExtension}"
    binary.parent.mkdir(parents=True)
    options = [*description.OPTIONS.split(), "-fPIC", "-shared"]
    words = [command, *options, str(folder / "sources" / SOURCE), "-o", str(binary), "-lm"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise CompileError(f"{' '.join(words)} ended with {done.returncode}: {done.stderr.strip()}")


NO_COMPILER = (
    "no C compiler on this machine (CC, cc, gcc, clang): the FMU has its sources only and was not run. "
    "Where there are a compiler and cmake: fmpy compile {path}"
)


def to_fmu(setup: Setup, path: Path) -> ExportedModel:
    """Write the FMU `path`; with a binary of this platform and run by FMPy where there is a C compiler.

    Raises ExportError where it cannot be written, or where FMPy's validation finds something.
    """
    command = compiler()
    with ExportError.instead_of((OSError,), f"{path} cannot be written", path, ProblemKind.FILE):
        write(setup, path, command)
    if wrong := findings(path):
        raise ExportError(f"FMPy's validation finds in {path}: {'; '.join(wrong)}")
    simulator, losses = f"FMPy {fmpy.__version__}", _random_numbers(setup)
    if command is None:
        return ExportedModel(simulator, (path,), {}, losses, (NO_COMPILER.format(path=path),))
    variants = {path.name: compared(setup, simulated(setup, path))}
    return ExportedModel(simulator, (path,), variants, losses, ("FMPy's validation: no findings.",))


def _random_numbers(setup: Setup) -> list[str]:
    """What the FMU does not hold: all of the plant is in the kernels' source, random numbers are drawn outside."""
    p = setup.file.simulation
    drawn = {"drive.jitter": setup.stage.drive.jitter, "simulation.current_noise": p.current_noise}
    drawn |= {"simulation.encoder_noise": p.encoder_noise}
    return [f"{name} = {value:.4g}: it draws random numbers" for name, value in drawn.items() if value]


def findings(path: Path) -> list[str]:
    """What FMPy's validation finds wrong with the FMU."""
    return [str(problem) for problem in validate_fmu(str(path))]


def simulated(setup: Setup, path: Path) -> Simulated:
    """What runs commands through the FMU `path`."""

    def run(current: Array) -> Array:
        found = fmpy.simulate_fmu(
            str(path), output_interval=setup.dt, stop_time=(len(current) - 1) * setup.dt,
            input=_signals(setup, current), output=["position"],
        )  # fmt: skip
        positions: Array = found["position"]
        assert len(positions) == len(current)
        return positions

    return run


def _signals(setup: Setup, current: Array) -> np.ndarray:
    """The inputs as FMPy takes them: commands that are held from their time on."""
    signals = np.zeros(len(current), dtype=[(name, np.float64) for name in ("time", "command", "added_current")])
    signals["time"] = np.arange(len(current)) * setup.dt
    signals["command"] = current
    return signals
