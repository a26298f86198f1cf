"""What it takes before anything is measured: start-up, memory and the size of an installation.

Each program is a process of its own, in turn; its peak memory is what its parent, a small process, is told at its end.
Sizes are the files of a distribution and of all that it requires, extras and compiled modules not counted.
"""

import importlib.metadata
import importlib.util
import json
import subprocess
import sys
from pathlib import Path

from measure import Against, versus
from packaging.requirements import Requirement
from scene import STAGE

import stagectl

_MEASURED = (
    "import json, resource, subprocess, sys\n"
    "subprocess.run([sys.executable, *sys.argv[1:]], check=True, capture_output=True)\n"
    "spent = resource.getrusage(resource.RUSAGE_CHILDREN)\n"
    "print(json.dumps([spent.ru_utime + spent.ru_stime, spent.ru_maxrss / 1024]))"
)
_EDS = str(STAGE.parent / "drives" / "stagectl-virtual.eds")
_SPEAKS = f"import stagectl.drives.canopen.drive, stagectl.drives.canopen.network as wire; wire.load_eds({_EDS!r}, 1)"
_SIMULATES = "import stagectl.simulation, numba"  # as a long motion needs it; a short one goes without numba
# What the two of a pair are there for: (what, peer, the module it needs, ours, theirs)
_PAIRS = (
    ("a command's help", "moteus", "moteus", ["-m", "stagectl", "--help"], ["-m", "moteus.moteus_tool", "--help"]),
    (
        "driver with its EDS",
        "python-canopen, p402",
        "canopen",
        ["-c", _SPEAKS],
        ["-c", f"import canopen, canopen.profiles.p402; canopen.import_od({_EDS!r}, 1)"],
    ),
    (
        "driver",
        "moteus",
        "moteus",
        ["-c", _SPEAKS],
        ["-c", "import moteus"],
    ),
    ("simulator", "MuJoCo", "mujoco", ["-c", _SIMULATES], ["-c", "import mujoco"]),
    (
        "simulator",
        "scipy",
        "scipy",
        ["-c", _SIMULATES],
        ["-c", "import scipy.integrate"],
    ),
)
_TOPIC = "Start-up, memory, size"
_METHOD = (
    "processes in turn that import the modules, and read the drive's EDS where there is one; CPU time and peak memory"
)


def rows(rounds: int) -> tuple[list[Against], dict[str, str]]:
    """Comparisons, and what could not be compared."""
    lines, skipped = [], {}
    for what, peer, module, ours, theirs in _PAIRS:
        if importlib.util.find_spec(module) is None:
            skipped[f"start-up of {peer}"] = f"{module} is not installed: pip install -e '.[bench]'"
            continue
        found = [(_process(ours), _process(theirs)) for _ in range(rounds + 1)][1:]  # the first reads the disk
        for column, (name, unit) in enumerate((("CPU to start", "s"), ("peak memory", "MiB"))):
            values = [a[column] for a, _ in found], [b[column] for _, b in found]
            lines.append(versus((_TOPIC, peer, f"{what}: {name}"), values, (unit, 1.0), _METHOD))
    for peer in ("canopen", "moteus", "mujoco"):
        if importlib.util.find_spec(peer):
            sizes = [installed("stagectl")], [installed(peer)]
            label, scale = (_TOPIC, peer, "installation, with what it requires"), ("MB", 1e-6)
            lines.append(
                versus(label, sizes, scale, "all files of the distributions, without extras and compiled modules")
            )
    return lines, skipped


def _process(arguments: list[str]) -> tuple[float, float]:
    """Seconds and MiB."""
    done = subprocess.run([sys.executable, "-c", _MEASURED, *arguments], capture_output=True, text=True, check=True)
    spent, memory = json.loads(done.stdout)
    return spent, memory


def installed(name: str) -> float:
    """Bytes of a distribution and of all that it requires."""
    total, known, ahead = 0.0, set[str](), [name]
    while ahead:
        one = ahead.pop().lower().replace("_", "-")
        if one in known:
            continue
        known.add(one)
        total += _own(one)
        asked = [Requirement(text) for text in importlib.metadata.requires(one) or ()]
        ahead += [each.name for each in asked if each.marker is None or each.marker.evaluate({"extra": ""})]
    return total


def _own(name: str) -> float:
    if name == "stagectl":  # this checkout: what is installed of it is a pointer
        paths = [path for path in Path(stagectl.__file__).parent.rglob("*") if path.is_file()]
    else:
        found = importlib.metadata.files(name) or ()
        paths = [path for path in (Path(str(file.locate())) for file in found) if path.is_file()]
    return float(sum(path.stat().st_size for path in paths if path.suffix != ".pyc"))
