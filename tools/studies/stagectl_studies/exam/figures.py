"""The figures of an exam: who was taken for whom, from which size effects are noticed, calibration, closure."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from stagectl.gap.effects import library
from stagectl.report.figures import STYLE, TARGET, WITH, WITHOUT

WIDTH = 5.4  # inch: two stand side by side
_PALE, _GREY = "#e2e8f0", "#94a3b8"
_LAST = ("parameters", "none", "unknown", "controller", "not-identifiable", "failed")  # answers that are no effect
_SHOWN = (0.25, 8.0)  # times the typical size
_TICKS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)


def called(name: str) -> str:
    """An effect as people call it; other answers as they are."""
    return library.label(name) if name in library.EFFECTS else name


def confusion(counts: Sequence[Sequence[Any]]) -> Figure:
    """Truth down, first answer across; a row adds up to all trials of that truth."""
    truths = _ordered({truth for truth, _, _ in counts})
    answers = _ordered({answer for _, answer, _ in counts} | set(truths))
    table = np.zeros((len(truths), len(answers)))
    for truth, answer, count in counts:
        table[truths.index(truth), answers.index(answer)] = count
    share = table / np.maximum(table.sum(axis=1, keepdims=True), 1.0)
    right = np.array([[truth == answer for answer in answers] for truth in truths])
    with rc_context({**STYLE, "axes.grid": False}):
        figure, axes = plt.subplots(figsize=(2.6 + 0.26 * len(answers), 2.0 + 0.22 * len(truths)))
        for kept, colours in ((right, "Greens"), (~right, "Oranges")):
            shown = np.ma.masked_where(~kept | (table == 0.0), 0.1 + share)
            axes.imshow(shown, cmap=colours, vmin=0.0, vmax=2.2, aspect="auto")
        for row, column in np.argwhere(table > 0.0):
            axes.text(column, row, f"{table[row, column]:.0f}", ha="center", va="center", fontsize=7.5, color=TARGET)
        axes.set_xticks(range(len(answers)), [called(reply) for reply in answers], rotation=90, fontsize=7.5)
        axes.set_yticks(range(len(truths)), [called(hidden) for hidden in truths], fontsize=7.5)
        axes.set_xticks(np.arange(len(answers) - 1) + 0.5, minor=True)
        axes.set_yticks(np.arange(len(truths) - 1) + 0.5, minor=True)
        axes.grid(visible=True, which="minor", color=_PALE, linewidth=0.5)
        axes.tick_params(which="both", length=0)
        axes.set_xlabel("first answer")
        axes.set_ylabel("hidden")
        figure.tight_layout()
    return figure


def _ordered(names: set[str]) -> list[str]:
    return sorted(names - set(_LAST)) + [name for name in _LAST if name in names]


def limits(classes: Sequence[Mapping[str, Any]]) -> Figure:
    """Each class a row: trials that were noticed and that were not, and the size that divides them."""
    with rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(WIDTH, 0.9 + 0.42 * max(len(classes), 3)))
        for row, kind in enumerate(reversed(classes)):
            points = np.array([(size, float(seen)) for size, seen in kind["points"]]).reshape(-1, 2)
            jitter = 0.13 * ((np.arange(len(points)) % 5) - 2) / 2.0
            for seen, colour, label in ((1.0, WITH, "noticed"), (0.0, WITHOUT, "not noticed")):
                mine = points[:, 1] == seen
                place = row + jitter[mine] + (0.12 if seen else -0.12)
                axes.plot(points[mine, 0], place, "o", color=colour, markersize=3.2, label="" if row else label)
            axes.plot([kind["limit"]] * 2, [row - 0.36, row + 0.36], color=TARGET, linewidth=2.0)
        axes.set_xscale("log", base=2)
        axes.set_xlim(_SHOWN[0] * 0.9, _SHOWN[1] * 1.1)
        axes.set_xticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
        axes.set_yticks(range(len(classes)), [f"{kind['class']} ({kind['trials']})" for kind in reversed(classes)])
        axes.set_ylim(-0.6, len(classes) - 0.4)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("size of the effect, times its typical one")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, fontsize=8)
        figure.tight_layout()
    return figure


def reliability(bins: Sequence[Mapping[str, Any]]) -> Figure:
    """How often an answer is right against how sure it was, with Wilson intervals."""
    known = [group for group in bins if group["count"]]
    with rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(WIDTH, 3.6))
        axes.plot([0.0, 1.0], [0.0, 1.0], color=_GREY, linewidth=1.0, linestyle="--")
        for group in known:
            axes.plot(
                [group["said"]] * 2,
                [group["low"], group["high"]],
                color=WITH,
                linewidth=1.2,
            )
            axes.plot(group["said"], group["right"], "o", color=WITH, markersize=4.0)
            side = (-5, "right") if group["said"] > 0.5 else (5, "left")
            axes.annotate(
                str(group["count"]),
                (group["said"], group["right"]),
                (side[0], 4),
                textcoords="offset points",
                ha=side[1],
                fontsize=7.5,
                color=TARGET,
            )
        axes.set_xlim(0.0, 1.02)
        axes.set_ylim(0.0, 1.05)
        axes.set_xlabel("probability said")
        axes.set_ylabel("share that is so")
        figure.tight_layout()
    return figure


def closures(records: Sequence[Mapping[str, Any]]) -> Figure:
    """Closure expected beforehand against closure on the withheld runs, one point a trial."""
    gaps = [record["gap"] for record in records if record["gap"]["predicted"] is not None]
    return _against(gaps, "predicted", ("closure expected beforehand [%]", "closure on withheld runs [%]"))


def _against(records: Sequence[Mapping[str, Any]], key: str, labels: tuple[str, str]) -> Figure:
    low = 0.0
    with rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(WIDTH, 3.6))
        x = np.clip([100.0 * gap[key] for gap in records], low, 100.0)
        y = np.clip([100.0 * gap["closure"] for gap in records], low, 100.0)
        axes.plot([low, 100.0], [low, 100.0], color=_GREY, linewidth=1.0, linestyle="--")
        axes.plot(x, y, "o", color=WITH, markersize=3.5, alpha=0.7, clip_on=False)
        axes.set_xlim(low, 102.0)
        axes.set_ylim(low, 102.0)
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])
        figure.tight_layout()
    return figure


def ratios(values: Sequence[float]) -> Figure:
    """Gap left over the gap left by the oracle: the share of trials below each value."""
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    with rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(WIDTH, 3.6))
        share = 100.0 * (np.arange(len(ordered)) + 1.0) / max(len(ordered), 1)
        axes.step(ordered, share, color=WITH, where="post", linewidth=1.4)
        for bound, label in ((1.05, "target 1.05"), (1.2, "must 1.2")):
            axes.axvline(bound, color=_GREY, linestyle=":", linewidth=1.0)
            axes.text(bound, 3.0, f" {label}", fontsize=7.5, color=TARGET, rotation=90, va="bottom", ha="right")
        axes.set_xscale("log")
        ticks = [0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks], minor=False)
        axes.set_xticks([], minor=True)
        axes.set_xlim(
            min(0.7, 0.95 * float(ordered.min(initial=1.0))), max(2.0, 1.05 * float(ordered.max(initial=1.0)))
        )
        axes.set_ylim(0.0, 102.0)
        axes.set_xlabel("gap left, times that of the oracle")
        axes.set_ylabel("trials [%]")
        figure.tight_layout()
    return figure
