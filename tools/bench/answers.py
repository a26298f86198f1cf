"""What the controller makes of each effect that its model knows: peak error of the 5 mm sine, simulated.

Usage: python tools/bench/answers.py [STAGE.yaml]

Per effect of the library, at typical and at four times typical size: the error of the axis (reference less true
position, from the first reversal on) of a controller that does not know the effect, and of one that does.
"""

import sys
from pathlib import Path

import numpy as np

from stagectl.config.stage_file import Setup, load_stage
from stagectl.gap.effects.effect import Definition
from stagectl.gap.effects.library import EFFECTS, definitions
from stagectl.kernels.stage import Stage
from stagectl.plan import plan
from stagectl.simulation import simulate
from stagectl.trajectories.periodic import Sine
from stagectl.workflows.machine_of_the_day import scales_of

MOTION = Sine(5e-3, 1.6, 2.0, 1.0)
SKIPPED = 0.7  # s until the first reversal has passed


def having(p: Stage, effect: Definition, times: float) -> Stage:
    """The stage with an effect of so many times its typical size."""
    values = {amplitude.name: times * amplitude.typical[0] for amplitude in effect.amplitudes}
    values |= {shape.name: shape.grid[len(shape.grid) // 2] if shape.grid else 4.0 for shape in effect.shapes}
    return effect.apply(p, values)


def peak(known: Setup, machine: Setup) -> float:
    """Half the range of the true error (nm) of the controller of one model on another."""
    laid_out = plan(known, MOTION, known.controller.feedforward)
    rows = simulate(known, laid_out, known.controller.law, machine)
    error = (rows["reference"] - rows["true_position"])[rows["time"] > SKIPPED]
    return 0.5e9 * float(np.ptp(error)) * known.file.axis.travel_per_unit


def main() -> None:
    """Print the table."""
    plain = load_stage(Path(sys.argv[1] if len(sys.argv) > 1 else "config/ball-screw.yaml"))
    print(f"without any effect: {peak(plain, plain):.0f} nm\n")
    print("| effect | answer | not known, 1x | known | not known, 4x | known |\n|---|---|---|---|---|---|")
    for effect in definitions(scales_of(plain)):
        cells = []
        for times in (1.0, 4.0):
            try:
                machine = plain._replace(stage=having(plain.stage, effect, times))
                cells += [f"{peak(plain, machine):.0f} nm", f"{peak(machine, machine):.0f} nm"]
            except Exception as error:  # no machine any more: the reason stands in the table
                cells += [type(error).__name__, ""]
        print(f"| {effect.name} | {EFFECTS[effect.name].answer} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
