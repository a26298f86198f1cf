"""One trial of the exam, drawn by a seed: a machine, its hidden effects, and the captures of its session."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl_studies.machine import battery, effects_alien, effects_body, effects_drive, effects_friction  # noqa: F401  they enter themselves
from stagectl_studies.machine.battery import HALF_STROKE, REPEATS, Experiment
from stagectl_studies.machine.contact import MEMORY
from stagectl_studies.machine.controller import Loop, Model, Rows, designed, prepared
from stagectl_studies.machine.effects import ALIENS, EFFECTS, Around, Rig, applied, draw_of
from stagectl_studies.machine.machine import MAXWELL, Drive, Floats
from stagectl_studies.machine.plant import Noise, Setting, Trace, ideal, noise_of, remanent, silent, simulated
from stagectl_studies.machine.reference import PERIOD
from stagectl_studies.machine.stages import LAWS, Ground, believed, on, stage

STRATA = ("null-exact", "null-parameters", "null-law", "single", "pair", "triple", "poor", "alien")
BREAK = 2.0  # s between captures
LARGEST_COMMAND = 400.0  # A; a loop that saturates winds up and asks for a lot
ROUGHEST_COMMAND = 0.6  # A rms from row to row, in motion at small amplitude
CALM = ("micro-2", "micro-8", "multisine-1", "sine-3.2")
UNCHECKED = ("scan", "steps-20um", "steps-1mm", "sine-0.8", "micro-50", "multisine-2", "held-micro", "held-steps")
COMPANIONS = {"friction_lag": "stribeck"}  # an effect that needs another one
COMPANION_SCALE = 2.0
SMALLER = 0.7
ATTEMPTS = 12


class Hidden(NamedTuple):
    """An effect that is there: its scale as asked for and as realised, after the loop was found stable."""

    name: str
    scale: float
    realised: float
    seen_in: str
    companion: bool  # there only because another one needs it


class Capture(NamedTuple):
    """One run of an experiment, at its place in the session."""

    file: str
    experiment: Experiment
    repeat: int
    start: float


class Options(NamedTuple):
    """What a stratum leaves open; None lets the seed decide."""

    effects: tuple[str, ...] = ()
    scale: float | None = None
    offsets: bool | None = None
    law: str | None = None
    short: bool = False
    ground: Ground | None = None  # of another machine, in place of a drawn one


class Trial(NamedTuple):
    """The machine and its user's beliefs."""

    seed: int
    stratum: str
    rig: Rig
    model: Model
    loop: Loop  # as documented
    hidden: tuple[Hidden, ...]
    without: tuple[Rig, ...]  # the rig that lacks one of them
    captures: tuple[Capture, ...]
    law: str
    rows: dict[str, Rows]  # of the documented controller, by experiment


def session(experiments: Sequence[Experiment]) -> tuple[Capture, ...]:
    """Captures in order: each repeat runs the whole battery, then what is held out."""
    captures: list[Capture] = []
    clock = 5.0
    for use, repeats in REPEATS.items():
        for repeat in range(1, repeats + 1):
            for experiment in experiments:
                if experiment.use == use:
                    captures.append(Capture(f"{experiment.name}-{repeat}.csv", experiment, repeat, round(clock, 4)))
                    clock += experiment.reference.size * PERIOD + BREAK
    return tuple(captures)


def experiments_of(seed: int, stratum: str, short: bool) -> list[Experiment]:
    """The battery of a stratum."""
    if stratum == "poor":
        return [*battery.three_sines(), *battery.held_out(seed)]
    if short:
        return [*battery.short(seed), *battery.held_out_short(seed)]
    return [*battery.recommended(seed), *battery.held_out(seed)]


def prepared_rows(model: Model, loop: Loop, captures: Sequence[Capture]) -> dict[str, Rows]:
    """What the documented controller knows beforehand, by experiment."""
    experiments = {capture.experiment.name: capture.experiment for capture in captures}
    return {
        name: prepared(model, loop, experiment.reference, experiment.injection)
        for name, experiment in experiments.items()
    }


def around(rows: dict[str, Rows], captures: Sequence[Capture]) -> Around:
    """What realistic sizes hang on: length, peak current, speed and voltage of the captures for diagnosis."""
    used = [capture for capture in captures if capture.experiment.use == "diagnose"]
    speed = current = voltage = 0.0
    for run in (rows[capture.experiment.name] for capture in used if capture.repeat == 1):
        v = np.gradient(run.reference, PERIOD)
        speed = max(speed, float(np.abs(v).max()))
        current = max(current, float(np.abs(run.feedforward).max()))
        voltage = max(voltage, float(np.abs(Drive().resistance * run.feedforward + Drive().back_emf * v).max()))
    end = used[-1].start + used[-1].experiment.reference.size * PERIOD
    return Around(end, current, speed, voltage, HALF_STROKE)


def names_of(stratum: str, options: Options, random: np.random.Generator) -> tuple[str, ...]:
    """Names of the hidden effects, drawn unless they are given."""
    if options.effects:
        return options.effects
    count = {"single": 1, "pair": 2, "triple": 3, "poor": 1, "alien": 1}.get(stratum, 0)
    table = sorted(ALIENS if stratum == "alien" else EFFECTS)
    return tuple(str(name) for name in random.choice(table, count, replace=False))


def with_companions(names: Sequence[str]) -> tuple[str, ...]:
    """The names and, before them, what they need."""
    return (*(COMPANIONS[name] for name in names if name in COMPANIONS and COMPANIONS[name] not in names), *names)


def law_of_trial(stratum: str, options: Options, random: np.random.Generator) -> str:
    """Kind of friction law; `exact` means Maxwell elements that the user knows."""
    drawn = str(random.choice(LAWS[1:])) if random.random() < 0.5 else "maxwell"
    other = str(random.choice(LAWS[1:]))
    if options.ground is not None:
        return "maxwell"
    if options.law is not None:
        return options.law
    if stratum in ("null-exact", "null-parameters"):
        return "maxwell"
    return other if stratum == "null-law" else drawn


def offset_of_trial(stratum: str, options: Options, random: np.random.Generator) -> float:
    """How far the user's values may be off, as a share."""
    size, coin = float(random.uniform(0.10, 0.15)), bool(random.random() < 0.5)
    if options.offsets is not None:
        return size if options.offsets else 0.0
    if stratum in ("null-exact", "null-law"):
        return 0.0
    return size if stratum == "null-parameters" or coin else 0.0


def sane(rig: Rig, rows: dict[str, Rows], captures: Sequence[Capture], seed: int) -> bool:
    """Whether the loop stays in its bounds and calm, jitter and all."""
    for capture in captures:
        experiment = capture.experiment
        if capture.repeat > 1 or experiment.name in UNCHECKED:
            continue
        noise = quiet_noise(rig, experiment.reference.size, seed)
        setting = Setting(substeps=10, start=capture.start)
        trace = simulated(ideal(rig.machine), rig.loop, rows[experiment.name], noise, setting)
        rough = float(np.sqrt(np.mean(np.diff(trace.command - experiment.injection) ** 2)))
        if trace.lost or float(np.abs(trace.command).max()) > LARGEST_COMMAND:
            return False
        if experiment.name in CALM and rough > ROUGHEST_COMMAND:
            return False
    return True


def quiet_noise(rig: Rig, n: int, seed: int) -> Noise:
    """No noise; a bus that jitters still does."""
    return silent(n)._replace(late=noise_of(rig.machine, n, np.random.default_rng([seed, 5])).late)


def with_effects(rig: Rig, names: Sequence[str], scales: Sequence[float], seed: int, where: Around) -> Rig:
    """The rig with these effects."""
    for name, scale in zip(names, scales, strict=True):
        rig = applied(name, rig, draw_of(name, seed, scale, where))
    return rig


def draw(seed: int, stratum: str, options: Options = Options()) -> Trial:  # noqa: B008  an immutable default
    """A trial: the same seed, stratum and options give the same trial, to the last bit."""
    random = np.random.default_rng([seed, STRATA.index(stratum)])
    law, off = law_of_trial(stratum, options, random), offset_of_trial(stratum, options, random)
    chosen = names_of(stratum, options, np.random.default_rng([seed, STRATA.index(stratum), 9]))
    names = with_companions(chosen)
    machine = on(stage(law, random), options.ground)
    machine = machine._replace(speed=machine.speed._replace(limits=bool(random.random() < 0.5)))
    model = believed(machine, random, off)
    loop = designed(model, 40.0, machine.drive.lag)
    captures = session(experiments_of(seed, stratum, options.short))
    rows = prepared_rows(model, loop, captures)
    where, plain = around(rows, captures), Rig(machine, loop)
    drawn = [options.scale if options.scale is not None else float(random.choice([1.0, 2.0])) for _ in names]
    wanted = [size if name in chosen else COMPANION_SCALE for name, size in zip(names, drawn, strict=True)]
    scales = list(wanted)
    for _ in range(ATTEMPTS):
        rig = with_effects(plain, names, scales, seed, where)
        if sane(rig, rows, captures, seed):
            break
        scales = [SMALLER * scale for scale in scales]
    else:
        raise RuntimeError(f"seed {seed}, {stratum}, {names}: no stable size found down to scale {scales}")
    rest = [
        with_effects(plain, [*names[:k], *names[k + 1 :]], [*scales[:k], *scales[k + 1 :]], seed, where)
        for k in range(len(names))
    ]
    hidden = tuple(
        Hidden(name, asked, scale, (EFFECTS.get(name) or ALIENS[name]).seen_in, name not in chosen)
        for name, asked, scale in zip(names, wanted, scales, strict=True)
    )
    return Trial(seed, stratum, rig, model, loop, hidden, tuple(rest), captures, law, rows)


def at_rest(trial: Trial, capture: Capture) -> Floats:
    """Contact as the move before this experiment left it: the same in each repeat."""
    kinds = sorted({captured.experiment.name for captured in trial.captures})
    random = np.random.default_rng([trial.seed, 7, kinds.index(capture.experiment.name)])
    if trial.rig.machine.law.kind != MAXWELL:
        return np.zeros(MEMORY)
    return remanent(trial.rig.machine, float(random.choice([-1.0, 0.0, 1.0])))


def noisy(trial: Trial, number: int) -> Trace:
    """Capture `number` as it was recorded."""
    capture, machine = trial.captures[number], trial.rig.machine
    rows = trial.rows[capture.experiment.name]
    noise = noise_of(machine, rows.target.size, np.random.default_rng([trial.seed, 3, number]))
    return simulated(
        machine, trial.rig.loop, rows, noise, Setting(start=capture.start, remanent=at_rest(trial, capture))
    )
