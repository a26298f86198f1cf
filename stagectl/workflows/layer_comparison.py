"""Repeats of one motion that compare layers.

::

    repeat 1: ptc, off, ptc+ilc    repeat 2: ptc+ilc, ptc, off    ...   --> comparison.verdict
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from stagectl import paired_comparison
from stagectl.config.stage_file import Setup
from stagectl.design import Layer
from stagectl.recording.learned_current import Learned, LearnedError, check, load, save
from stagectl.service.single_motion import Motion, Progress
from stagectl.workflows.motion import Commanded, blank, lay_out, with_current
from stagectl.workflows.trials import Machine, Result, Shown, TrialError, after, learn, learned_words, ready, run_once

ILC, OFF = "ilc", "off"


class ComparisonRequest(NamedTuple):
    """What the user wants compared."""

    trajectory: Commanded
    names: list[str]  # off, ptc, ptc+friction ...; the first is what the others are compared with
    layers: tuple[str, ...]  # that there are, beside ilc
    trials: int  # to learn from, where a variant learns
    learned: list[Path]  # what has been learned before


class Variant(NamedTuple):
    """One choice of layers, ready to run."""

    name: str
    motion: Motion


def chosen(name: str, known: tuple[str, ...]) -> list[str]:
    """``ptc+friction`` as its layers; ``off`` has none.

    Raises TrialError naming those there are.
    """
    layers = [] if name == OFF else name.split("+")
    for layer in layers:
        if layer not in (*known, ILC):
            raise TrialError(f"{name}: no layer {layer!r}; write {OFF}, or some of {', '.join((*known, ILC))} with +")
    if len(set(layers)) < len(layers):
        raise TrialError(f"{name}: a layer stands there twice")
    return layers


def variants(
    machine: Machine, request: ComparisonRequest, shown: Shown, folder: Path
) -> tuple[list[Variant], list[Result]]:
    """Each variant laid out, and how those with ``ilc`` learned; recordings of that go to `folder`.

    Raises TrialError where the names are wrong, LearnedError where a learned current fits no variant.
    """
    if len(set(map(frozenset, (chosen(name, request.layers) for name in request.names)))) < max(2, len(request.names)):
        raise TrialError(
            f"{' '.join(request.names)}: at least two variants, each once; for example off ptc ptc+friction"
        )
    laid_out = {name: _laid_out(machine.setup, request, name, folder) for name in request.names}
    files = _matched(request, laid_out)
    laid_out_variants, courses = [], []
    for name, motion in laid_out.items():
        if ILC not in chosen(name, request.layers):
            laid_out_variants.append(Variant(name, motion))
        elif name in files:
            laid_out_variants.append(Variant(name, _with(motion, files[name])))
        else:
            shown.say(f"{name} learns first")
            course = learn(machine, motion, request.trials, shown, folder / f"learn-{name}")
            current = course.pop("current")
            save(folder / f"learned-{name}.h5", current)
            courses.append({**course, "name": name})
            laid_out_variants.append(Variant(name, _with(motion, current)))
    return laid_out_variants, courses


def _laid_out(setup: Setup, request: ComparisonRequest, name: str, folder: Path) -> Motion:
    """The motion with the layers of `name`, whatever the stage file says; ``ilc`` comes later."""
    layers = tuple(layer for layer in chosen(name, request.layers) if layer != ILC)
    control = setup.file.control._replace(layers=cast("tuple[Layer, ...]", layers))
    changed = setup._replace(file=setup.file._replace(control=control))
    return lay_out(changed, request.trajectory, frozenset(), folder / "run.h5")


def _with(motion: Motion, current: Learned) -> Motion:
    meta = {**motion.meta, "layers": [*motion.meta["layers"], ILC]}
    return with_current(motion, current.current)._replace(meta=meta)


def _matched(request: ComparisonRequest, laid_out: dict[str, Motion]) -> dict[str, Learned]:
    """Which variant each learned current belongs to, by its layers."""
    matched: dict[str, Learned] = {}
    for path in request.learned:
        current = load(path)
        fitting = [
            name
            for name, motion in laid_out.items()
            if ILC in chosen(name, request.layers) and motion.meta["layers"] == current.meta["layers"]
        ]
        if not fitting:
            layers = "+".join([*current.meta["layers"], ILC])
            raise LearnedError(
                f"{path} was learned for {layers}, which is not among {', '.join(request.names)}: add it"
            )
        check(path, current, blank(laid_out[fitting[0]]))
        matched[fitting[0]] = current
    return matched


def compare(machine: Machine, ready_to_run: list[Variant], plan: tuple[int, int], shown: Shown, folder: Path) -> Result:
    """Run all variants in each of `plan` = (repeats, seed), interleaved; figures, differences and verdict.

    Raises TrialError where a run is stopped, or has no tracking error.
    """
    names, motions = [variant.name for variant in ready_to_run], dict(ready_to_run)
    blocks = paired_comparison.order(names, *plan)
    runs: dict[str, list[Result]] = {name: [] for name in names}
    count = len(ready_to_run[0].motion.plan.setpoints)
    done, total = 0, len(blocks) * len(names) * count
    with ready(machine, shown), shown.bar(f"compare {len(names)} variants", total) as update:
        for number, block in enumerate(blocks, 1):
            for name in block:
                motion = motions[name]._replace(recording=folder / f"repeat-{number}-{name}.h5")
                runs[name].append(_repeat(machine.noisy(number), motion, after(done, total, update)))
                done += count
    return _compared(runs, blocks)


def _repeat(machine: Machine, motion: Motion, update: Progress) -> Result:
    result = run_once(machine, motion, update)
    if result["tracking_error"]["peak"] is None:
        raise TrialError(f"{result['trajectory']} has no tracking error to compare: its loop is open")
    return result


def _compared(all_runs: dict[str, list[Result]], blocks: list[list[str]]) -> Result:
    figures = [
        paired_comparison.Figures(name, _each(runs, "peak"), _each(runs, "rms")) for name, runs in all_runs.items()
    ]
    any_run = next(iter(all_runs.values()))[0]
    unit, lowest = any_run["unit"], paired_comparison.best(figures)
    return {
        "stage": any_run["stage"],
        "trajectory": any_run["trajectory"],
        "unit": unit,
        "variants": [_variant(figure, all_runs[figure.name]) for figure in figures],
        "order": blocks,
        "identical": paired_comparison.identical(figures),
        "best": lowest.name,
        "against_first": _against(figures, figures[0]),
        "against_best": _against(figures, lowest),
        "verdict": paired_comparison.verdict(figures, unit),
    }


def _each(runs: list[Result], measure: str) -> NDArray[np.float64]:
    return np.array([run["tracking_error"][measure] for run in runs])


def _variant(figure: paired_comparison.Figures, runs: list[Result]) -> Result:
    measures = {"peak": figure.peak, "rms": figure.rms}
    figures = {name: {"mean": float(np.mean(x)), "values": x.tolist()} for name, x in measures.items()}
    return {"name": figure.name, **figures, "recordings": [run["recording"] for run in runs]}


def _against(figures: list[paired_comparison.Figures], other: paired_comparison.Figures) -> Result:
    """Differences in both measures; None stands where repeats cannot tell."""
    differences: Result = {"other": other.name}
    for measure in ("peak", "rms"):
        rows = paired_comparison.differences(figures, other, measure)
        differences[measure] = [{**_finite(row._asdict()), "certain": row.certain} for row in rows]
    return differences


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    return {key: None if value != value else value for key, value in values.items()}


def course_words(courses: list[Result]) -> list[str]:
    """How each variant learned."""
    return [
        f"{course['name']} learned from {len(course['trials'])} trials: {learned_words(course)}." for course in courses
    ]
