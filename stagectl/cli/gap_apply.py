"""The commands that follow a diagnosis: `gap apply` puts named effects into the stage file, `gap next` goes on."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stagectl.cli.options import Json, StageArgument, argument, option
from stagectl.cli.show import console, emit
from stagectl.replacing import write_text
from stagectl.units import ROTARY, StageError

if TYPE_CHECKING:
    from stagectl.gap.result.diagnosis import DiagnosisResult, NextExperiment

ResultArgument = Annotated[Path, argument("FOLDER", "Diagnosed captures, or the JSON file of a diagnosis.")]
_COLOURS = {"+": "green", "-": "red", "@": "cyan", "#": "dim"}


def apply(
    folder: ResultArgument,
    stage: StageArgument,
    output: Annotated[Path | None, option("--output -o NEW.yaml", "Write a copy; STAGE.yaml stays unchanged.")] = None,
    only: Annotated[str | None, option("--only NAME,...", "Only these effects, named or not.")] = None,
    choose: Annotated[
        list[str] | None, option("--choose NAME", "This alternative instead of the effect that it may replace.")
    ] = None,
    unknown: Annotated[bool, option("--unknown", "Also add the unknown part as a table.")] = False,
    yes: Annotated[bool, option("--yes -y", "Write without asking.")] = False,
    json: Json = None,
) -> None:
    """Add the named effects to the stage model, as a patch that is shown first.

    Example: stagectl gap apply captures/ config/ball-screw.yaml -o with-effects.yaml
    """
    from rich.text import Text

    from stagectl.gap.result.patch import applied, patch_of, with_choices
    from stagectl.gap.result.result_json import load

    diagnosis = with_choices(load(folder), choose or ())
    patch = patch_of(diagnosis, stage, [name.strip() for name in only.split(",")] if only else (), unknown)
    for line in patch.diff:
        console.print(Text(line, style=_COLOURS.get(line[:1], "")))
    target = output or stage
    if patch.changes:
        _ask(target, yes)
        saved = applied(patch, output)
        console.print(f"wrote {target}" + (f"; what it was is in {saved}" if saved else f", a copy of {stage}"))
    else:
        console.print(f"{stage} says all of this already: nothing is written")
    written = {"written": str(target) if patch.changes else None, "comments": list(patch.comments)}
    emit({**written, "changes": [change._asdict() for change in patch.changes]}, json)


def _ask(target: Path, yes: bool) -> None:
    """Raise StageError without a terminal, and typer's Exit if the user declines."""
    if yes:
        return
    if not sys.stdin.isatty():
        raise StageError(f"nothing is written into {target}: nobody is there to be asked; --yes writes without asking")
    if not typer.confirm(f"Write this into {target}?", err=True):
        console.print("nothing is written")
        raise typer.Exit(1)


def following(
    folder: ResultArgument,
    output: Annotated[Path | None, option("--output -o FILE.yaml", "Trajectory file; default: in FOLDER.")] = None,
    json: Json = None,
    samples: Annotated[
        Path | None, option("--samples FILE.csv", "The motion row by row, for another controller.")
    ] = None,
    rate: Annotated[float, option("--rate", "Rows per second (Hz) of --samples.", min=10.0, max=100_000.0)] = 2000.0,
) -> None:
    """Write the experiment that resolves an ambiguity, or covers what no run has covered.

    Example: stagectl gap next captures/ -o next.yaml
    """
    from stagectl.gap.result import remarks_text
    from stagectl.gap.result.result_json import load

    diagnosis = load(folder)
    proposal = diagnosis.next_experiment
    nothing = ["no experiment is proposed: none would show more than these data do"]
    for line in remarks_text.advice(diagnosis) if proposal else nothing:
        console.print(line)
    written = _written(proposal, folder, output) if proposal else None
    if samples is not None and written is not None:
        _sampled(diagnosis, written, rate, samples)
    asked = output or samples
    missed = asked is not None and written is None
    if missed:
        console.print(f"{asked} is not written: there is no trajectory to write")
    files = {"next_experiment": proposal._asdict() if proposal else None, "written": str(written) if written else None}
    emit(files, json, not missed)


def _written(proposal: NextExperiment, folder: Path, output: Path | None) -> Path | None:
    """The trajectory file, with the commands that run it; None where it is done by hand.

    Raises StageError where another file stands in its place.
    """
    if not proposal.trajectory:
        return None
    place = folder if folder.is_dir() else folder.parent
    path = output or place / proposal.trajectory
    if path.exists() and path.read_text(encoding="utf-8") != proposal.text:
        raise StageError(f"{path} exists and holds something else: move it away, or name another file with -o")
    write_text(path, proposal.text)
    console.print(f"wrote {path}; to run it, and to diagnose again with it:")
    for line in _commands(proposal, place, path):
        console.print(line, style="bold")
    if not _holds_logs(place):
        console.print(
            "A recording of stagectl is diagnosed without logs of other programs. To diagnose them together, make the "
            "motion with the program that wrote the logs (--samples FILE.csv), and give its log after theirs."
        )
    return path


def _holds_logs(place: Path) -> bool:
    """Whether the folder of the answer is that of the logs, so that a further one may join them."""
    return (place / "captures.yaml").is_file() or any(place.glob("*.h5"))


def _commands(proposal: NextExperiment, place: Path, path: Path) -> list[str]:
    """What follows: into a folder of our recordings goes another one, into one from elsewhere another capture."""
    if (place / "captures.yaml").is_file():
        return [
            f"stagectl run STAGE.yaml {path}, or as your machine does it; add the log to {place / 'captures.yaml'}",
            f"stagectl gap diagnose {place}",
        ]
    folder = place if _holds_logs(place) else place.with_name(f"{place.name}-{proposal.name}")
    recording = folder / f"{proposal.name}-1.h5"
    return [f"stagectl run STAGE.yaml {path} --output {recording}", f"stagectl gap diagnose {folder}"]


def _sampled(diagnosis: DiagnosisResult, trajectory: Path, rate: float, path: Path) -> None:
    """The reference in axis units, from 0 where the axis stands, and the current to be injected."""
    from stagectl.config.lengths import Lengths
    from stagectl.config.trajectory_file import Axis, load_trajectory
    from stagectl.plan import SETTLE
    from stagectl.recording.exports import write_columns
    from stagectl.trajectories.experiments import sampled

    angular = diagnosis.travel_unit == "rad"
    lengths = Lengths(diagnosis.kind, 0.0 if angular else 2.0 * math.pi * diagnosis.travel_per_unit, angular)
    rows = sampled(load_trajectory(trajectory, Axis(lengths, 0.0)), 1.0 / rate, SETTLE)
    unit = "rad" if diagnosis.kind == ROTARY else "m"
    reference = rows.position / diagnosis.travel_per_unit
    write_columns(path, {"time_s": rows.time, f"reference_{unit}": reference, "injection_A": rows.current})
    console.print(f"wrote {path}: {len(rows.time)} rows at {rate:g} Hz, from where the axis stands")
