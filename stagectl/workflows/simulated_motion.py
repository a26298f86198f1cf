"""A motion on the model: simulated and recorded as `run` records a real one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.drives.drive import Fault
from stagectl.evaluation import evaluate
from stagectl.realtime.safety import words
from stagectl.recording.hdf5 import Recording, save
from stagectl.service.single_motion import Motion
from stagectl.units import StageError

if TYPE_CHECKING:
    from stagectl.simulation import FrictionLaw

MOST_GIVEN = 0.9  # of the work that a friction takes; chosen: what is elastic in one gives back less in a whole motion
# (motion, s on the session's clock) -> rows (n,) as in a recording, of a machine that no stage file describes.
Elsewhere = Callable[[Motion, float], NDArray[Any]]


def pretend(
    motion: Motion, plant: Setup | None = None, start: float = 0.0, elsewhere: Elsewhere | None = None
) -> dict[str, Any]:
    """Simulate and record the motion, see `simulated`, or have it done `elsewhere`; the result as JSON values."""
    if elsewhere is None:
        recording = simulated(motion, plant, start)
    else:
        meta = {**motion.meta, "drive": {"drive": "simulated elsewhere", "plant": ""}}
        recording = Recording(motion.recording, meta, elsewhere(motion, start), True, "complete", 0)
    recording.path.parent.mkdir(parents=True, exist_ok=True)
    save(recording.path, recording.meta, recording.samples, recording.ended)
    return simulated_result(motion, recording)


def simulated(
    motion: Motion, plant: Setup | None = None, start: float = 0.0, friction: FrictionLaw | None = None
) -> Recording:
    """The recording of the motion on the stage's model, or on another `plant`; it is not written to its path.

    It starts at `start` (s) on the session's clock.  `friction` takes the place of the plant's friction.
    Raises StageError where the plant is an axis of another kind.
    """
    from stagectl.simulation import simulate, simulate_with_friction  # compiles

    if plant is not None:
        _check_plant(motion.setup, plant)
    about: dict[str, Any] = {"drive": "simulated, compiled", "plant": str((plant or motion.setup).path)}
    if friction is None:
        samples = simulate(motion.setup, motion.plan, motion.law, plant, start)
    else:
        samples, work = simulate_with_friction(motion.setup, motion.plan, motion.law, friction, plant)
        about |= {"drive": "simulated, with a friction law of the user", "friction_work": vars(work)}
    meta = {**motion.meta, "drive": about}
    return Recording(motion.recording, meta, samples, True, "complete", 0)


def simulated_result(motion: Motion, recording: Recording) -> dict[str, Any]:
    """What a simulated motion achieved, as JSON values."""
    achieved = evaluate(recording.samples, recording.meta)
    stopped = envelope(motion.setup, recording.samples)
    return {**achieved, **stopped, "recording": str(recording.path), "simulated": True}


def gave(recording: Recording) -> list[str]:
    """A note on a friction law of the user that moves the axis instead of braking it."""
    work = recording.meta["drive"].get("friction_work")
    if work is None or work["given"] <= MOST_GIVEN * work["taken"]:
        return []
    given, taken = (f"{work[name]:.3g} J" for name in ("given", "taken"))
    remedy = "it must act against the motion, and change little within an integration step"
    return [f"the friction function gave the axis {given} and took {taken}, as no friction does: {remedy}"]


def _check_plant(setup: Setup, plant: Setup) -> None:
    """The law and its plant must share what the rows of a run are in."""
    for name, ours, its in (
        ("axis.kind", setup.file.axis.kind, plant.file.axis.kind),
        ("axis.lead", setup.file.axis.lead, plant.file.axis.lead),
        ("encoder.step", setup.stage.encoder.step, plant.stage.encoder.step),
    ):
        if ours != its:
            raise StageError(
                f"{name} = {its} in {plant.path}; must be {ours}, as in {setup.path}: one axis, two models"
            )


def envelope(setup: Setup, samples: NDArray[Any]) -> dict[str, Any]:
    """Where `run` would stop this simulated motion: nothing stops a model."""
    limits = setup.file.limits
    error = np.abs(samples["error"]) > limits.following_error
    outside = (samples["measured"] < limits.travel[0]) | (samples["measured"] > limits.travel[1])
    reasons = ((error, Fault.FOLLOWING_ERROR), (outside, Fault.TRAVEL))
    first = min(((int(np.argmax(rows)), fault) for rows, fault in reasons if rows.any()), default=None)
    if first is None:
        return {"fault": ""}
    at = float(samples["time"][first[0]])
    fault = f"{words(first[1])} at {at:.6g} s: `run` would stop there"
    if outside.any() and first[1] is not Fault.TRAVEL:
        left = int(np.argmax(outside))
        farthest = setup.file.axis.travel.length(float(np.abs(samples["measured"]).max()))
        fault += f"; without a stop it left limits.travel at {samples['time'][left]:.6g} s, and got {farthest} away"
    return {"fault": fault, "in_position": False}
