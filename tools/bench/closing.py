"""The gap closed on machines that hide something: `commission` without questions, and one noisy record of each effect.

python tools/bench/closing.py commission --seeds 103-106
python tools/bench/closing.py noisy-record --effects stribeck,cogging

The second gives the model of `gap diagnose` to the controller, and counts its peak error on a machine without noise:
what is left is the model's error, and not the noise's.
"""

import argparse
import math
import shutil
import statistics
import tempfile
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stagectl.api.arguments import reported
from stagectl.api.commission import Commissioning, commission
from stagectl.api.diagnosis import diagnose
from stagectl.config.stage_file import Setup, load_stage
from stagectl.gap.effects.effect import Definition
from stagectl.gap.effects.library import answered, definitions
from stagectl.gap.experiment_design.battery import battery, held_out
from stagectl.gap.experiment_design.unseen import unseen
from stagectl.number_format import length
from stagectl.plan import plan
from stagectl.simulation import simulate
from stagectl.units import StageError
from stagectl.workflows import campaign
from stagectl.workflows.closing_errors import GROWN
from stagectl.workflows.machine_of_the_day import drawn, scales_of
from stagectl.workflows.trials import Machine, Shown

NOISE = 0.045  # A, of the current; from the issue
SEEN = 5.0  # floors of the gap from which an effect can be found; from the issue
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


class Compensated(NamedTuple):
    """One effect, and the model of a noisy record of it."""

    effect: str
    named: str
    floors: float  # gap of the held-out runs over its floor
    before: tuple[float, ...]  # m | rad, peak on each unseen motion with the plain model
    after: tuple[float, ...]
    unit: str

    @property
    def factor(self) -> float:
        """By which the peaks shrank, each motion alike."""
        return math.prod(b / a for b, a in zip(self.before, self.after, strict=True)) ** (1.0 / len(self.before))

    @property
    def growth(self) -> float:
        """By which the worst of them grew."""
        return max(a / b for b, a in zip(self.before, self.after, strict=True))

    def line(self) -> str:
        """For the terminal."""
        pairs = zip(self.before, self.after, strict=True)
        peaks = ", ".join(f"{length(b, self.unit)} -> {length(a, self.unit)}" for b, a in pairs)
        return f"{self.effect}: {self.factor:.3g}x ({peaks}), {self.floors:.3g} floors; named: {self.named}"


def compensated(setup: Setup, effect: Definition, folder: Path) -> Compensated:
    """Record, diagnose and apply on a machine that has this effect at its typical size."""
    values = {amplitude.name: amplitude.typical[0] for amplitude in effect.amplitudes}
    values |= {shape.name: shape.grid[len(shape.grid) // 2] if shape.grid else 4.0 for shape in effect.shapes}
    true = setup._replace(stage=effect.apply(setup.stage, values))
    machine = Machine(setup, True, true.having(simulation=setup.file.simulation._replace(current_noise=NOISE)))
    runs = campaign.chosen((*battery(setup), *held_out(setup)), [], [])
    campaign.record(campaign.planned(machine, runs, 2, folder, 1), Shown(lambda _: None, partial(reported, False)))
    found = diagnose(folder, advice=False)
    known = found.apply(setup.path).setup if found.named else setup
    before, after = (tuple(peaks(model, true)) for model in (setup, known))
    names, gap = ", ".join(one.name for one in found.named), found.gap
    return Compensated(effect.name, names, gap.before / gap.floor, before, after, setup.file.axis.travel_unit)


def peaks(known: Setup, machine: Setup) -> Iterator[float]:
    """Largest error (m | rad) of the controller of one model on another, on each unseen motion."""
    for motion in unseen(machine):
        rows = plan(known, motion.trajectory, known.controller.feedforward)
        error = simulate(known, rows, known.controller.law, machine)["error"]
        yield float(np.abs(error).max()) * known.file.axis.travel_per_unit


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["commission", "noisy-record"])
    parser.add_argument("--seeds", default="103-106", help="first and last, as 103-106")
    parser.add_argument("--effects", default="", help="names, as stribeck,cogging; all without it")
    parser.add_argument("--stage", type=Path, default=CONFIG / "ball-screw.yaml")
    chosen = parser.parse_args()
    if chosen.what == "commission":
        commission_all(chosen.stage, *map(int, chosen.seeds.split("-")))
    else:
        compensate_all(load_stage(chosen.stage), chosen.effects.split(",") if chosen.effects else answered())


def commission_all(stage: Path, first: int, last: int) -> None:
    """All machines of the day of these seeds."""
    outcomes = []
    for seed in range(first, last + 1):
        with tempfile.TemporaryDirectory() as folder:
            outcomes.append(commissioned(stage, seed, Path(folder)))
        print(outcomes[-1].line(), flush=True)
    factors = [one.factor for one in outcomes if one.peaks]
    if factors:
        slow = sum(one.seconds > 600.0 for one in outcomes)
        print(f"{len(factors)} of {len(outcomes)} at the end, median {statistics.median(factors):.3g}x, {slow} > 600 s")


def compensate_all(setup: Setup, names: Sequence[str]) -> None:
    """All effects of these names that a current answers and that have a typical size."""
    outcomes = []
    for effect in definitions(scales_of(setup)):
        if effect.name in names:
            with tempfile.TemporaryDirectory() as folder:
                outcomes.append(compensated(setup, effect, Path(folder)))
            print(outcomes[-1].line(), flush=True)
    factors = [one.factor for one in outcomes if one.floors > SEEN]
    if factors:
        least, median = min(factors), statistics.median(factors)
        print(f"{len(factors)} of {len(outcomes)} above {SEEN:g} floors: median {median:.3g}x, least {least:.3g}x")
    worse = ", ".join(one.effect for one in outcomes if one.growth > GROWN)
    print(f"worse by more than a tenth on a motion: {worse or 'none'}")


if __name__ == "__main__":
    main()
