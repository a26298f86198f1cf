"""Options and arguments as the help shows them, and those that several commands take."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from stagectl.api.arguments import quantity
from stagectl.cli.streams import check_output
from stagectl.replacing import JSON, JSON_LINES, PAGE, check_file_to_be, check_replaceable
from stagectl.units import Quantity


def option(shown: str, help: str, **others: Any) -> Any:
    """``--flag``, ``--for TIME``, ``--output -o FILE``: the names of an option, and of what it takes."""
    words = shown.split()
    names = [word for word in words if word.startswith("-")]
    return typer.Option(*names, metavar=" ".join(words[len(names) :]) or None, help=help, **others)


def argument(shown: str, help: str, **others: Any) -> Any:
    """A word without a name, such as ``STAGE.yaml``."""
    return typer.Argument(metavar=shown, help=help, **others)


def replacing(mark: str) -> Callable[[Any], Any]:
    """What refuses a file that a long computation could not replace in the end, before it begins; see `replacing`."""

    def check(value: Any) -> Any:
        if str(value) == "-":
            check_output()
        elif value is not None:
            check_replaceable(Path(value), mark)
            check_file_to_be(Path(value))
        return value

    return check


StageArgument = Annotated[Path, argument("STAGE.yaml", "The machine.")]
TrajectoryArgument = Annotated[Path, argument("TRAJECTORY.yaml", "The motion.")]
Stages = Annotated[
    list[str], argument("STAGE.yaml...", "The machine; several files as NAME=STAGE.yaml, e.g. x=x.yaml y=y.yaml.")
]
Json = Annotated[str | None, option("--json FILE", "Result as JSON; - for standard output.", callback=replacing(JSON))]
Lines = Annotated[
    str | None,
    option("--json FILE", "A line of JSON for each message; - for standard output.", callback=replacing(JSON_LINES)),
]
Report = Annotated[
    Path | None,
    option("--report FILE.html", "Where the page goes; default: into recordings/.", callback=replacing(PAGE)),
]
Write = Annotated[Path | None, option("--write STAGE.yaml", "Write the result into a copy, or the file itself.")]
Folder = Annotated[Path | None, option("--output -o FOLDER", "Where to put the recordings.")]
Channel = Annotated[str | None, option("--channel", "Bus channel instead of the stage file's.")]
Simulate = Annotated[bool, option("--simulate", "On the stage model, compiled, instead of the drive.")]
Plant = Annotated[Path | None, option("--plant PLANT.yaml", "The simulated machine, where it differs from the model.")]
Without = Annotated[
    list[str] | None,
    option(
        "--without LAYER",
        "Switch off: ptc, friction (or its compensator), effects, observer; or one effect, such as cogging.",
    ),
]
MachineOfTheDay = Annotated[
    int,
    option(
        "--machine-of-the-day SEED",
        "Draw a machine near the model, with hidden parameters, friction and effects; 0: the model itself.",
        min=0,
        max=2**31 - 1,
    ),
]
Socket = Annotated[Path | None, option("--socket PATH", "Control socket of the service; default: $STAGECTL_SOCKET.")]
AxisName = Annotated[str, option("--axis NAME", "One axis; default: all.")]
OneAxis = Annotated[str, option("--axis NAME", "Which axis; needed if there are several.")]
FirstAxis = Annotated[str, option("--axis NAME", "Which axis; default: the first one.")]
NoWait = Annotated[bool, option("--no-wait", "Return when the motion has started.")]
Columns = Annotated[
    str | None, option("--columns WHICH", "Of logs: time=t,position=qm:mm,current=3; numbers count from 1.")
]
_CURRENT = Quantity("A", "(0, 1000]", "largest current")


def amperes(name: str, text: str | None) -> float | None:
    """The current (A) that an option of this name states, or None without it.  Raises ArgumentError."""
    return quantity(name, text, _CURRENT, "it such as '1.2 A'")
