"""Ball-screw paper, all experiments: what was recorded and what the methods found in it.

The virtual machine is the stage file's.  Its operator believes a data sheet that is wrong by a fifth and more; the
controllers of the tracking runs are designed from what the methods identified.  Only recordings reach a method.
"""

from typing import Any, NamedTuple

from stagectl.config.stage_file import Setup, load_stage
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.identification import constant_speed, low_speed
from stagectl.identification.capture import Capture
from stagectl.identification.response import method as frequency_response
from stagectl.identification.response.sampling_correction import known_delay
from stagectl.identification.result import IdentificationResult
from stagectl.identification.simultaneous import method as simultaneous
from stagectl.trajectories import CurrentSweep, Experiment
from stagectl_studies.reproduction.bench import CONFIG, NOISE, Bench, Run, captured, carried_out, guessed
from stagectl_studies.reproduction.progress import Course
from stagectl_studies.reproduction.step_response import StepResponse, steps
from stagectl_studies.reproduction.stribeck import StribeckExamination, examined
from stagectl_studies.reproduction.tracking import MOTIONS, Tracking, tracked

STAGE = "ball-screw.yaml"
SWEEPS = ("frf-3a", "frf-5a", "frf-7a", "frf-9a")
MOVING = "frf-moving"
SPEEDS, SLOW = "constant-speed", "ultra-low-speed"
MAIN = "current-sine-1.6hz-5a"
OTHERS = ("current-sine-0.8hz-5a", "current-sine-1.6hz-3a", "sine-0.8hz")
CALIBRATED = "delay known"
DATA_SHEET = (1.2, 0.7, 0.8)  # inertia, viscous and rolling friction over the true ones
STEPS = {"experiments": 14.0, "frequency responses": 2.0, "conventional": 0.5, "simultaneous": 3.0, "tracking": 2.0}
SEED = 20


class Extent(NamedTuple):
    """How much is done; less than all of it for a quick look."""

    sweeps: tuple[str, ...] = SWEEPS
    frequencies: tuple[float, ...] = ()  # Hz, of the sweeps; empty: those of their files
    others: tuple[str, ...] = OTHERS
    motions: tuple[str, ...] = MOTIONS


WHOLE = Extent()


class Evidence(NamedTuple):
    """Everything that the paper's figures are drawn from."""

    bench: Bench
    runs: dict[str, Run]
    captures: dict[str, list[Capture]]
    stribeck: StribeckExamination
    steps: list[StepResponse]
    response: IdentificationResult
    speed: IdentificationResult
    slow: IdentificationResult
    proposed: dict[str, IdentificationResult]  # by experiment, and CALIBRATED
    tracking: Tracking


def evidence(course: Course, extent: Extent = WHOLE, seed: int = SEED) -> Evidence:
    """Carry out all experiments and identify from them."""
    machine = load_stage(CONFIG / STAGE)
    bench = Bench(machine, guessed(machine, *DATA_SHEET), seed).noisy(NOISE, 0)
    runs = _experiments(course, bench, extent)
    further = examined(bench), steps(bench)
    captures = {name: captured(run) for name, run in runs.items()}
    file = bench.believed.file
    sweeps = [capture for name in (*extent.sweeps, MOVING) for capture in captures[name]]
    response = frequency_response.identify(sweeps, file, course.begin("frequency responses"))
    tell = course.begin("conventional")
    speed = constant_speed.identify(captures[SPEEDS], file)
    tell(1, 2)
    slow = low_speed.identify(captures[SLOW], file)
    proposed = _proposed(course, captures, bench, extent)
    tracking = tracked(
        bench, {"conventional": slow, "proposed": proposed[MAIN]}, extent.motions, course.begin("tracking")
    )
    return Evidence(bench, runs, captures, *further, response, speed, slow, proposed, tracking)


def _experiments(course: Course, bench: Bench, extent: Extent) -> dict[str, Run]:
    names = (*extent.sweeps, MOVING, SPEEDS, SLOW, MAIN, *extent.others)
    tell = course.begin("experiments")
    runs = {}
    for number, name in enumerate(names):
        drawn = bench.noisy(NOISE, number)
        runs[name] = carried_out(drawn, experiment(name, bench.believed, extent), name)
        tell(number + 1, len(names))
    return runs


def experiment(name: str, setup: Setup, extent: Extent = WHOLE) -> Experiment:
    """The experiment or motion of that name, from the configuration."""
    folder = "trajectories" if name.startswith("sine-") else "experiments"
    trajectory: Any = load_trajectory(CONFIG / folder / f"{name}.yaml", axis_of(setup))
    if isinstance(trajectory, CurrentSweep) and extent.frequencies:
        return trajectory._replace(frequencies=extent.frequencies)
    return trajectory  # type: ignore[no-any-return]


def _proposed(
    course: Course, captures: dict[str, list[Capture]], bench: Bench, extent: Extent
) -> dict[str, IdentificationResult]:
    """By experiment; the main one once more with the delay known from how a drive samples."""
    tell = course.begin("simultaneous")
    names = (MAIN, *extent.others)
    results = {}
    for number, name in enumerate(names):
        results[name] = simultaneous.identify(captures[name], bench.believed.file)
        tell(number + 1, len(names) + 1)
    delay = known_delay(captures[MAIN][0], bench.believed.file)
    results[CALIBRATED] = simultaneous.identify(captures[MAIN], bench.believed.file, delay=delay)
    return results
