"""The gap: sub-steps a second of the tied model, with nothing and with every kind of effect in it, and one diagnosis.

The diagnosis is of a machine of the exam on the recommended battery (about 75 s of motion, three repeats), with one
hidden effect; its seconds are from the loaded session to the answer, compiled.
"""

import resource
import time
from pathlib import Path

import numpy as np
from measure import Row, Wanted, spread
from scene import STAGE
from stagectl_studies.machine.stage_trial import stage_trial
from stagectl_studies.machine.trials import Options as Drawn
from stagectl_studies.machine.trials import draw

from stagectl.config.stage_file import load_stage
from stagectl.gap import diagnose
from stagectl.gap.effects.stage_changes import put
from stagectl.gap.logs import load_session
from stagectl.gap.residuals import model_tracking, thresholds
from stagectl.kernels import tracked_model

PERIODS = 40_000  # 20 s at 2 kHz


def rows(place: Path, rounds: int) -> list[Row]:
    """Sub-steps a second, seconds of a diagnosis, and the memory that the process came to."""
    plain = [1.0 / _seconds(False) for _ in range(rounds)]
    bent = [1.0 / _seconds(True) for _ in range(rounds)]
    steps = PERIODS * thresholds.SUBSTEPS
    stage_trial(draw(1, "single", Drawn(effects=("viscous_asymmetry",), scale=1.0)), place)
    session = load_session.load([place / "captures"])
    begin = time.perf_counter()
    found = diagnose.diagnose(session, diagnose.Options(), lambda _: None).result
    taken = time.perf_counter() - begin
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    along = "kernels.tied along 20 s of a sine, 4 sub-steps a period"
    whole = "exam machine, recommended battery, 3 repeats: session to answer, " + found.verdict
    return [
        Row("tied model, plain", spread([1e-6 * steps * x for x in plain]), "Msubsteps/s", None, along),
        Row("tied model, four effects", spread([1e-6 * steps * x for x in bent]), "Msubsteps/s", None, along),
        Row("diagnosis, fast path", spread([taken]), "s", Wanted(15.0, at_least=False), whole),
        Row("memory of it", spread([memory]), "GiB", Wanted(2.0, at_least=False), "peak of the process"),
    ]


def _seconds(effects: bool) -> float:
    setup = load_stage(STAGE)
    p = setup.stage
    if effects:
        p = put(put(p, "mechanics.viscous_asymmetry", 0.1), "friction.lead.amplitude", 0.03)
        p = put(put(p, "motor.cogging.amplitude", 0.02), "mechanics.base.ratio", 0.05)
    t = setup.dt * np.arange(PERIODS)
    rows_ = np.column_stack([3.0 * np.sin(10.0 * t), np.sin(10.0 * t), np.full(PERIODS, np.nan)])
    path, model = (
        model_tracking.MeasuredPath(rows_, 0.0, setup.dt),
        tracked_model.Tied(p, model_tracking.tracker(setup.stage, setup.dt)),
    )
    begin = time.perf_counter()
    model_tracking.tracking_residual(model, path)
    return time.perf_counter() - begin
