"""``python -m stagectl_studies.foreign``: how many times lower the peak error is, by friction law and compensator."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stagectl.number_format import length
from stagectl_studies.foreign.friction_laws import LAWS
from stagectl_studies.foreign.trial import BARE, FORMS, LEARNED, METHOD, MOTIONS, Tracked, trial

SHOWN = (*FORMS, LEARNED)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run all trials and print a table for each motion."""
    parser = argparse.ArgumentParser(prog="python -m stagectl_studies.foreign", description=__doc__)
    parser.add_argument("--machines", type=int, default=3, help="of each law, drawn by the seeds 1, 2, ...")
    parser.add_argument("--laws", nargs="+", choices=tuple(LAWS), default=tuple(LAWS))
    parser.add_argument("--method", default=METHOD, choices=("simultaneous", "friction-models"))
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all peaks there")
    given = parser.parse_args(arguments)
    trials = []
    for law in given.laws:
        for seed in range(1, given.machines + 1):
            trials.append(trial(law, seed, given.method))
            print(f"{law}, machine {seed}{': refused: ' if trials[-1].refused else ''}{trials[-1].refused}", flush=True)
    print("\n".join(["", "Simulated on the exam's machine, 0.045 A rms of noise on the motor current, 2^20 counts:"]))
    for motion in MOTIONS:
        print("\n".join(["", f"{motion}: true peak error without compensation, and how many times lower it is", ""]))
        print("\n".join(rows(trials, motion)))
    print("\n".join(["", *worse(trials)]))
    if given.json:
        text = json.dumps([row._asdict() for row in trials], indent=1)
        given.json.write_text(text + "\n", encoding="utf-8")


def rows(trials: Sequence[Tracked], motion: str) -> list[str]:
    """A Markdown table of one motion: the median over the machines of each law, and the worst of them."""
    lines = [f"| friction | {BARE} | {' | '.join(SHOWN)} |", "|---" * (2 + len(SHOWN)) + "|"]
    for law in dict.fromkeys(row.law for row in trials):
        peaks = [row.steady[motion] for row in trials if row.law == law and not row.refused]
        if not peaks:
            lines.append(f"| {law} |" + " refused |" * (1 + len(SHOWN)))
            continue
        cells = [length(float(np.median([peak[BARE] for peak in peaks])), "m")]
        for form in SHOWN:
            times = [peak[BARE] / peak[form] for peak in peaks]
            cells.append(f"{_factor(float(np.median(times)))} ({_factor(min(times))})")
        lines.append(f"| {law} | {' | '.join(cells)} |")
    return lines


def _factor(times: float) -> str:
    return f"{times:.0f}" if times >= 9.5 else f"{times:.2g}"


def worse(trials: Sequence[Tracked]) -> list[str]:
    """Runs, from the first row to the last, whose peak a compensator has made larger."""
    lines = [
        f"worse than without: {row.law}, machine {row.seed}, {motion}, {form}: {length(peaks[form], 'm')} instead of "
        f"{length(peaks[BARE], 'm')}"
        for row in trials
        for motion, peaks in row.whole.items()
        for form in SHOWN
        if peaks[form] > peaks[BARE]
    ]
    return lines or ["no compensator makes any run worse"]


if __name__ == "__main__":
    main()
