"""The page of a tuned controller: Bode, sensitivities, Nyquist, step, stiffness, and other bandwidths."""

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stagectl.config.stage_file import Setup
from stagectl.design import DesignError
from stagectl.report import interactive
from stagectl.report.constants import BODE_RANGE, RESPONSE_POINTS
from stagectl.report.figures import FAINT, TARGET, WITH, WITHOUT, drawing, note
from stagectl.report.page import Page
from stagectl.report.tables.tuning import tables
from stagectl.tuning.families import chosen, judged_loops
from stagectl.tuning.robustness import Loop, Robustness, robustness, softest, stiffness
from stagectl.tuning.search import Tuned
from stagectl.tuning.sheet import ClosedLoop, closed, headline, notes, step, stiffness_unit
from stagectl.units import quantities_of

Array = NDArray[Any]
COLOURS = (TARGET, WITH, "#7c3aed", FAINT)  # of the loops, the one cut at the current first
WIDTH, HEIGHT = 5.4, 4.0


def page(setup: Setup, tuned: Tuned, command: str) -> Page:
    """The page of a tuned controller; `command` repeats the tuning."""
    return Page(
        f"stagectl tune: {setup.file.name}",
        headline(tuned),
        [_loop(setup), *notes(tuned)],
        [interactive.picture(draw(), _CAPTIONS[name]) for name, draw in drawings(setup, tuned).items()],
        tables(setup, tuned),
        [command],
    )


def _loop(setup: Setup) -> str:
    p, kind = setup.stage, setup.file.axis.kind
    return (
        f"The loop as it runs: Ts {setup.dt * 1e3:g} ms, nd {p.drive.delay_samples} and nm {p.encoder.delay_samples} "
        f"periods of delay, current lag {p.drive.current_lag * 1e3:.3g} ms, zero-order hold; "
        f"inertia {_declared(p.mechanics, 'inertia', kind)}, viscous {_declared(p.mechanics, 'viscous', kind)}, "
        f"force constant {_declared(p.motor, 'force_constant', kind)}."
    )


def _declared(block: Any, name: str, kind: str) -> str:
    """A parameter with the unit that its block declares for this `kind` of axis."""
    return f"{getattr(block, name):.4g} {quantities_of(type(block))[name].unit_for(kind)}".rstrip()


_CAPTIONS = {
    "bandwidths": "The recommendation, and other bandwidths by the same rule: phase margin and Ms, grey where refused, "
    "and what bandwidth buys, the least dynamic stiffness.",
    "bode": "Open loop L, one line per loop. Marked: phase margin PM, gain margins GM.",
    "sensitivities": "Sensitivity S = 1/(1 + L), its peak Ms, and T = L/(1 + L).",
    "nyquist": "Nyquist plot near -1; the circle has the radius 1/Ms, the modulus margin.",
    "step": "Step of the target, sampled loop, without any feedforward.",
    "stiffness": "Dynamic stiffness against an effort on the axis, without friction.",
}


def drawings(setup: Setup, tuned: Tuned) -> dict[str, Callable[[], Figure]]:
    """What draws each figure of the design, by its name."""
    loops = judged_loops(setup.stage, tuned.control)
    closed_loop = functools.cache(lambda: closed(setup, tuned))
    return {
        "bandwidths": lambda: other_bandwidths(setup, tuned, closed_loop()),
        "bode": lambda: bode(loops, tuned),
        "sensitivities": lambda: sensitivities(loops, tuned),
        "nyquist": lambda: nyquist(loops, tuned),
        "step": lambda: response(setup, tuned, closed_loop()),
        "stiffness": lambda: dynamic_stiffness(setup, loops, closed_loop()),
    }


def _frequencies(loop: Loop, tuned: Tuned) -> Array:
    return np.geomspace(min(0.02 * tuned.bandwidth, 0.01 / loop.dt), 0.5 / loop.dt, RESPONSE_POINTS)


def bode(each: dict[str, Loop], tuned: Tuned) -> Figure:
    """Gain and phase of the open loops; the margins of the one that is cut at the current are marked."""
    with drawing(2, 1, figsize=(WIDTH, HEIGHT), sharex=True) as (figure, (size, phase)):
        for (name, loop), colour in zip(each.items(), COLOURS, strict=False):
            f = _frequencies(loop, tuned)
            values = loop.at(f)
            size.semilogx(f, _db(values), color=colour, linewidth=1.2, label=name)
            phase.semilogx(f, _unwrapped(values), color=colour, linewidth=1.2)
        _mark(size, phase, next(iter(tuned.reached.values())))
        size.axhline(0.0, color=FAINT, linewidth=0.8)
        size.set(ylim=BODE_RANGE, ylabel="|L| [dB]")
        phase.axhline(-180.0, color=FAINT, linewidth=0.8)
        phase.set(ylim=(-360.0, -45.0), yticks=[-360, -270, -180, -90], ylabel="phase of L [deg]")
        _frequency_axis(phase)
        if len(each) > 1:
            size.legend(fontsize=8)
    return figure


def _mark(size: Axes, phase: Axes, loop: Robustness) -> None:
    degrees = math.degrees(loop.phase)
    phase.vlines(loop.crossover, -180.0, degrees - 180.0, color=WITHOUT, linewidth=2.0)
    note(phase, f"PM {degrees:.1f}°", (loop.crossover, degrees - 180.0), (4, 6))
    for peak in (loop.raised, loop.lowered):
        if peak.frequency > 0.0:
            level = -20.0 * math.log10(peak.value)
            size.vlines(peak.frequency, min(level, 0.0), max(level, 0.0), color=WITHOUT, linewidth=2.0)
            note(size, f"GM {-level:+.1f} dB", (peak.frequency, max(level, 0.0)), (4, 4 if level < 0.0 else 0))


def sensitivities(each: dict[str, Loop], tuned: Tuned) -> Figure:
    """|S| and |T| of the loop that is cut at the current."""
    loop, reached = next(iter(each.values())), next(iter(tuned.reached.values()))
    with drawing(figsize=(WIDTH, HEIGHT)) as (figure, axes):
        f = _frequencies(loop, tuned)
        values = loop.at(f)
        axes.semilogx(f, _db(1.0 / (1.0 + values)), color=TARGET, linewidth=1.4, label="|S|")
        axes.semilogx(f, _db(values / (1.0 + values)), color=WITH, linewidth=1.4, label="|T|")
        for peak, name, colour, offset in (
            (reached.sensitivity, "Ms", TARGET, (6, 9)),
            (reached.complementary, "Mt", WITH, (-44, 9)),
        ):
            level = 20.0 * math.log10(peak.value)
            axes.plot(peak.frequency, level, "o", color=colour, markersize=4)
            note(axes, f"{name} {peak.value:.2f}", (peak.frequency, level), offset, colour)
        if math.isfinite(tuned.demand.peak):
            bound = 20.0 * math.log10(tuned.demand.peak)
            axes.axhline(bound, color=WITHOUT, linewidth=1.0, linestyle="--", label=f"Ms = {tuned.demand.peak:g}")
        axes.axhline(0.0, color=FAINT, linewidth=0.8)
        axes.set(ylim=(-40.0, max(12.0, 20.0 * math.log10(reached.sensitivity.value) + 4.0)), ylabel="gain [dB]")
        _frequency_axis(axes)
        axes.legend(fontsize=8, loc="lower left")
    return figure


def nyquist(each: dict[str, Loop], tuned: Tuned) -> Figure:
    """The open loops near -1, with the circle of the modulus margin."""
    modulus = next(iter(tuned.reached.values())).modulus
    with drawing(figsize=(WIDTH, HEIGHT)) as (figure, axes):
        for (name, loop), colour in zip(each.items(), COLOURS, strict=False):
            values = loop.at(_frequencies(loop, tuned))
            axes.plot(values.real, values.imag, color=colour, linewidth=1.3, label=name)
        turn = np.linspace(0.0, 2.0 * np.pi, 200)
        axes.plot(np.cos(turn), np.sin(turn), color="#cbd5e1", linewidth=0.8)
        circle = -1.0 + modulus * np.exp(1j * turn)
        axes.plot(circle.real, circle.imag, color=WITHOUT, linewidth=1.0, linestyle="--")
        axes.plot(-1.0, 0.0, "+", color=WITHOUT, markersize=9, markeredgewidth=1.6)
        note(axes, f"1/Ms {modulus:.2f}", (-1.0, modulus), (-20, 4))
        axes.set(xlim=(-2.6, 1.2), ylim=(-1.6, 1.2), xlabel="Re L", ylabel="Im L")
        axes.set_aspect("equal", adjustable="box")
        if len(each) > 1:
            axes.legend(fontsize=8, loc="lower right")
    return figure


def response(setup: Setup, tuned: Tuned, closed_loop: ClosedLoop) -> Figure:
    """Step of the target."""
    values = step(setup, tuned, 4.0)
    with drawing(figsize=(WIDTH, HEIGHT)) as (figure, axes):
        time, settled = 1e3 * setup.dt * np.arange(len(values)), 1e3 * closed_loop.settling
        axes.axhspan(0.98, 1.02, color="#f1f5f9", zorder=-1)
        axes.step(time, values, where="post", color=WITH, linewidth=1.3)
        axes.axhline(1.0, color=FAINT, linewidth=0.8)
        if settled <= time[-1]:
            axes.axvline(settled, color=WITHOUT, linewidth=1.0, linestyle="--")
            note(axes, f"within 2 % after {settled:.3g} ms", (settled, 0.1), (4, 0))
        axes.set(
            xlabel="time [ms]",
            ylabel="position / step",
            ylim=(min(-0.05, float(np.min(values)) - 0.05), max(1.2, float(np.max(values)) + 0.1)),
        )
    return figure


def dynamic_stiffness(setup: Setup, each: dict[str, Loop], closed_loop: ClosedLoop) -> Figure:
    """Dynamic stiffness over frequency."""
    loop, axis = next(iter(each.values())), setup.file.axis
    scale, unit = stiffness_unit(setup)
    with drawing(figsize=(WIDTH, HEIGHT)) as (figure, axes):
        f = np.geomspace(min(1.0, 0.001 / loop.dt), 0.2 / loop.dt, RESPONSE_POINTS)  # above, the hold distorts it
        axes.loglog(f, scale * stiffness(setup.stage, loop, f) / axis.travel_per_unit**2, color=WITH, linewidth=1.4)
        least = scale * closed_loop.softest.value
        axes.plot(closed_loop.softest.frequency, least, "o", color=WITHOUT, markersize=4)
        place = (closed_loop.softest.frequency, least)
        note(axes, f"{least:.3g} {unit} at {closed_loop.softest.frequency:.3g} Hz", place, (-40, -15))
        axes.set(ylim=(0.15 * least, None), ylabel=f"dynamic stiffness [{unit}]")
        _frequency_axis(axes)
    return figure


def other_bandwidths(setup: Setup, tuned: Tuned, closed_loop: ClosedLoop) -> Figure:
    """What bandwidth costs, phase margin and Ms with what is refused; and what it buys, the least dynamic stiffness."""
    f = tuned.bandwidth * np.geomspace(0.25, 2.0, 25)
    each = np.array([_judged(setup, tuned, float(bandwidth)) for bandwidth in f])
    scale, unit = stiffness_unit(setup)
    reached, least = next(iter(tuned.reached.values())), scale * closed_loop.softest.value
    chosen_values = (math.degrees(reached.phase), reached.sensitivity.value, least)
    with drawing(3, 1, figsize=(WIDTH, 1.3 * HEIGHT), sharex=True) as (figure, panels):
        words = ("PM {:.1f}°", "Ms {:.2f}", f"{{:.3g}} {unit}")  # each beside its curve: one falls, the others rise
        for axes, curve, value, said, up in zip(panels, each.T, chosen_values, words, (6, -14, -14), strict=True):
            axes.plot(f, curve, color=TARGET, linewidth=1.4)
            axes.axvline(tuned.bandwidth, color=WITH, linewidth=1.0)
            axes.plot(tuned.bandwidth, value, "o", color=WITH, markersize=5)
            note(axes, f"{tuned.bandwidth:.3g} Hz: {said.format(value)}", (tuned.bandwidth, value), (6, up), WITH)
        above, middle, below = panels
        above.set(ylabel="phase margin [deg]", ylim=(0.0, None))
        middle.set(ylabel="Ms", ylim=(1.0, 5.0))
        below.set(ylabel=f"least stiffness [{unit}]", ylim=(0.0, None), xlabel="bandwidth [Hz]")
        degrees = math.degrees(tuned.demand.margin)
        _refused(above, (0.0, degrees), degrees, f">= {degrees:.3g} deg", f[0])
        if math.isfinite(tuned.demand.peak):
            _refused(middle, (tuned.demand.peak, 5.0), tuned.demand.peak, f"Ms <= {tuned.demand.peak:g}", f[0])
    return figure


def _refused(axes: Axes, span: tuple[float, float], limit: float, words: str, first: float) -> None:
    """The limit in words, from the `first` x on, and shaded what it refuses."""
    axes.axhspan(*span, color="#e2e8f0", zorder=-1)
    axes.axhline(limit, color=WITHOUT, linewidth=1.0, linestyle="--")
    note(axes, words, (first, limit), (4, 6))


def _judged(setup: Setup, tuned: Tuned, bandwidth: float) -> tuple[float, float, float]:
    """Phase margin (deg), Ms and least stiffness of the loop cut at the current; NaN where it is none, or unstable."""
    try:
        loop = next(iter(judged_loops(tuned.family.stage, chosen(tuned.family, bandwidth)).values()))
        margins = robustness(loop)
    except DesignError:
        return (math.nan,) * 3
    if not margins.stable:
        return (math.nan,) * 3
    least = softest(tuned.family.stage, loop).value / setup.file.axis.travel_per_unit**2
    return math.degrees(margins.phase), margins.sensitivity.value, stiffness_unit(setup)[0] * least


def _db(values: Array) -> Array:
    return 20.0 * np.log10(np.abs(values))


def _unwrapped(values: Array) -> Array:
    """Phase (deg), at low frequency between -360 and 0."""
    phase = np.degrees(np.unwrap(np.angle(values)))
    return np.asarray(phase - 360.0 * math.ceil(phase[0] / 360.0))


def _frequency_axis(axes: Axes) -> None:
    axes.set_xlabel("frequency [Hz]")
    axes.grid(True, which="minor", axis="x", color="#f1f5f9")
