"""Which of two loops is the better one on the machine: its rms tracking error on moves with long stops.

The model's friction says at which bandwidth an axis at rest begins to swing (`design.limit_cycle_frequency`).  That
hangs on the stiffness over the first nanometres, which the records of an identification hardly show.  A swing that
matters is seen in the rms error, as the axis stands still for half of the time.
"""

from collections.abc import Mapping
from pathlib import Path

from stagectl.config.stage_file import Setup
from stagectl.gap.experiment_design.experiment import Experiment, Recipe, made, yaml_of
from stagectl.gap.experiment_design.stage_scale import rounded, scale_of
from stagectl.gap.experiment_design.unseen import moves
from stagectl.workflows.layer_comparison import compare
from stagectl.workflows.motion import Commanded, lay_out
from stagectl.workflows.trials import Machine, Shown

_STROKE, _DWELL, _COUNT = 0.08, 0.4, 2  # of the shorter way to an end; s, about as long as a move; there and back


def errors(
    machine: Machine, setups: Mapping[str, Setup], plan: tuple[int, int], shown: Shown, folder: Path
) -> dict[str, float]:
    """Rms tracking error (m | rad) of each of the `setups` by its name; `plan` is (repeats, seed).

    Raises TrialError where a run is stopped.
    """
    motion = trial(machine.setup)
    commanded = Commanded(f"{motion.name}.yaml", yaml_of(motion), motion.trajectory)
    variants = {name: lay_out(setup, commanded, frozenset(), folder / "run.h5") for name, setup in setups.items()}
    outcome = compare(machine, variants, plan, shown, folder)
    return {variant["name"]: variant["rms"]["mean"] for variant in outcome["variants"]}


def trial(setup: Setup) -> Experiment:
    """Moves there and back with stops, made for this stage."""
    words = "Moves with stops: how well a loop follows, and whether it rests."
    recipe = Recipe(words, lambda p: moves(p, rounded(_STROKE * p.reach), _DWELL, _COUNT, False))
    (motion,) = made(scale_of(setup), {"loop-trial": recipe})
    return motion
