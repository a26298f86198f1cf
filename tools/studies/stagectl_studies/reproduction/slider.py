"""Slider paper, all experiments: reversals, standstill and release, the fitted forms, and the compensated runs.

The virtual machine is the stage file's with friction that follows the speed late (`slider_contact`); mass and viscous
friction are taken as known, as in the paper, the rolling friction is not.  No current noise: the paper states none, and
its errors are those of friction.
"""

from typing import Any, NamedTuple

from stagectl.config.stage_file import Setup, load_stage
from stagectl.config.trajectory_file import axis_of, load_trajectory
from stagectl.identification.result import Parameter
from stagectl_studies.reproduction import chosen, slider_contact, slider_forms
from stagectl_studies.reproduction.bench import CONFIG, NO_FRICTION, Bench, Run, captured, carried_out, guessed
from stagectl_studies.reproduction.progress import Course
from stagectl_studies.reproduction.release import Release, holding, released
from stagectl_studies.reproduction.reversal_error import ReversalError, reversal_errors
from stagectl_studies.reproduction.slider_forms import CONVENTIONAL, FIRST, OURS, SECOND, FittedForms

STAGE = "linear-slider.yaml"
SPEEDS = ("2.5", "5", "10")  # mm/s
FASTEST = "10"
DATA_SHEET = (1.1, 0.9, 0.8)  # inertia, viscous and rolling friction over the true ones
STEPS = {"reversals": 1.0, "standstill and release": 1.0, "contacts": 4.0, "fits": 14.0, "compensation": 2.0}
SEED = 20
NONE = "none"
COMPENSATIONS = (NONE, CONVENTIONAL, FIRST, SECOND, OURS)
_ALL = frozenset[str]()


class Extent(NamedTuple):
    """How much is done; less than all of it for a quick look."""

    speeds: tuple[str, ...] = SPEEDS  # the last one is that of the fit
    compensations: tuple[str, ...] = COMPENSATIONS
    lags: tuple[float, ...] = chosen.LAGS


WHOLE = Extent()


class Evidence(NamedTuple):
    """Everything that the paper's figures are drawn from."""

    bench: Bench
    reversals: dict[str, Run]  # by speed, velocity feedforward 0
    stops: dict[str, Run]  # the same with a standstill behind each stroke
    releases: dict[str, Run]
    holding: dict[str, Parameter]  # N, by speed
    ringing: dict[str, Release]
    contacts: slider_contact.Cases
    forms: FittedForms
    compensated: dict[tuple[str, str], Run]  # by speed and form, velocity feedforward 1
    errors: dict[tuple[str, str], list[ReversalError]]
    turns: dict[tuple[str, str], list[ReversalError]]  # the same within the ramps of the reversal


def evidence(course: Course, extent: Extent = WHOLE, seed: int = SEED) -> Evidence:
    """Carry out all experiments, fit all forms, and compensate with them."""
    stage = load_stage(CONFIG / STAGE)
    machine = slider_contact.remembering(stage)
    ahead = Bench(machine, guessed(stage, *DATA_SHEET), seed)
    plain = ahead._replace(believed=_fed_forward(ahead.believed, 0.0))
    reversals, stops, releases = _experiments(course, plain, extent)
    force = machine.file.motor.force_constant
    held = {
        speed: holding(s["time"], s["velocity"], force * s["measured_current"])
        for speed, s in ((speed, run.samples) for speed, run in stops.items())
    }
    step = machine.stage.encoder.step
    ringing = {
        speed: released(run.samples["time"], run.samples["measured"], slider_contact.opening(run), step)
        for speed, run in releases.items()
    }
    contacts = slider_contact.cases(plain, extent.speeds, extent.lags, course.begin("contacts"))
    fastest = extent.speeds[-1]
    bare = carried_out(ahead, slider_contact.motion(ahead.believed, fastest), f"{fastest} mm/s", NO_FRICTION)
    forms = slider_forms.fitted_forms(captured(bare), ahead.believed.file, seed, course.begin("fits"))
    tell = course.begin("compensation")
    compensated = {}
    for number, speed in enumerate(extent.speeds):
        for form in extent.compensations:
            compensated[speed, form] = _compensated(ahead, forms, speed, form)
        tell(number + 1, len(extent.speeds))
    errors = {key: _errors(run) for key, run in compensated.items()}
    turns = {(speed, form): _turns(run, speed) for (speed, form), run in compensated.items()}
    return Evidence(plain, reversals, stops, releases, held, ringing, contacts, forms, compensated, errors, turns)


Runs = dict[str, Run]


def _experiments(course: Course, bench: Bench, extent: Extent) -> tuple[Runs, Runs, Runs]:
    """Reversals, stops and releases by speed."""
    tell = course.begin("reversals")
    reversals = {}
    for number, speed in enumerate(extent.speeds):
        reversals[speed] = carried_out(bench, slider_contact.motion(bench.believed, speed), f"{speed} mm/s")
        tell(number + 1, len(extent.speeds))
    tell = course.begin("standstill and release")
    dwell: Any = load_trajectory(CONFIG / "trajectories" / "slider-dwell.yaml", axis_of(bench.machine))
    stops, releases = {}, {}
    for number, speed in enumerate(extent.speeds):
        stops[speed] = carried_out(bench, dwell._replace(velocity=1e-3 * float(speed)), f"{speed} mm/s")
        releases[speed] = carried_out(bench, slider_contact.release(bench.machine, speed), f"{speed} mm/s")
        tell(number + 1, len(extent.speeds))
    return reversals, stops, releases


def _fed_forward(setup: Setup, share: float) -> Setup:
    """`setup` with this share of the reference velocity fed forward."""
    control: Any = setup.file.control
    return setup.having(control=control._replace(velocity_feedforward=share))


def _compensated(bench: Bench, forms: FittedForms, speed: str, form: str) -> Run:
    believed = bench.believed
    if form == NONE:
        return carried_out(bench, slider_contact.motion(believed, speed), f"{speed} mm/s", NO_FRICTION)
    file = believed.file._replace(compensation=forms.forms[form].form)
    here = bench._replace(believed=believed._replace(file=file))
    return carried_out(here, slider_contact.motion(believed, speed), f"{speed} mm/s, {form}", _ALL)


def _errors(run: Run) -> list[ReversalError]:
    s = run.samples
    return reversal_errors(s["reference"], s["velocity"], s["measured"], run.setup.dt)


def _turns(run: Run, speed: str) -> list[ReversalError]:
    """Without what the jumps of the reference's acceleration leave at the ends of the ramps."""
    ramp = 1e-3 * float(speed) / slider_contact.motion(run.setup, speed).acceleration
    s = run.samples
    return reversal_errors(s["reference"], s["velocity"], s["measured"], run.setup.dt, ramp - 2.0 * run.setup.dt)


def extremes(errors: list[ReversalError]) -> tuple[float, float]:
    """Largest lag (negative) and largest lead (positive) of all reversals (m)."""
    return min(error.negative for error in errors), max(error.positive for error in errors)
