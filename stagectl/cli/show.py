"""How results appear: text on the terminal, JSON on request."""

from __future__ import annotations

import json
import os
import re
import shlex
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from stagectl.api.arguments import progress as progress
from stagectl.api.arguments import terminal as terminal
from stagectl.extras import MissingExtraError, require
from stagectl.number_format import length
from stagectl.problem import Problem, ProblemKind
from stagectl.replacing import WRITTEN_BY, naming, write_json, write_text
from stagectl.units import StageError

if TYPE_CHECKING:
    from rich.status import Status

    from stagectl.api.result import ReportedResult
    from stagectl.config.patch import Change


PLACEHOLDER = "STAGE.yaml"  # in a message, where its author does not know the file


class _Plain:
    """Messages on standard error: plain text without rich, until something else needs it."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich would; once it is loaded, it prints, as a bar may be on the screen."""
        objects = tuple(with_stage(part) if isinstance(part, str) else part for part in objects)
        if options or terminal.cache_info().currsize or not all(isinstance(part, str) for part in objects):
            terminal().print(*objects, **options)
        else:
            print(*objects, file=sys.stderr)

    def status(self, words: str) -> Status:
        """Show `words` and a spinner during a computation."""
        return terminal().status(words)


console = _Plain()


def emit(result: dict[str, Any], target: str | None, good: bool = True) -> None:
    """Write `result` as JSON to the file `target`, ``-`` for standard output; exit code 1 where it is not `good`.

    Raises StageError where the operator ended it, which has an exit code of its own.
    """
    if target == "-":
        tell(json.dumps(result, indent=2, allow_nan=False))
    elif target is not None:
        write_json(Path(target), result)
    if words := result.get("interrupted"):
        raise StageError(Problem(words, ProblemKind.STOPPED))
    if not good:
        raise typer.Exit(1)


def page_path(report: Path | None, name: str) -> Path | None:
    """Where the page goes: `report`, else a new one in ``recordings/``; None, and a message, where none can be drawn.

    Raises MissingExtraError where the user asks for the page `report`.
    """
    from stagectl.workflows.motion import unused

    try:
        require("report", "the page")
    except MissingExtraError as error:
        if report is not None:
            raise
        console.print(f"no page: {error}")
        return None
    return report or unused(name, ".html")


def typed() -> str:
    """The command that runs, as it was typed: a report says how to do it again."""
    return shlex.join(["stagectl", *sys.argv[1:]])


def typed_files() -> list[Path]:
    """The configuration files that the command names: a report holds their text."""
    paths = [Path(word) for word in sys.argv[1:] if word.endswith((".yaml", ".yml"))]
    return list(dict.fromkeys(path for path in paths if path.is_file()))


def with_stage(words: str) -> str:
    """`words` that can be typed: with the stage file of this command where they say ``STAGE.yaml``."""
    if PLACEHOLDER not in words:
        return words
    stage = next((path for path in typed_files() if is_stage(path)), None)
    return words if stage is None else words.replace(PLACEHOLDER, shlex.quote(str(stage)))


def is_stage(path: Path) -> bool:
    """Whether a file has the first block of a stage file, or of one of several axes."""
    if path.suffix not in (".yaml", ".yml"):
        return False
    return re.search(r"^ax(is|es)\s*:", path.read_text(encoding="utf-8", errors="replace"), re.MULTILINE) is not None


def write_page(result: ReportedResult, path: Path) -> Path:
    """Write the page of a result, with the configuration files that the command names."""
    from stagectl.report.page import write

    console.print(f"report: {write(result.page(typed()), path, typed_files())}")
    return path


def deliver(result: ReportedResult, page: Path | None, json: str | None) -> None:
    """Print a result; write its page and its JSON where they are wanted."""
    console.print(str(result))
    if page is not None:
        write_page(result, page)
    emit(result.to_json(), json)


def patch(stage: Path, target: Path | None, write: Callable[[Path], Sequence[Change]]) -> None:
    """Let `write` make the stage file `target`, a copy of `stage` if it is another one, and print the changes."""
    if target is None:
        return
    copied = "" if target.exists() else f", a copy of {stage} with"
    changes = write(target)
    console.print(f"wrote {target}{copied}" + ("" if changes else ": nothing has changed"))
    for change in changes:
        console.print(f"  {change}")


def check_patch(stage: Path, target: Path | None) -> None:
    """Refuse a `target` that `patch` could not write, before the work that ends with it."""
    from stagectl.config.patch import check_target

    if target is not None:
        check_target(stage, target)


def tell(line: str) -> None:
    """Print one line if anybody still reads; a drive continues anyway.  Raises OSError where it cannot be written."""
    try:
        with naming(Path("standard output")):
            print(line, flush=True)
    except OSError as error:  # this line and later ones go nowhere
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            raise


def stream(target: str | None) -> Callable[[dict[str, Any]], None]:
    """What writes one line of JSON for each event of a verb that goes on: to the file `target`, ``-`` for output."""
    mark = {} if target == "-" else dict(WRITTEN_BY)  # of a file's first line
    if target is not None and target != "-":
        write_text(Path(target), "")

    def write(event: dict[str, Any]) -> None:
        line = json.dumps({**mark, **event}, allow_nan=False)
        mark.clear()
        if target == "-":
            tell(line)
        elif target is not None:
            with naming(Path(target)), Path(target).open("a", encoding="utf-8") as file:
                file.write(f"{line}\n")

    return write


def reporter(target: str | None, show: Callable[[str], object]) -> Callable[..., None]:
    """What tells a message of a verb that goes on: by `show`, and with further facts as an event of `stream`."""
    write = stream(target)

    def report(words: str, **facts: Any) -> None:
        show(words)
        write({"time": time.strftime("%Y-%m-%dT%H:%M:%S%z"), "words": words, **facts})

    return report


def summary(result: dict[str, Any]) -> str:
    """The run in plain words."""
    lines = [f"{result['stage']}, {result['trajectory']}: {_achieved(result)}"]
    if result["current_at_rest"] is not None:
        lines.append(f"current at rest: {result['current_at_rest']:.2g} A peak to peak")
    if result["fault"] and result["simulated"]:
        lines.append(result["fault"])
    if result["late_cycles"]:
        late = f"{result['late_cycles']} of {result['cycles']} cycles were late"
        lines.append(f"{late}: `stagectl doctor {PLACEHOLDER}` says what this computer lacks")
    if limited := result["effects_limited_cycles"]:
        lines.append(f"the current against the model's effects was limited to its share in {limited} cycles")
    if result["saturated_cycles"]:
        lines.append(f"the current limit was reached in {result['saturated_cycles']} cycles")
    if not result["in_position"] and not result.get("lost_rows"):  # with its last rows lost, nobody knows
        lines.append("the axis did not settle in position")
    return "\n".join(lines)


def _achieved(result: dict[str, Any]) -> str:
    """How the axis moved."""
    from stagectl.evaluation import after_start
    from stagectl.recording.in_memory import lacking

    lost = result.get("lost_rows", 0)
    if lost and result["tracking_error"]["peak"] is None:
        return f"nobody knows how it went, as {lacking(lost, result['cycles'] - lost)}"
    if result["open_loop"]:
        low, high = (length(end, result["unit"]) for end in result["travelled"])
        return f"the loop was open; the axis moved from {low} to {high}, peak current {result['peak_current']:.3g} A"
    peak, rms = (length(result["tracking_error"][kind], result["unit"]) for kind in ("peak", "rms"))
    window = f"{result['steady'][0]:.3g} to {result['steady'][1]:.3g} s (nd = {result['nd']})"
    return "; ".join(filter(None, (f"tracking error peak {peak}, rms {rms} over {window}", after_start(result))))


def without_compiler() -> None:
    """Interpreted kernels: nothing is simulated here, so no compiler need be in memory."""
    os.environ["STAGECTL_KERNELS"] = "interpreted"


def single_threaded_algebra() -> None:
    """One thread for each product of matrices: our own threads use all cores, and narrow matrices gain nothing."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
