"""Every effect of the exam's machine at its typical size, alone, on the recommended battery: whether it is named.

    python tools/bench/typical.py [--seed N] [--effects NAME,NAME] [--full]

No exam: nothing is sealed, and the diagnosis runs as a user would run it.  Each machine is drawn by the seed, law of
friction and values that are off included.  A line says what the answer names first beside what is true anyway, with
its probability and alternatives; the last line counts, with an interval of 95 %.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from stagectl_studies.exam import intervals, rules, scoring
from stagectl_studies.machine.effects import EFFECTS
from stagectl_studies.machine.stage_trial import stage_trial
from stagectl_studies.machine.trials import Options, draw


def answered(place: Path, full: bool) -> tuple[dict[str, Any], float]:
    """The diagnosis' answer to the captures in `place`, and how long it took (s)."""
    answer = place / "answer.json"
    command = [sys.executable, "-m", "stagectl", "gap", "diagnose", str(place / "captures"), "--json", str(answer)]
    begin = time.perf_counter()
    done = subprocess.run([*command, "--full"] if full else command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stderr)
    return json.loads(answer.read_text(encoding="utf-8")), time.perf_counter() - begin


def line(name: str, told: dict[str, Any], answer: dict[str, Any], seconds: float) -> tuple[str, bool, bool]:
    """A row of the table; whether the effect is named first, and whether its set holds it."""
    truth = rules.truth_of(told)
    named = [one for one in rules.entries(answer) if one.probability >= rules.NAMED]
    left = rules.considered(truth, named)
    naming = scoring.naming(truth, answer, named, left)
    first, held = naming["top1"], naming["covered"]
    said = f"{left[0].name} ({left[0].probability:.2f})" if left else rules.top(answer, left)
    others = ", ".join(left[0].alternatives) if left else ""
    size = next(one["realised_scale"] for one in told["effects"] if not one["companion"])
    verdict = "first" if first else "in its set" if held else "**missed**"
    return f"| {name} | {size:g} | {told['law']} | {verdict} | {said} | {others} | {seconds:.0f} |", first, held


def main() -> None:
    """The table, line by line as it comes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--effects", default=",".join(sorted(EFFECTS)))
    parser.add_argument("--full", action="store_true")
    given = parser.parse_args()
    print("| effect | size | law | told | first answer | or | s |\n|---|---|---|---|---|---|---|")
    found = []
    for name in given.effects.split(","):
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            stage_trial(draw(given.seed, "single", Options(effects=(name,), scale=1.0)), place)
            told = json.loads((place / "sealed" / "truth.json").read_text(encoding="utf-8"))
            row, first, held = line(name, told, *answered(place, given.full))
        print(row, flush=True)
        found.append((first, held))
    for words, hits in (("first", sum(one for one, _ in found)), ("in its set", sum(one for _, one in found))):
        low, high = intervals.wilson(hits, len(found))
        print(f"\n{words}: {hits} of {len(found)} ({100 * low:.0f} to {100 * high:.0f} %)")


if __name__ == "__main__":
    main()
