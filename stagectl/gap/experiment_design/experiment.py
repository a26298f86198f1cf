"""One experiment: a motion made for a stage, and what it separates."""

import functools
import textwrap
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, get_type_hints

import numpy as np
import yaml
from numpy.typing import NDArray

from stagectl import trajectories
from stagectl.config.stage_file import Setup
from stagectl.gap.effects.library import excited_by
from stagectl.gap.experiment_design.motions import CarriedMultisine, carried, preconditioned
from stagectl.gap.experiment_design.stage_scale import StageScale
from stagectl.plan import SETTLE, plan
from stagectl.trajectories import CURRENTS, TYPES, Excited, Sequence, Sum, Trajectory, phases
from stagectl.units import Quantity, quantity_of

DIAGNOSE, HELD_OUT = "diagnose", "held-out"


class Experiment(NamedTuple):
    """A motion that separates effects."""

    name: str  # also of its file
    separates: str  # in words, for its user
    effects: tuple[str, ...]  # names of the library that it bears on
    trajectory: trajectories.Experiment
    unit: str = "m"  # of travel
    use: str = DIAGNOSE

    @property
    def duration(self) -> float:
        """Machine time (s), the standstill at its end included."""
        return phases(self.trajectory).duration + SETTLE

    def setpoints(self, setup: Setup) -> NDArray[np.float64]:
        """Rows (n, 8) of `kernels.law.Setpoint` on this stage, under the layers of its file.

        Raises TrajectoryError where the stage's limits do not allow it.
        """
        return plan(setup, self.trajectory, setup.controller.feedforward).setpoints


class Recipe(NamedTuple):
    """An experiment before it is made for a stage."""

    separates: str  # in words, for its user
    motion: Callable[[StageScale], tuple[Trajectory, ...] | Excited]
    family: str = ""  # the name by which the records of the effects list it; empty: its own


def made(p: StageScale, recipes: Mapping[str, Recipe], use: str = DIAGNOSE) -> tuple[Experiment, ...]:
    """Experiments for a stage of this scale; motions without a current begin with a preconditioning reversal."""
    experiments = []
    for name, (separates, motion, family) in recipes.items():
        parts = motion(p)
        trajectory = parts if isinstance(parts, Excited) else preconditioned(p, *parts)
        experiments.append(Experiment(name, separates, excited_by(family or name), trajectory, p.unit, use))
    return tuple(experiments)


def multisines(name: str, words: str, seed: int, periods: float) -> dict[str, Recipe]:
    """A multisine on a moving axis at three places of the stroke, each with phases of its own from `seed` on."""
    places = (("low", "low end", 0.05), ("middle", "middle", 0.375), ("high", "high end", 0.7))
    injections = [CarriedMultisine(place, seed + k, periods=periods) for k, (_, _, place) in enumerate(places)]
    return {
        f"{name}-{end}": Recipe(words.format(where), functools.partial(carried, injection=injection), name)
        for (end, where, _), injection in zip(places, injections, strict=True)
    }


def yaml_of(experiment: Experiment) -> str:
    """The trajectory file of `experiment`, as `run` takes it."""
    use = "; held out, to check what was found" if experiment.use == HELD_OUT else ""
    bears = f"Bears on {', '.join(experiment.effects)}." if experiment.effects else ""
    comments = (f"{experiment.name}, {experiment.duration:.3g} s{use}.", experiment.separates, bears)
    return text_of(experiment.trajectory, tuple(filter(None, comments)), experiment.unit)


_NAMES: dict[type, str] = {
    **{kind: name for name, kind in TYPES.items()},
    **{kind: name for name, kind in CURRENTS.items()},
    Excited: "excited",
}
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"))
_LONGEST = 118  # characters of a comment
_ONE_LINE = 10_000  # characters, more than any part has


def text_of(experiment: trajectories.Experiment, comments: tuple[str, ...], unit: str) -> str:
    """YAML of `experiment` below its `comments`; its lengths are in `unit` (m | rad) of travel."""
    header = [f"# {line}" for comment in comments for line in textwrap.wrap(comment, _LONGEST - 2)]
    block = yaml.safe_dump(_entries(experiment, unit), sort_keys=False, default_flow_style=None, width=_ONE_LINE)
    return "\n".join([*header, block])


def _entries(block: Any, unit: str) -> dict[str, Any]:
    """Type and fields of a block as text; fields at their default are left out.

    Raises KeyError where the block is of a kind that files are not written from.
    """
    if isinstance(block, Sequence | Sum):
        return {"type": _NAMES[type(block)], "parts": [_entries(part, unit) for part in block.parts]}
    hints, defaults = get_type_hints(type(block), include_extras=True), block._field_defaults
    shown = {
        name: _value(value, quantity_of(hints[name]), unit)
        for name, value in block._asdict().items()
        if name not in defaults or value != defaults[name]
    }
    return {"type": _NAMES[type(block)], **shown}


def _value(value: Any, quantity: Quantity | None, unit: str) -> Any:
    if hasattr(value, "_fields"):
        return _entries(value, unit)
    if isinstance(value, tuple):
        return [_value(item, quantity, unit) for item in value]
    if isinstance(value, float) and (quantity is None or not quantity.unit):
        plain = float(f"{value:.12g}")
        return int(plain) if plain.is_integer() else plain
    if quantity is None or not quantity.unit:
        return value
    return number(value, _of_travel(quantity.unit, unit))


def _of_travel(unit: str, travel: str) -> str:
    """``m/s`` of an axis whose travel is an angle is ``rad/s``."""
    return travel + unit[1:] if unit.split("/")[0] == "m" else unit


def number(value: float, unit: str) -> str:
    """`value` with its `unit`, and the prefix that a person would take for a length: ``12.3 mm/s``."""
    prefixes = _PREFIXES if unit.split("/")[0] == "m" else _PREFIXES[:1]
    scale, prefix = next(((scale, prefix) for scale, prefix in prefixes if abs(value) >= 0.9995 * scale), _PREFIXES[0])
    return f"{value / scale:.12g} {prefix}{unit}"
