"""`commission` on machines that nobody has seen, without questions: what each of them hid, and what became of it.

python tools/bench/closing.py commission --seeds 103-106
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.api.commission import Commissioning, commission
from stagectl.config.stage_file import load_stage
from stagectl.number_format import length
from stagectl.units import StageError
from stagectl.workflows.machine_of_the_day import drawn

CONFIG = Path(__file__).parents[2] / "config"


class Outcome(NamedTuple):
    """One machine."""

    seed: int
    hidden: str  # law and effects
    named: str
    peaks: tuple[float, ...]  # m | rad, with feedback alone and at the end; empty where it was stopped
    unit: str
    seconds: float  # of machine time
    ended: str

    @property
    def factor(self) -> float:
        """By which the peak error shrank."""
        return self.peaks[0] / self.peaks[1]

    def line(self) -> str:
        """For the terminal."""
        gained = " -> ".join(length(peak, self.unit) for peak in self.peaks) or "no figure"
        factor = f" ({self.factor:.3g}x)" if self.peaks else ""
        return (
            f"{self.seed}: {gained}{factor}, {self.seconds:.0f} s\n"
            f"    hidden: {self.hidden}\n    named: {self.named}\n    {self.ended}"
        )


def commissioned(stage: Path, seed: int, folder: Path) -> Outcome:
    """Commission the machine of the day of this `seed`, simulated, in `folder`."""
    (folder / "drives").symlink_to(CONFIG / "drives")
    path = folder / stage.name
    shutil.copy2(stage, path)
    setup = load_stage(path)
    hidden = drawn(setup, seed)[1]
    going = Commissioning(
        path=path, simulated=True, person="bench", seed=1, machine=seed, channel=None, progress=False,
        say=lambda _: None, go_ahead=lambda *_: True,
    )  # fmt: skip
    try:
        done: dict[str, Any] = commission(going)["steps"]
        peaks, ended = tuple(done["compare"]["facts"]["peaks"].values()), done["close"]["words"]
    except StageError as error:
        peaks, ended = (), f"stopped: {error}"
    close = going.done.get("close", {}).get("facts", {})
    words = (", ".join([hidden.law, *hidden.effects]), ", ".join(close.get("effects", {})) or "nothing")
    return Outcome(seed, *words, peaks, setup.file.axis.travel_unit, going.machine_time(), ended)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["commission"])
    parser.add_argument("--seeds", default="103-106", help="first and last, as 103-106")
    parser.add_argument("--stage", type=Path, default=CONFIG / "ball-screw.yaml")
    chosen = parser.parse_args()
    first, last = (int(seed) for seed in chosen.seeds.split("-"))
    outcomes = []
    for seed in range(first, last + 1):
        with tempfile.TemporaryDirectory() as folder:
            outcomes.append(commissioned(chosen.stage, seed, Path(folder)))
        print(outcomes[-1].line(), flush=True)
    factors = [one.factor for one in outcomes if one.peaks]
    if factors:
        slow = sum(one.seconds > 600.0 for one in outcomes)
        print(f"{len(factors)} of {len(outcomes)} at the end, median {statistics.median(factors):.3g}x, {slow} > 600 s")


if __name__ == "__main__":
    main()
