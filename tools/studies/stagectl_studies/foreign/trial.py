"""One machine: a motion identified, then each compensator and learning tracked on motions that it has not seen."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from stagectl import learning
from stagectl.api.stage import DesignedStage
from stagectl.compensation import derived
from stagectl.config.friction_laws import friction_of, law_in
from stagectl.config.stage_file import Setup, load_stage
from stagectl.identification import methods
from stagectl.kernels.law import SETPOINT_COLUMNS
from stagectl.kernels.plant import Friction
from stagectl.plan import Plan, plan
from stagectl.trajectories import Experiment, SCurve, Sine
from stagectl.units import StageError
from stagectl_studies.foreign.axis import Axis
from stagectl_studies.foreign.friction_laws import machine
from stagectl_studies.reproduction.bench import CONFIG, NO_FRICTION, Run, captured

IDENTIFIED: Experiment = Sine(0.005, 0.8, periods=6.0)  # 5 mm at 0.8 Hz: an ordinary motion of 10 s
MOTIONS: dict[str, Experiment] = {
    "5 mm, 1.6 Hz": Sine(0.005, 1.6, periods=3.0),
    "5 mm, 3.2 Hz": Sine(0.005, 3.2, periods=3.0),
    "1 mm, 5 Hz": Sine(0.001, 5.0, periods=5.0),
    "20 mm there and back": SCurve(0.020, 0.1, 1.0, 20.0, 0.2, 2, False),
    "8 um, 1.6 Hz": Sine(8e-6, 1.6, periods=4.0),
}
FORMS = ("model", "table", "table, restart", "gms", "rheology")
METHOD = "friction-models"
TRIALS = 10
BARE, BEST, LEARNED = "none", "model", "model, learning"  # learning is on top of the identified law


class Tracked(NamedTuple):
    """Peaks (m) of the true tracking error by motion and compensator: in the steady window, and of the whole run."""

    law: str
    seed: int
    steady: dict[str, dict[str, float]]
    whole: dict[str, dict[str, float]]
    refused: str = ""  # why identification gave nothing


def trial(law: str, seed: int, method: str = METHOD, motions: Mapping[str, Experiment] = MOTIONS) -> Tracked:
    """Identify, compensate, learn and track.  Where identification refuses, there are no peaks, and the reason."""
    axis = Axis(machine(law, seed), seed)
    try:
        stages = compensated(axis, DesignedStage(load_stage(CONFIG / "ball-screw.yaml")), method)
    except StageError as refusal:
        return Tracked(law, seed, {}, {}, str(refusal))
    steady: dict[str, dict[str, float]] = {}
    whole: dict[str, dict[str, float]] = {}
    for number, (name, motion) in enumerate(motions.items()):
        plans = {form: _plan(setup, motion, form) for form, setup in stages.items()}
        plans[LEARNED] = learn(axis, stages[BEST], plans[BEST], 100 * number + 1)
        both = {form: peaks(axis, stages.get(form, stages[BEST]), laid, 100 * number) for form, laid in plans.items()}
        steady[name] = {form: pair[0] for form, pair in both.items()}
        whole[name] = {form: pair[1] for form, pair in both.items()}
    return Tracked(law, seed, steady, whole)


def _plan(setup: Setup, motion: Experiment, form: str) -> Plan:
    without = NO_FRICTION if form == BARE else frozenset[str]()
    return plan(setup, motion, setup.controller.without(without).feedforward)


def compensated(axis: Axis, believed: DesignedStage, method: str) -> dict[str, Setup]:
    """The stage as one motion has identified it, by compensator.

    Raises StageError where the method refuses the motion.
    """
    setup = believed.setup
    laid_out = plan(setup, IDENTIFIED, setup.controller.without(NO_FRICTION).feedforward)
    run = Run("identification", axis.run(setup, laid_out, 0), laid_out, setup, setup.file.axis.travel_per_unit)
    changes = methods.identify(method, captured(run), setup.file, lambda done, total: None, {}).changes
    stage, friction = believed.changed(changes), friction_of(law_in(changes["friction"]))
    stages = {form: stage.changed(_compensation(form, friction)).setup for form in FORMS}
    return {BARE: stage.setup, **stages}


def _compensation(form: str, friction: Friction) -> dict[str, Any]:
    """The change of the stage file that lets this compensator act."""
    name, _, rule = form.partition(", ")
    block = {} if name == "model" else derived.block(name, friction)
    return {"compensation": {**block, **({"inner_loops": rule} if rule else {})}} if block else {}


def peaks(axis: Axis, setup: Setup, laid_out: Plan, number: int) -> tuple[float, float]:
    """Peak (m) of the true tracking error in the steady window, and of the whole run."""
    samples = axis.run(setup, laid_out, number)
    error = np.abs(samples["reference"] - samples["true_position"]) * setup.file.axis.travel_per_unit
    inside = (samples["time"] >= laid_out.steady[0]) & (samples["time"] < laid_out.steady[1])
    return float(error[inside].max()), float(error.max())


def learn(axis: Axis, setup: Setup, base: Plan, number: int) -> Plan:
    """The plan with the current that `TRIALS` trials have learned."""
    count, settings, law = len(base.setpoints), setup.file.learning, setup.controller.law
    filters = learning.filters(setup.stage, law, settings, setup.dt, count)
    course = learning.initial_state(count)
    for j in range(TRIALS):
        samples = axis.run(setup, with_current(base, course.learned), number + j)
        course = learning.after_trial(filters, settings, course, samples["error"])
    return with_current(base, course.best)


def with_current(base: Plan, current: Any) -> Plan:
    """`base` with this learned `current` (n,) A."""
    rows = base.setpoints.copy()
    rows[:, SETPOINT_COLUMNS["learned"]] = current
    return base._replace(setpoints=rows)
