"""What the diagnosis sees of an effect: a machine with it, simulated in closed loop, and what the model lacks of it."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, savgol_filter, sosfiltfilt, welch

from stagectl import design
from stagectl.config.stage_file import Setup, load_stage
from stagectl.gap.experiment_design import battery, catalogue
from stagectl.gap.experiment_design.experiment import Experiment
from stagectl.gap.inference import basis_functions, tracker_response
from stagectl.gap.logs.session import Array, Session
from stagectl.gap.residuals.model_tracking import Path as Tied
from stagectl.gap.residuals.sensitivities import lacks, model_of
from stagectl.kernels import rollout, stage
from stagectl.simulation import noise, structured

EFFORT, CURRENT, COMMAND = "effort", "current", "command"
BAND = 100.0  # Hz: what is shown of an effort; a count of the encoder is no part of it
SMOOTH = 0.012  # s, over which velocity and acceleration are taken
BACK = 0.0005  # rad, 1 um of table travel: a shorter way back is no reversal

Change = Callable[[stage.Stage], stage.Stage]


class Scene(NamedTuple):
    """A motion of one machine that shows one effect."""

    name: str
    change: Change  # the machine with the effect
    motion: str  # of the battery, or of the experiments beside it
    across: str  # coordinate that orders it, see `pictures.AXES`
    channel: str = EFFORT
    colours: str = "direction"  # what the points are told apart by, see `pictures.groups`
    base: Change = lambda p: p  # both machines and the model, where the shipped stage has too little to show
    starts: tuple[float, ...] = (0.0,)  # s, session clock at which the motion is made
    shift: int = 0  # rows by which the current is logged late
    gain: float = 1.0  # of the law's proportional part that was deployed, over that of the model of it
    band: float = BAND  # Hz, of what is shown
    above: float = 0.0  # Hz: what is slower is left out
    part: tuple[float, float] = (0.0, np.inf)  # s, of the motion
    zoom: tuple[float, float] | None = None  # of the coordinate as it is drawn
    opposing: bool = False  # the effort is drawn along the motion


class Seen(NamedTuple):
    """Along one motion, (n,) each."""

    time: Array  # s, session clock
    position: Array  # rad | m
    velocity: Array
    acceleration: Array
    since: Array  # rad | m, displacement since the last reversal
    rest: Array  # s, that the reference stood before the motion to which the row belongs
    current: Array  # A, of the command that acts
    slope: Array  # A/s, of it
    error: Array  # rad | m, of the tracking
    lacking: Array  # N m | N, or A


def motion_named(setup: Setup, name: str) -> Experiment:
    """The experiment of this name, made for the stage; raises KeyError where there is none."""
    return _motions(setup.path)[name]


@functools.lru_cache(maxsize=2)
def _motions(path: Path) -> dict[str, Experiment]:
    setup = load_stage(path)
    return {one.name: one for one in (*catalogue.library(setup), *battery.battery(setup))}


def seen(setup: Setup, scene: Scene) -> tuple[Seen, Seen]:
    """What the model lacks of a machine with the effect, and of one without it."""
    base = scene.base(setup.stage)
    machines = ((scene.change(base), scene), (base, scene._replace(shift=0, gain=1.0)))
    with_it, without = (_joined([_run(setup, base, machine, one, t) for t in one.starts]) for machine, one in machines)
    return with_it, without


def _joined(parts: list[Seen]) -> Seen:
    return Seen(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _run(setup: Setup, base: stage.Stage, machine: stage.Stage, scene: Scene, start: float) -> Seen:
    rows = _rows(setup, machine, scene, start)
    reported = np.roll(rows["measured_current"], scene.shift)
    path = Tied(np.column_stack([rows["current"], rows["measured"], reported]), start, setup.dt)
    kept = slice(*np.searchsorted(rows["time"], scene.part))
    found = _course(setup, rows, _lacking(setup, base, scene, path, rows), start)
    edge = slice(100, -100)  # the filters have no neighbours there
    return Seen(*(one[kept][edge] for one in found))


def _rows(setup: Setup, machine: stage.Stage, scene: Scene, start: float) -> NDArray[Any]:
    law = design.design(setup.stage, setup.file.control).law
    stronger = law.feedback._replace(proportional=law.feedback.proportional * scene.gain)
    setpoints = motion_named(setup, scene.motion).setpoints(setup)
    rows = np.zeros((len(setpoints), rollout.WIDTH))
    drawn = noise(setup.file.simulation, len(setpoints), machine.drive.jitter)
    loop = rollout.Loop(law._replace(feedback=stronger), machine)
    rollout.closed_loop(loop, stage.at_rest(machine, 0.0, start), (setpoints, drawn, rows), setup.dt, 10)
    return structured(rows)


def _lacking(setup: Setup, base: stage.Stage, scene: Scene, path: Tied, rows: NDArray[Any]) -> Array:
    if scene.channel == COMMAND:
        return _recomputed(setup, rows)
    model = model_of(_session(setup, base), base)
    found = lacks(model, path)
    if scene.channel == CURRENT:
        return found.current
    effort = tracker_response.untracked(found.effort, model, setup.dt)
    filters: tuple[tuple[float, Literal["lowpass", "highpass"]], ...]
    filters = ((scene.band, "lowpass"), (scene.above, "highpass"))
    for edge, kind in filters:
        if 0.0 < edge < 0.5 / setup.dt:
            effort = sosfiltfilt(butter(2, edge, kind, fs=1.0 / setup.dt, output="sos"), effort)
    return effort


def _recomputed(setup: Setup, rows: NDArray[Any]) -> Array:
    """Cut A: the logged command less the one that the model of the controller gives."""
    law = design.design(setup.stage, setup.file.control).law
    setpoints = np.stack([rows[name] for name in rollout.COLUMNS[1 : 1 + rollout.SETPOINTS]], axis=1)
    out = np.zeros((len(rows), 7))
    rollout.answers(law, (np.ascontiguousarray(setpoints), np.ascontiguousarray(rows["measured"]), out))
    column = rollout.COLUMNS.index("current") - 1 - rollout.SETPOINTS
    difference: Array = rows["current"] - out[:, column]
    return difference


def _session(setup: Setup, base: stage.Stage) -> Session:
    axis = setup.file.axis
    return Session(setup.path, axis.kind, axis.travel_per_unit, axis.travel_unit, setup.dt, base, None, ())


def _course(setup: Setup, rows: NDArray[Any], lacking: Array, start: float) -> Seen:
    dt, position = setup.dt, np.ascontiguousarray(rows["measured"])
    window = 2 * round(0.5 * SMOOTH / dt) + 1
    velocity, acceleration = (savgol_filter(position, window, 3, deriv=k, delta=dt) for k in (1, 2))
    command = np.roll(rows["current"], setup.stage.drive.delay_samples + 1)  # the one that acts
    slope = np.gradient(command, dt)
    since = basis_functions.since_reversal(position, BACK)
    course = (position, velocity, acceleration, since, _rests(rows["reference"], dt), command, slope, rows["error"])
    return Seen(rows["time"] + start, *course, lacking)


def _rests(reference: Array, dt: float) -> Array:
    """How long (s) the reference (n,) had stood before the motion that each row belongs to."""
    still = np.diff(reference, prepend=reference[0]) == 0.0
    found, count, last = np.zeros(len(still)), 0, 0.0
    for k, stands in enumerate(still.tolist()):
        count = count + 1 if stands else 0
        last = count * dt if stands else last
        found[k] = last
    return found


def spectrum(signal: Array, dt: float) -> tuple[Array, Array]:
    """Frequencies (Hz) and amplitude density of `signal` (n,), per root hertz."""
    frequency, density = welch(signal, 1.0 / dt, nperseg=2048)
    return frequency, np.sqrt(density)
