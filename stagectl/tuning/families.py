"""All designs of one law for one stage: a bandwidth f chooses among them, the rest follows by a stated rule.

**PID**: all four closed-loop poles at ``-2 pi f`` (`kernels.feedback`).

**Cascade**: f is the bandwidth of the position loop, and the loops are separated by ratios::

    Kp = 2 pi f        velocity bandwidth fv = 4 f        Ti = 4 / (2 pi fv)        Tf = 1 / (5 * 2 pi fv)

With fv = 4 f the position loop is critically damped on a velocity loop of first order.  Ti is the symmetric optimum's
for a = 4, which costs ``atan(1/4)`` = 14 deg at the velocity loop's crossover; the filter's corner, five times above,
costs ``atan(1/5)`` = 11 deg.  A filter with its corner above Nyquist's frequency is left out.

Source: C. Kessler, Regelungstechnik 6, 1958 (symmetric optimum).
"""

import math
from typing import Any, NamedTuple

from stagectl import design
from stagectl.kernels import stage
from stagectl.tuning import constants
from stagectl.tuning.robustness import Loop, Robustness, loops, robustness
from stagectl.units import StageError

LAWS: dict[str, type[design.Settings]] = {"pid": design.Control, "cascade": design.CascadeControl}


class Nearest(NamedTuple):
    """The nearest design that is possible, for a user who demanded another one."""

    words: str
    bandwidth: float | None = None  # Hz; None where no bandwidth is stable
    margin: float | None = None  # deg, where the demanded margin is not possible


class TuningError(StageError):
    """No design of this law meets the demand."""

    def __init__(
        self,
        message: str,
        *,
        option: str,
        value: float | str | None = None,
        admissible: str = "",
        nearest: Nearest | None = None,
    ) -> None:
        super().__init__(message)
        self.option = option  # that is refused: bandwidth, margin, start
        self.value = value  # Hz, of a bandwidth; rad, of a margin
        self.admissible = admissible  # interval, or names
        self.nearest = nearest


class Ratios(NamedTuple):
    """Ratios of a cascade to its position loop's bandwidth; 0 leaves the part out."""

    separation: float = constants.SEPARATION  # velocity bandwidth over that of the position loop
    integral: float = constants.INTEGRAL  # integral time over 1/(2 pi fv)
    filtering: float = constants.FILTERING  # corner of the force filter over fv


class Family(NamedTuple):
    """All designs of one law for one stage."""

    stage: stage.Stage
    control: design.Settings  # of that law, with the entries that the bandwidth does not choose
    ratios: Ratios = Ratios()


def law_of(control: design.Settings) -> str:
    """Name of the law."""
    return "pid" if isinstance(control, design.Control) else "cascade"


def family(p: stage.Stage, control: design.Settings, law: str, own: bool = False) -> Family:
    """Designs of `law`, with layers and margin of `control`; `own`: with its ratios instead of the rule's.

    Raises TuningError where `own` ratios are requested and `control` has none.
    """
    if own and (isinstance(control, design.Control) or law == "pid"):
        text = f"--start own; must be rule: a {law} control takes no ratios from a {law_of(control)} one"
        raise TuningError(text, option="start", value="own", admissible="rule")
    ratios = ratios_of(control) if own and isinstance(control, design.CascadeControl) else Ratios()
    return Family(p, as_law(control, law), ratios)


def as_law(control: design.Settings, law: str) -> design.Settings:
    """`control`, or one of the other law with the entries that both have; default layers become the other law's."""
    kind = LAWS[law]
    if isinstance(control, kind):
        return control
    known: dict[str, Any] = {name: getattr(control, name) for name in kind._fields if name in control._fields}
    if control.layers == type(control)._field_defaults["layers"]:
        del known["layers"]
    start = {"bandwidth": 1.0} if kind is design.Control else {"position_gain": 1.0, "velocity_bandwidth": 1.0}
    converted: design.Settings = kind(**{**start, **known})
    return converted


def ratios_of(control: design.CascadeControl) -> Ratios:
    """The ratios of a cascade."""
    corner = 2.0 * math.pi * control.velocity_bandwidth
    filtering = 1.0 / (control.force_filter * corner) if control.force_filter > 0.0 else 0.0
    return Ratios(corner / control.position_gain, control.integral_time * corner, filtering)


def chosen(family: Family, bandwidth: float) -> design.Settings:
    """The control of this `bandwidth` (Hz); the entries that follow from it have four digits, as they are written."""
    if isinstance(family.control, design.Control):
        return family.control._replace(bandwidth=bandwidth)
    ratios = family.ratios
    corner = 2.0 * math.pi * ratios.separation * bandwidth
    nyquist = math.pi / family.control.period
    filtered = 0.0 < ratios.filtering * corner < nyquist
    return family.control._replace(
        position_gain=_digits(2.0 * math.pi * bandwidth),
        velocity_bandwidth=_digits(ratios.separation * bandwidth),
        integral_time=_digits(ratios.integral / corner),
        force_filter=_digits(1.0 / (ratios.filtering * corner)) if filtered else 0.0,
    )


def _digits(value: float) -> float:
    return float(f"{value:.4g}")


def reached(p: stage.Stage, control: design.Settings) -> dict[str, Robustness]:
    """Robustness of each loop of this control, with its disturbance observer.

    Raises DesignError where its gains cannot be realised.
    """
    return {name: robustness(loop) for name, loop in judged_loops(p, control).items()}


def judged_loops(p: stage.Stage, control: design.Settings) -> dict[str, Loop]:
    """The loops whose margins count; with an observer also the loop without it, as that layer may be switched off.

    Raises DesignError where the gains cannot be realised.
    """
    designed, dt, watching = design.loop_parts(p, control)
    with_observer = loops(p, designed, dt, watching)
    if not watching.active:
        return with_observer
    return with_observer | {"without observer": next(iter(loops(p, designed, dt).values()))}
