"""A trial staged into a folder, its truth sealed elsewhere.

    python -m stagectl_studies.machine.stage_trial --seed 3 --stratum single --effect dwell --scale 1 -o DIR [--short]
writes DIR/captures (what the user has) and DIR/sealed (truth.json, truth.npz).
"""

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

from stagectl_studies.machine.effects import ALIENS, EFFECTS
from stagectl_studies.machine.folder import write_folder
from stagectl_studies.machine.stages import LAWS
from stagectl_studies.machine.trials import STRATA, Options, Trial, draw, noisy
from stagectl_studies.machine.truth import write_truth


def stage_trial(trial: Trial, directory: Path) -> None:
    """Write the user's folder `captures` and the sealed truth beside it."""
    traces = [noisy(trial, number) for number in range(len(trial.captures))]
    lost = [capture.file for capture, trace in zip(trial.captures, traces, strict=True) if trace.lost]
    if lost:
        raise RuntimeError(f"seed {trial.seed}, {trial.stratum}: the axis was lost in {', '.join(lost)}")
    write_folder(trial, traces, directory / "captures")
    write_truth(trial, directory / "sealed")


def main(arguments: Sequence[str] | None = None) -> None:
    """Make one folder from the command line."""
    parser = argparse.ArgumentParser(prog="python -m stagectl_studies.machine.stage_trial", description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--stratum", choices=STRATA, required=True)
    parser.add_argument("--effect", choices=sorted([*EFFECTS, *ALIENS]), action="append", default=[])
    parser.add_argument("--scale", type=float)
    parser.add_argument("--offsets", action=argparse.BooleanOptionalAction)
    parser.add_argument("--law", choices=LAWS)
    parser.add_argument("--short", action="store_true")
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args(arguments)
    options = Options(tuple(given.effect), given.scale, given.offsets, given.law, given.short)
    began = time.monotonic()
    trial = draw(given.seed, given.stratum, options)
    stage_trial(trial, given.output)
    hidden = ", ".join(f"{effect.name} x{effect.realised:g}" for effect in trial.hidden) or "nothing hidden"
    seconds = time.monotonic() - began
    print(f"{given.output}: {len(trial.captures)} captures, law {trial.law}, {hidden}; {seconds:.1f} s")


if __name__ == "__main__":
    main()
