"""Repeats of one motion that compare layers.

::

    repeat 1: ptc, off, ptc+ilc    repeat 2: ptc+ilc, ptc, off    ...   --> comparison.verdict
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast, get_args

from stagectl import paired_comparison
from stagectl.compensation.forms import FORMS, named
from stagectl.config.stage_file import Setup
from stagectl.design import Layer
from stagectl.problem import Problem, ProblemKind, nearest
from stagectl.recording.learned_current import Learned, LearnedError, check, load, save
from stagectl.service.single_motion import Motion
from stagectl.typed_json import plain
from stagectl.workflows.motion import Commanded, blank, lay_out, with_current
from stagectl.workflows.trials import Machine, Result, Shown, TrialError, after, learn, learned_words, ready, run_once

ILC, OFF, FRICTION = "ilc", "off", "friction"
LAYERS = (*get_args(Layer), ILC)
NAMES = (*LAYERS, *FORMS)  # a compensator's name is the layer `friction` with that compensator


def chosen(name: str) -> list[str]:
    """``ptc+friction`` as its layers, ``ptc+table`` with one compensator of several; ``off`` has none.

    Raises TrialError naming those there are.
    """
    layers = [] if name == OFF else name.split("+")
    for layer in layers:
        if layer not in NAMES:
            near = nearest(layer, (OFF, *NAMES))
            hint = f"did you mean {near}?" if near else f"write {OFF}, or some of {', '.join(NAMES)} with +"
            if "," in layer:
                hint = f"blanks separate variants: {' '.join(name.replace(',', ' ').split())}"
            raise TrialError(f"{name}: no layer {layer!r}: {hint}")
    if len(set(layers)) < len(layers):
        raise TrialError(f"{name}: a layer stands there twice")
    if len(compensators := [layer for layer in layers if layer == FRICTION or layer in FORMS]) > 1:
        raise TrialError(f"{name}: {' and '.join(compensators)} compensate the same friction; take one of them")
    return layers


def laid_out(setup: Setup, trajectory: Commanded, names: Sequence[str], folder: Path) -> dict[str, Motion]:
    """The motion of each variant by its name, with its layers whatever the stage file says; ``ilc`` comes later.

    Raises TrialError where the names are wrong.
    """
    layers = {name: chosen(name) for name in names}
    if len(set(map(frozenset, layers.values()))) < max(2, len(names)):
        if not names:
            raise TrialError(
                Problem("name at least two variants, such as 'off', 'ptc'", ProblemKind.MISSING, "variants")
            )
        raise TrialError(f"{' '.join(names)}: at least two variants, each once; for example off ptc ptc+friction")
    return {name: _laid_out(setup, trajectory, layers[name], folder) for name in names}


def _laid_out(setup: Setup, trajectory: Commanded, layers: list[str], folder: Path) -> Motion:
    running = tuple(FRICTION if layer in FORMS else layer for layer in layers if layer != ILC)
    control = setup.file.control._replace(layers=cast("tuple[Layer, ...]", running))
    file = setup.file._replace(control=control)
    for layer in layers:
        if layer in FORMS:
            file = file._replace(compensation=_compensator(setup, layer))
    motion = lay_out(setup._replace(file=file), trajectory, frozenset(), folder / "run.h5")
    return motion._replace(meta={**motion.meta, "layers": sorted(layer for layer in layers if layer != ILC)})


def _compensator(setup: Setup, name: str) -> Any:
    """The compensator of the stage file with this name.  Raises TrialError where there is none."""
    compensator = named(name, setup.file.compensation, setup.file.compensators)
    if compensator is None:
        raise TrialError(
            f"compensators.{name} is not in {setup.path}; `stagectl identify simultaneous {setup.path} CAPTURE "
            f"--compensators {name} --write {setup.path}` makes it"
        )
    return compensator


def learn_missing(
    machine: Machine, motions: dict[str, Motion], files: list[Path], trials: int, shown: Shown
) -> list[Result]:
    """Add the learned current to the `motions` with ``ilc``: from `files`, else learned now in so many `trials`.

    Returns how those have learned that did.  Raises LearnedError where a file fits no variant.
    """
    learned, courses = _matched(files, motions), []
    for name, motion in motions.items():
        if ILC in chosen(name) and name not in learned:
            shown.say(f"{name} learns first")
            folder = motion.recording.parent
            course = learn(machine, motion, trials, shown, folder / f"learn-{name}")
            learned[name] = course.pop("current")
            save(folder / f"learned-{name}.h5", learned[name])
            courses.append({**course, "name": name})
    for name, current in learned.items():
        meta = {**motions[name].meta, "layers": [*motions[name].meta["layers"], ILC]}
        motions[name] = with_current(motions[name], current.current)._replace(meta=meta)
    return courses


def _matched(files: list[Path], motions: dict[str, Motion]) -> dict[str, Learned]:
    """Which variant each learned current belongs to, by its layers."""
    matched: dict[str, Learned] = {}
    for path in files:
        current = load(path)
        layers = current.meta["layers"]
        name = next((name for name in motions if ILC in chosen(name) and motions[name].meta["layers"] == layers), None)
        if name is None:
            known = ", ".join(motions)
            raise LearnedError(f"{path} was learned for {'+'.join([*layers, ILC])}, which is not among {known}: add it")
        check(path, current, blank(motions[name]))
        matched[name] = current
    return matched


def compare(machine: Machine, motions: dict[str, Motion], plan: tuple[int, int], shown: Shown, folder: Path) -> Result:
    """Run all variants in each of `plan` = (repeats, seed), interleaved; figures, differences and verdict.

    Raises TrialError where a run is stopped, or has no tracking error.
    """
    blocks = paired_comparison.order(list(motions), *plan)
    runs: dict[str, list[Result]] = {name: [] for name in motions}
    count = len(next(iter(motions.values())).plan.setpoints)
    done, total = 0, len(blocks) * len(motions) * count
    with ready(machine, shown), shown.bar(f"compare {len(motions)} variants", total) as update:
        for number, block in enumerate(blocks, 1):
            for name in block:
                motion = motions[name]._replace(recording=folder / f"repeat-{number}-{name}.h5")
                run = run_once(machine.noisy(number), motion, after(done, total, update))
                if run["tracking_error"]["peak"] is None:
                    raise TrialError(f"{run['trajectory']} has no tracking error to compare: its loop is open")
                runs[name].append(run)
                done += count
    return _compared(runs, blocks)


def _compared(all_runs: dict[str, list[Result]], blocks: list[list[str]]) -> Result:
    figures = [
        paired_comparison.Figures.of(name, [run["tracking_error"] for run in runs]) for name, runs in all_runs.items()
    ]
    recordings = [[run["recording"] for run in runs] for runs in all_runs.values()]
    any_run = next(iter(all_runs.values()))[0]
    unit, lowest = any_run["unit"], paired_comparison.best(figures)
    return {
        "stage": any_run["stage"],
        "trajectory": any_run["trajectory"],
        "unit": unit,
        "variants": [
            {"name": figure.name, **figure.as_json(), "recordings": paths}
            for figure, paths in zip(figures, recordings, strict=True)
        ],
        "order": blocks,
        "identical": paired_comparison.identical(figures),
        "best": lowest.name,
        "against_first": _against(figures, figures[0]),
        "against_best": _against(figures, lowest),
        "verdict": paired_comparison.verdict(figures, unit),
    }


def _against(figures: list[paired_comparison.Figures], other: paired_comparison.Figures) -> Result:
    """Differences in both measures; None stands where repeats cannot tell."""
    differences: Result = {"other": other.name}
    for measure in ("peak", "rms"):
        rows = paired_comparison.differences(figures, other, measure)
        differences[measure] = [{**plain(row), "certain": row.certain} for row in rows]
    return differences


def course_words(courses: list[Result]) -> list[str]:
    """How each variant learned."""
    return [
        f"{course['name']} learned from {len(course['trials'])} trials: {learned_words(course)}." for course in courses
    ]
