"""The residual of an effect: a machine with it, simulated in closed loop, minus what a model without it explains."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, savgol_filter, sosfiltfilt, welch

from stagectl.config.stage_file import Setup, load_stage
from stagectl.gap.experiment_design import battery, catalogue
from stagectl.gap.experiment_design.experiment import Experiment
from stagectl.gap.inference import basis_functions
from stagectl.gap.logs.session import Array
from stagectl.gap.residuals import tracker_response
from stagectl.gap.residuals.model_tracking import MeasuredPath
from stagectl.gap.residuals.sensitivities import model_of, model_residual
from stagectl.kernels import rollout, stage
from stagectl.kernels.law import OUTPUT_COLUMNS
from stagectl.recording.replay import recomputed
from stagectl.simulation import noise, structured

EFFORT, CURRENT, COMMAND = "effort", "current", "command"
BAND = 100.0  # Hz, of the effort that is drawn: counts of the encoder lie above it
SMOOTH = 0.012  # s, over which velocity and acceleration are taken
BACK = 0.0005  # rad, 1 um of table travel: a shorter motion back is not a reversal

Change = Callable[[stage.Stage], stage.Stage]


class Scene(NamedTuple):
    """A motion of one machine that shows one effect."""

    name: str
    change: Change  # the machine with the effect
    motion: str  # an experiment of the battery or of the catalogue
    across: str  # coordinate of the picture, see `pictures.AXES`
    channel: str = EFFORT
    colours: str = "direction"  # how the points are grouped, see `pictures.groups`
    base: Change = lambda p: p  # of both machines and the model, where the shipped stage does not show the effect
    starts: tuple[float, ...] = (0.0,)  # s, session clock at which the motion is made
    shift: int = 0  # rows by which the current is logged late
    gain: float = 1.0  # proportional gain of the controller that runs, over that of its model
    band: float = BAND  # Hz, low-pass of the effort
    above: float = 0.0  # Hz, high-pass of the effort
    part: tuple[float, float] = (0.0, np.inf)  # s, of the motion
    zoom: tuple[float, float] | None = None  # of the coordinate as it is drawn
    opposing: bool = False  # the effort is drawn along the motion


class Residual(NamedTuple):
    """Residual and coordinates along one motion, (n,) each."""

    time: Array  # s, session clock
    position: Array  # rad | m
    velocity: Array
    acceleration: Array
    since: Array  # rad | m, displacement since the last reversal
    rest: Array  # s of standstill of the reference before the motion of the row
    current: Array  # A, of the command that acts
    slope: Array  # A/s, of it
    error: Array  # rad | m, of the tracking
    residual: Array  # N m | N, or A


def motion_named(setup: Setup, name: str) -> Experiment:
    """The experiment of this name, made for the stage; raises KeyError where there is none."""
    return _motions(setup.path)[name]


@functools.lru_cache(maxsize=2)
def _motions(path: Path) -> dict[str, Experiment]:
    setup = load_stage(path)
    return {experiment.name: experiment for experiment in (*catalogue.library(setup), *battery.battery(setup))}


def residuals(setup: Setup, scene: Scene) -> tuple[Residual, Residual]:
    """Residuals of a machine with the effect, and of one without it."""
    base = scene.base(setup.stage)
    machines = ((scene.change(base), scene), (base, scene._replace(shift=0, gain=1.0)))
    with_effect, without = (
        _joined([_run(setup, base, machine, recorded, start) for start in recorded.starts])
        for machine, recorded in machines
    )
    return with_effect, without


def _joined(parts: list[Residual]) -> Residual:
    return Residual(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _run(setup: Setup, base: stage.Stage, machine: stage.Stage, scene: Scene, start: float) -> Residual:
    rows = _rows(setup, machine, scene, start)
    reported = np.roll(rows["measured_current"], scene.shift)
    path = MeasuredPath(np.column_stack([rows["current"], rows["measured"], reported]), start, setup.dt)
    kept = slice(*np.searchsorted(rows["time"], scene.part))
    columns = _columns(setup, rows, _residual(setup, base, scene, path, rows), start)
    edge = slice(100, -100)  # the filters have no neighbours there
    return Residual(*(column[kept][edge] for column in columns))


def _rows(setup: Setup, machine: stage.Stage, scene: Scene, start: float) -> NDArray[Any]:
    law = setup.controller.law
    stronger = law.feedback._replace(proportional=law.feedback.proportional * scene.gain)
    setpoints = motion_named(setup, scene.motion).setpoints(setup)
    rows = np.zeros((len(setpoints), rollout.WIDTH))
    disturbances = noise(setup.file.simulation, len(setpoints), machine.drive.jitter)
    loop = rollout.Loop(law._replace(feedback=stronger), machine)
    rollout.closed_loop(loop, stage.at_rest(machine, 0.0, start), (setpoints, disturbances, rows), setup.dt, 10)
    return structured(rows)


def _residual(setup: Setup, base: stage.Stage, scene: Scene, path: MeasuredPath, rows: NDArray[Any]) -> Array:
    if scene.channel == COMMAND:
        return _recomputed(setup, rows)
    model = model_of(base, setup.dt)
    unexplained = model_residual(model, path)
    if scene.channel == CURRENT:
        return unexplained.current
    effort = tracker_response.untracked(unexplained.effort, model, setup.dt)
    filters: tuple[tuple[float, Literal["lowpass", "highpass"]], ...]
    filters = ((scene.band, "lowpass"), (scene.above, "highpass"))
    for edge, kind in filters:
        if 0.0 < edge < 0.5 / setup.dt:
            effort = sosfiltfilt(butter(2, edge, kind, fs=1.0 / setup.dt, output="sos"), effort)
    return effort


def _recomputed(setup: Setup, rows: NDArray[Any]) -> Array:
    """Cut A: the logged command minus the recomputed one."""
    law = setup.controller.law
    setpoints = np.stack([rows[name] for name in rollout.COLUMNS[1 : 1 + rollout.SETPOINTS]], axis=1)
    difference: Array = rows["current"] - recomputed(law, setpoints, rows["measured"])[:, OUTPUT_COLUMNS["current"]]
    return difference


def _columns(setup: Setup, rows: NDArray[Any], residual: Array, start: float) -> Residual:
    dt, position = setup.dt, np.ascontiguousarray(rows["measured"])
    window = 2 * round(0.5 * SMOOTH / dt) + 1
    velocity, acceleration = (savgol_filter(position, window, 3, deriv=k, delta=dt) for k in (1, 2))
    command = np.roll(rows["current"], setup.stage.drive.delay_samples + 1)  # the one that acts
    slope = np.gradient(command, dt)
    since = basis_functions.since_reversal(position, BACK)
    course = (position, velocity, acceleration, since, _rests(rows["reference"], dt), command, slope, rows["error"])
    return Residual(rows["time"] + start, *course, residual)


def _rests(reference: Array, dt: float) -> Array:
    """Standstill (s) of the reference (n,) before the motion of each row."""
    still = np.diff(reference, prepend=reference[0]) == 0.0
    rests, count, last = np.zeros(len(still)), 0, 0.0
    for k, at_rest in enumerate(still.tolist()):
        count = count + 1 if at_rest else 0
        last = count * dt if at_rest else last
        rests[k] = last
    return rests


def spectrum(signal: Array, dt: float) -> tuple[Array, Array]:
    """Frequencies (Hz) and amplitude density of `signal` (n,), per root hertz."""
    frequency, density = welch(signal, 1.0 / dt, nperseg=2048)
    return frequency, np.sqrt(density)
