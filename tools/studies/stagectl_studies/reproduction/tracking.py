"""The ball-screw paper's examination: three sines without and with friction compensation (Figs. 12 to 14).

PID and perfect tracking feedforward are designed from the inertia and the viscous friction that the proposed method
found, in all runs alike, as in the paper; the runs differ in the friction that is compensated.  `conventional` and
`proposed` are the paper's: a table over the displacement since reversal, from the ultra-slow motion and from the
proposed method.  The others are the models that its introduction names, from the proposed method as well.  Each runs on
a machine without current noise and on one with it.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from stagectl.compensation import derived
from stagectl.compensation.rolling import FORMS
from stagectl.config.stage_file import Setup
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.identification.result import IdentificationResult
from stagectl_studies.reproduction.bench import CONFIG, NO_FRICTION, NOISE, Bench, Run, believing, carried_out

MOTIONS = ("sine-3.2hz", "sine-1.6hz", "sine-0.8hz")
CONTROLLERS = ("none", "conventional", "proposed", "stop operators", "gms", "rheology")
FORM = {"stop operators": "model", "gms": "gms", "rheology": "rheology"}  # of the compensator; of all others the table
NOISES = ("without noise", "with noise")
_ALL = frozenset[str]()


class Tracking(NamedTuple):
    """Runs by motion and controller; `noisy` with the drive's current noise on the motor."""

    quiet: dict[tuple[str, str], Run]
    noisy: dict[tuple[str, str], Run]
    motions: tuple[str, ...]


def tracked(
    bench: Bench, tables: dict[str, IdentificationResult], motions: tuple[str, ...], tell: Callable[[int, int], None]
) -> Tracking:
    """All runs; `tables` holds what the conventional and the proposed method found."""
    mechanics = {name: tables["proposed"].parameters[name].value for name in ("inertia", "viscous")}
    quiet, noisy = {}, {}
    for number, motion in enumerate(motions):
        path = load_trajectory(CONFIG / "trajectories" / f"{motion}.yaml", axis_of(bench.machine))
        for controller in CONTROLLERS:
            table = tables.get(controller, tables["proposed"]).table
            assert table is not None
            believed = compensating(believing(bench.believed, **mechanics, table=table), FORM.get(controller, "table"))
            without = NO_FRICTION if controller == "none" else _ALL
            here = bench._replace(believed=believed)
            name = f"{motion}, {controller}"
            quiet[motion, controller] = carried_out(here.noisy(0.0, 0), path, name, without)
            noisy[motion, controller] = carried_out(here.noisy(NOISE, 100 + number), path, name, without)
        tell(number + 1, len(motions))
    return Tracking(quiet, noisy, motions)


def compensating(setup: Setup, form: str) -> Setup:
    """`setup` with a compensator of this form, made from its own friction."""
    if form == "model":
        return setup
    entries = {name: value for name, value in derived.block(form, setup.stage.friction).items() if name != "form"}
    return setup.having(compensation=FORMS[form](**entries))


def errors(run: Run) -> dict[str, float]:
    """Peak and rms (m) of the tracking error over the steady window, as the encoder shows it, and of the model."""
    measured, true = run.error()[run.steady], run.error("true_position")[run.steady]
    return {
        "peak": float(np.max(np.abs(measured))),
        "rms": float(np.sqrt(np.mean(np.square(measured)))),
        "true_peak": float(np.max(np.abs(true))),
        "peak_current": float(np.max(np.abs(run.samples["current"][run.steady]))),
    }


def numbers(tracking: Tracking) -> dict[str, Any]:
    """Errors of all runs (m), and how many times each compensation lowers the peak."""
    rows_by_motion: dict[str, Any] = {}
    for noise, runs in zip(NOISES, (tracking.quiet, tracking.noisy), strict=True):
        for motion in tracking.motions:
            row = {controller: errors(runs[motion, controller]) for controller in CONTROLLERS}
            for controller in CONTROLLERS[1:]:
                row[controller]["times_lower"] = row["none"]["peak"] / row[controller]["peak"]
            rows_by_motion.setdefault(motion, {})[noise] = row
    return rows_by_motion
