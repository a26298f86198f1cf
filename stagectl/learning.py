"""Iterative learning control: a current for a repeated motion, improved from trial to trial.

After trial j with the learned current u_j and the error e_j = target - measured::

    u_j+1 = u_j + step (Q (u_j + gain L e_j) - u_j)        L = C + 1/P        y = P/(1 + P C) u

The step is 1 until the error no longer falls.  From then on the error is noise, and with steps of 1/2, 1/3, ... the
trials are averaged, which moves no fixed point.  A trial whose error grows is undone, and half the step taken.

L is the inverse of the response from an injected current to the measured position.  It has two parts.  C e is the
response of the feedback to the error, computed by the law's own kernel, whichever law it is.  1/P, of the sampled plant
with its current loop and all delays (`design.plant`), is not causal and is applied with Q by the FFT.  Q is a
Butterworth low-pass run forwards and backwards: no phase, half the amplitude at the cutoff.

On a plant P that is not the model the error of each frequency shrinks from trial to trial while

    |Q (1 - gain S/S^)| < 1             S = 1/(C + M + (1 + U)/P), S^ = 1/(C + 1/P) of the model

with M and U of the disturbance observer, if there is one: on the model itself it sees nothing.  `convergence` evaluates
it with the inertia off by a fifth and with the axis held by its rolling friction.
Source: D. A. Bristow, M. Tharayil, A. G. Alleyne, IEEE Control Systems Magazine 26(3), 2006; together with a friction
model: T. Takemura, H. Fujimoto, IECON 2010.
"""

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
import scipy  # its parts load when they are used: reading a stage file needs none
from numpy.typing import NDArray

from stagectl import design
from stagectl.kernels import law, observer, stage
from stagectl.units import Quantity

Array = NDArray[np.float64]
# Constants that decide something; chosen on simulated trials, not derived, unless a reason is given.
GROWN = 1.2  # times the best error: beyond it a trial is undone; repeats under noise differ by a few per cent
FELL = 0.9  # of the last error: above it the error counts as no longer falling, and trials are averaged
HOLD, FADE = 0.02, 0.08  # s at the end of the run from which nothing is learned, and of the transition before them
INERTIA_SHARES = (0.8, 1.2)  # inertias over the model's with which convergence is evaluated
CUTOFF_STEPS = 20  # cutoffs that are tried below the one of the settings
PADDING = 1000  # periods by which a run is extended for the zero-phase filter; ten time constants at 15 Hz
_ORDER = 2  # of Q, run once
_RESPONSE = 8192  # periods of the law's impulse response


class LearningSettings(NamedTuple):
    """How an axis learns from trial to trial."""

    cutoff: Annotated[
        float, Quantity("Hz", "(0, 1e4]", "cutoff of the learned current: the model is not trusted above")
    ] = 200.0
    gain: Annotated[float, Quantity("", "(0, 1]", "share of the model's correction that a trial learns")] = 0.8


class Filters(NamedTuple):
    """What turns the error of a whole run into current, for one stage, law and number of periods n."""

    law: law.Law  # without limit and observer, which knows the learned current and does not respond to it
    sections: Any  # (m, 6), Q run once
    inverse: Any  # (bins,) complex, Q/P
    weight: Array  # (n,) share of the error that is learned from


class Trial(NamedTuple):
    """How one trial went."""

    rms: float  # rad | m, of the error over the whole run
    peak: float  # rad | m
    step: float  # with which the next one was made from it; 0 where it was undone
    words: str  # remark for the user, may be empty


class LearningState(NamedTuple):
    """State of the learning between two trials."""

    learned: Array  # (n,) A, to be tried next
    best: Array  # (n,) A, tried with the least error
    error: Array  # (n,) rad | m, of that trial
    trials: tuple[Trial, ...] = ()
    averaged: int = 0  # trials since the error no longer fell
    undone: int = 0


class Contraction(NamedTuple):
    """The largest ratio over frequency of the error after a trial to that before it."""

    plant: str
    most: float  # below 1: the error shrinks at every frequency
    frequency: float  # Hz


def filters(p: stage.Stage, running: law.Law, settings: LearningSettings, dt: float, count: int) -> Filters:
    """The filters of a run of `count` periods `dt` (s)."""
    sections = _low_pass(settings, dt)
    room = 2 ** math.ceil(math.log2(count + 2.0 / (settings.cutoff * dt) + float(PADDING)))
    frequency: Array = np.fft.rfftfreq(room, dt).astype(np.float64)
    passed = _passed(sections, frequency, dt)
    with np.errstate(divide="ignore", invalid="ignore"):
        response = design.plant(p, dt).at(np.exp(2j * np.pi * frequency * dt))
        inverse = np.where(passed > 1e-12, passed / response, 0.0)
    inverse[0] = 0.0  # 1/P of a position: no current is needed to stand
    return Filters(_feedback_alone(running), sections, inverse, _weight(count, dt))


def _feedback_alone(running: law.Law) -> law.Law:
    """The feedback of the law alone, without a limit."""
    return running._replace(current_limit=math.inf, observer=observer.ABSENT)


def _low_pass(settings: LearningSettings, dt: float) -> Any:
    return scipy.signal.butter(_ORDER, min(settings.cutoff, 0.45 / dt), fs=1.0 / dt, output="sos")


def _passed(sections: Any, frequency: Array, dt: float) -> Array:
    """Q (n,) at `frequency` (Hz): real, as it is run forwards and backwards."""
    gain: Array = np.abs(scipy.signal.sosfreqz(sections, frequency, fs=1.0 / dt)[1]) ** 2
    return gain


def _weight(count: int, dt: float) -> Array:
    """1, and 0 at the end: the full effect of the last periods' current is not recorded, so it would grow by noise."""
    remaining = dt * np.arange(count)[::-1]
    weight: Array = 0.5 - 0.5 * np.cos(np.pi * np.clip((remaining - HOLD) / FADE, 0.0, 1.0))
    return weight


def feedback_current(running: law.Law, error: Array) -> Array:
    """Current (n,) of the feedback to this `error` (n,) while the axis moves: without the band of a standstill."""
    running = running._replace(standstill_band=0.0)
    x, current = law.AT_REST, np.empty(len(error))
    for k, value in enumerate(error.tolist()):
        output, x = law.step(running, x, law.Setpoint(0.0, 0.0, 0.0, 0.0), -value)
        current[k] = output.command
    return current


def whole_step(p: Filters, learned: Array, error: Array, gain: float) -> Array:
    """``Q (learned + gain L error)`` (n,) A: the current after a step of 1."""
    weighted = error * p.weight
    length = 2 * (len(p.inverse) - 1)
    ahead = np.fft.irfft(p.inverse * np.fft.rfft(weighted, length), length)[: len(error)]
    current, padding = learned + gain * feedback_current(p.law, weighted), min(len(learned) - 1, PADDING)
    smooth: Array = scipy.signal.sosfiltfilt(p.sections, current, padtype="constant", padlen=padding)
    return smooth + gain * ahead


def initial_state(count: int) -> LearningState:
    """The state before the first trial of `count` periods: no current."""
    nothing = np.zeros(count)
    return LearningState(nothing, nothing, nothing)


def after_trial(p: Filters, settings: LearningSettings, course: LearningState, error: Array) -> LearningState:
    """The state after the trial of ``course.learned``, whose `error` (n,) rad | m decides: kept or undone.

    Raises ValueError where the error is not finite.
    """
    rms, peak = float(np.sqrt(np.mean(error * error))), float(np.max(np.abs(error)))
    if not math.isfinite(rms):
        raise ValueError("the error of a trial must be finite in all rows")
    least = min((trial.rms for trial in course.trials), default=math.inf)
    if rms > GROWN * least:
        return _undone(p, settings, course, Trial(rms, peak, 0.0, ""))
    averaged = course.averaged + (bool(course.trials) and rms > FELL * course.trials[-1].rms)
    step = 0.5**course.undone / (1.0 + averaged)
    words = "no longer falls: averaged with the trials before" if averaged else ""
    kept = (course.learned, error) if rms < least else (course.best, course.error)
    trials = (*course.trials, Trial(rms, peak, step, words))
    return LearningState(_stepped(p, settings, course.learned, error, step), *kept, trials, averaged, course.undone)


def _undone(p: Filters, settings: LearningSettings, course: LearningState, trial: Trial) -> LearningState:
    """Back to the best trial, followed by half the step."""
    undone = course.undone + 1
    number = min(range(len(course.trials)), key=lambda k: course.trials[k].rms) + 1
    step = 0.5**undone / (1.0 + course.averaged)
    trials = (*course.trials, trial._replace(words=f"grew: undone, back to trial {number} with half the step"))
    learned = _stepped(p, settings, course.best, course.error, step)
    return course._replace(learned=learned, trials=trials, undone=undone)


def _stepped(p: Filters, settings: LearningSettings, learned: Array, error: Array, step: float) -> Array:
    return learned + step * (whole_step(p, learned, error, settings.gain) - learned)


class PlantRatios(NamedTuple):
    """S/S^ of the plants that the axis may be: what each of them answers, over what the model answers."""

    dt: float  # s
    frequency: Array  # (m,) Hz
    plants: list[tuple[str, NDArray[Any]]]  # name and share (m,)


def plant_ratios(p: stage.Stage, running: law.Law, dt: float) -> PlantRatios:
    """S/S^ of the model, of inertias off by a fifth, and of the axis while its rolling friction holds it."""
    frequency = np.geomspace(0.5, 0.4999 / dt, 2000)
    z = np.exp(2j * np.pi * frequency * dt)
    feedback = _feedback_response(_feedback_alone(running), z)
    measured, commanded = observer.transfer(running.observer, z)
    model = feedback + 1.0 / design.plant(p, dt).at(z)
    plants = [
        (name, model / (feedback + measured + (1.0 + commanded) / design.plant(other, dt, held).at(z)))
        for name, other, held in _possible_plants(p)
    ]
    return PlantRatios(dt, frequency, plants)


def convergence(seen: PlantRatios, settings: LearningSettings) -> list[Contraction]:
    """The worst contraction of the error by one trial, for each plant."""
    passed, contractions = _passed(_low_pass(settings, seen.dt), seen.frequency, seen.dt), []
    for name, share in seen.plants:
        ratio = np.abs(passed * (1.0 - settings.gain * share))
        worst = int(np.argmax(ratio))
        contractions.append(Contraction(name, float(ratio[worst]), float(seen.frequency[worst])))
    return contractions


def highest_convergent_cutoff(seen: PlantRatios, settings: LearningSettings) -> float:
    """The highest cutoff (Hz) up to that of `settings` with which the error shrinks on all these plants; 0 if none."""
    for share in np.arange(CUTOFF_STEPS, 0, -1) / float(CUTOFF_STEPS):
        lower = settings._replace(cutoff=float(share * settings.cutoff))
        if max(contraction.most for contraction in convergence(seen, lower)) < 1.0:
            return lower.cutoff
    return 0.0


def _possible_plants(p: stage.Stage) -> list[tuple[str, stage.Stage, bool]]:
    """Plants that the axis may be: name, stage, and whether its rolling friction holds it."""
    body = p.mechanics
    light, heavy = (p._replace(mechanics=body._replace(inertia=share * body.inertia)) for share in INERTIA_SHARES)
    return [
        ("the model", p, False),
        ("inertia 20 % below it", light, False),
        ("inertia 20 % above it", heavy, False),
        ("held by rolling friction", p, True),
    ]


def _feedback_response(running: law.Law, z: NDArray[Any]) -> NDArray[Any]:
    """The law's response to an error at `z` (m,), from its impulse response; differenced, as it has an integrator."""
    impulse = np.zeros(_RESPONSE)
    impulse[1] = 1.0
    response = np.diff(feedback_current(running, impulse), prepend=[0.0])[1:]
    last = int(np.flatnonzero(np.abs(response) > 1e-9 * np.max(np.abs(response)))[-1]) + 1
    transfer: NDArray[Any] = np.polyval(response[:last][::-1], 1.0 / z) / (1.0 - 1.0 / z)
    return transfer
