"""The ground of an exam from a record: the inertia, friction and noise of the axis that it shows.

The exam's machine is a ball screw with a lead of 12 mm.  A record of another axis is brought to its scale: the same
travel gives the same force for each kilogram.  Then all ratios that decide how an effect shows stay as they are.
"""

import math
from pathlib import Path

import numpy as np

import stagectl as sc
from stagectl.api.record import MotionRecord
from stagectl.identification.capture import Capture
from stagectl_studies.exam.plan import ExamError
from stagectl_studies.machine.machine import MAXWELL, Body, Drive, Law, Motor
from stagectl_studies.machine.stages import Ground

TRAVEL = 12e-3 / (2.0 * math.pi)  # m of the exam's travel for each rad
DIFFERENCES = 3  # of the current, which leave of a smooth one nothing but its noise
_GAIN = math.sqrt(math.comb(2 * DIFFERENCES, DIFFERENCES))  # of white noise in these differences


def ground_of(path: Path, stage: Path) -> Ground:
    """What the record at `path` of this stage shows.

    Raises ExamError where it shows no friction, IdentificationError where it does not show the stage.
    """
    designed = sc.load_stage(stage)
    record = sc.load_log(path, stage=designed)
    if not isinstance(record, MotionRecord):
        raise ExamError(f"--on {path}: a folder of records; name one record in it")
    fit = sc.identify(designed, record)
    found = fit.apply(doubtful=True).setup.stage
    weight, slip = (
        np.asarray(values, float) for values in (found.friction.operators.weight, found.friction.operators.slip)
    )
    carried = weight > 0.0
    if not carried.any():
        raise ExamError(f"--on {path}: it shows no rolling friction; take a motion with reversals")
    axis = designed.setup.file.axis
    stretch = axis.travel_per_unit / TRAVEL if axis.travel_unit == "m" else 1.0  # rad of the exam for each axis unit
    effort = Body().inertia / found.mechanics.inertia * stretch
    body = Body(Body().inertia, found.mechanics.viscous * effort / stretch, float(weight.sum()) * effort, 0.0)
    weight, slip = weight[carried], slip[carried] * stretch
    order = np.argsort(slip)
    law = Law(MAXWELL, weight[order] / weight.sum(), 1.0 / slip[order])
    noise = _noise(fit.captures[0]) * found.motor.force_constant * effort / Motor().force_constant
    return Ground(body, law, found.encoder.step * stretch, noise)


def _noise(capture: Capture) -> float:
    """White noise (A rms) of the current that was measured; the exam's own where none was."""
    if capture.current_column != "measured_current":
        return Drive().sensor_noise
    return float(np.std(np.diff(capture.current, DIFFERENCES))) / _GAIN
