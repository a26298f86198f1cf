"""What a campaign of identifications comes to: coverage, errors and widths by law, encoder, rate and the rest."""

import statistics
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from rich import box
from rich.console import Console
from rich.table import Table
from scipy.stats import binomtest

LABELS = {"inertia": "J %", "viscous": "D %", "coulomb": "Tc %", "delay": "delay ms"}
SMALL = 0.02  # relative error of the inertia that an answer of 10 s is allowed
console = Console(width=None if sys.stdout.isatty() else 150, highlight=False)


class Outcome(NamedTuple):
    """One capture: what was drawn, what is true, what the oracles state, and what the identification did."""

    setting: Mapping[str, Any]
    truth: Mapping[str, float]
    oracle: Mapping[str, Mapping[str, float]]  # half widths of `shape_known` and `law_known`, and `estimates`
    seconds: float
    refused: str  # empty where there is an answer
    words: str  # the refusal or the notes
    intervals: Mapping[str, Sequence[float]]  # value, low, high by parameter

    @property
    def answered(self) -> bool:
        """Whether there are values."""
        return not self.refused

    def holds(self, name: str) -> bool:
        """Whether the stated interval holds the truth; an unstated one does not."""
        _, low, high = self.intervals.get(name, (0.0, 1.0, 0.0))
        return bool(low <= self.truth[name] <= high)

    def error(self, name: str) -> float:
        """Relative, absolute value; of the delay in seconds."""
        off = abs(self.intervals[name][0] - self.truth[name])
        return off if name == "delay" else off / self.truth[name]

    def width(self, name: str, oracle: str) -> float:
        """Stated interval over that of an oracle."""
        _, low, high = self.intervals[name]
        return 0.5 * (high - low) / self.oracle[oracle][name]

    def oracle_holds(self, name: str) -> bool:
        """Whether the first oracle's interval holds the truth: ripple and cogging bend it, too."""
        off = abs(self.oracle["estimates"][name] - self.truth[name])
        return bool(off <= self.oracle["shape_known"][name])

    def line(self) -> str:
        """For the progress."""
        s = self.setting
        about = f"{s['seed']:4d} {s['law']:13} {s['motion']:14} {s['counts']:8d} {1 / s['row']:5.0f} Hz"
        about += f" {s['duration']:3.0f} s {s['column']:8} {self.seconds:6.2f} s  "
        if self.refused:
            return about + f"refused, {self.refused}"
        entries = (f"{label} {self._entry(name)}" for name, label in LABELS.items())
        return about + "  ".join(entries)

    def _entry(self, name: str) -> str:
        if name not in self.intervals:
            return "-"
        value, low, high = self.intervals[name]
        unit = 1e3 if name == "delay" else 100.0 / self.truth[name]
        off, half = (value - self.truth[name]) * unit, 0.5 * (high - low) * unit
        return f"{off:+.2f} ± {half:.2f}{'' if self.holds(name) else ' !'}"


_GROUPS: dict[str, Callable[[Outcome], str]] = {
    "law": lambda outcome: str(outcome.setting["law"]),
    "encoder": lambda outcome: f"{outcome.setting['counts']} counts",
    "rate": lambda outcome: f"{1.0 / outcome.setting['row']:.0f} Hz",
    "duration": lambda outcome: f"{outcome.setting['duration']:.0f} s",
    "column": lambda outcome: str(outcome.setting["column"]),
    "motion": lambda outcome: str(outcome.setting["motion"]),
    "reference": lambda outcome: "reference" if outcome.setting["reference"] else "no reference",
}


def show(outcomes: Sequence[Outcome]) -> None:
    """All tables."""
    if not outcomes:
        console.print("no capture")
        return
    console.print(_coverage(outcomes))
    console.print(_accuracy(outcomes))
    console.print(_refusals(outcomes))
    console.print(_silent(outcomes))


def _grouped(outcomes: Sequence[Outcome]) -> Iterable[tuple[str, list[Outcome]]]:
    """Everything, then the parts by each of `_GROUPS`; a new group begins with an empty line."""
    yield "all", list(outcomes)
    for key in _GROUPS.values():
        yield "", []
        parts: dict[str, list[Outcome]] = defaultdict(list)
        for outcome in outcomes:
            parts[key(outcome)].append(outcome)
        yield from sorted(parts.items())


def _coverage(outcomes: Sequence[Outcome]) -> Table:
    columns = ("captures", "answered", "J holds", "D holds", "Tc holds", "delay holds", "oracle: J D Tc")
    caption = "of the answers: the stated 95 % interval holds the truth, with the 95 % interval of that share (Wilson)"
    table = _table("Coverage; wanted: answered >= 95 %, held 90 to 98 % within every law", caption, columns)
    for title, part in _grouped(outcomes):
        answers = [outcome for outcome in part if outcome.answered]
        held = (_share([answer.holds(name) for answer in answers]) for name in LABELS)
        oracles = " ".join(
            _percent([outcome.oracle_holds(name) for outcome in part]) for name in ("inertia", "viscous", "coulomb")
        )
        cells = [str(len(part)), _share([outcome.answered for outcome in part]), *held, oracles]
        table.add_row(title, *(cells if part else [""] * len(columns)))
    return table


def _accuracy(outcomes: Sequence[Outcome]) -> Table:
    columns = (
        "J %",
        "D %",
        "Tc %",
        "delay ms",
        "J width",
        "D width",
        "Tc width",
        "delay",
        "J to 2 % at 10 s",
        "seconds",
    )
    caption = (
        "error: median / worst of the answers; width: median over the oracle's that knows the friction's shape and the "
        "delay / over the oracle's that knows the law alone, also for the delay"
    )
    table = _table(
        "Errors and widths; wanted: width <= 3, J to 2 % in >= 95 % of the answers of 10 s", caption, columns
    )
    for title, part in _grouped(outcomes):
        answers = [outcome for outcome in part if outcome.answered]
        table.add_row(title, *(_accuracy_cells(answers) if part else [""] * len(columns)))
    return table


def _accuracy_cells(answers: Sequence[Outcome]) -> list[str]:
    errors = [_errors(answers, name, 1e3 if name == "delay" else 100.0) for name in LABELS]
    widths = [_widths(answers, name) for name in LABELS]
    long = [answer.error("inertia") <= SMALL for answer in answers if answer.setting["duration"] >= 10.0]
    return [*errors, *widths, _share(long), _median([answer.seconds for answer in answers])]


def _errors(answers: Sequence[Outcome], name: str, unit: float) -> str:
    values = [unit * answer.error(name) for answer in answers if name in answer.intervals]
    return f"{_median(values)} / {max(values):.3g}" if values else "-"


def _widths(answers: Sequence[Outcome], name: str) -> str:
    """Over both oracles; the first knows the delay."""
    stated = [answer for answer in answers if name in answer.intervals]
    known = ("law_known",) if name == "delay" else ("shape_known", "law_known")
    return " / ".join(_median([answer.width(name, which) for answer in stated]) for which in known)


def _refusals(outcomes: Sequence[Outcome]) -> Table:
    table = _table("Refusals", "--seeds and --keep show one of them", ("captures", "laws", "seeds", "first words"))
    parts: dict[str, list[Outcome]] = defaultdict(list)
    for outcome in outcomes:
        if outcome.refused:
            parts[outcome.refused].append(outcome)
    for reason, part in sorted(parts.items(), key=lambda entry: -len(entry[1])):
        laws = ", ".join(sorted({str(outcome.setting["law"]) for outcome in part}))
        seeds = " ".join(str(outcome.setting["seed"]) for outcome in part[:12])
        words = part[0].words.rsplit("/", 1)[-1][:160]
        table.add_row(reason, str(len(part)), laws, seeds, words)
    return table


def _silent(outcomes: Sequence[Outcome]) -> Table:
    caption = "the fifteen with the largest errors; what is stated is half the width of the interval"
    title = f"Wrong in silence: J off by more than {100.0 * SMALL:.0f} %, outside its interval"
    table = _table(title, caption, ("law", "motion", "encoder", "rate", "s", "J off %", "stated %", "delay off ms"))
    wrong = [o for o in outcomes if o.answered and o.error("inertia") > SMALL and not o.holds("inertia")]
    for outcome in sorted(wrong, key=lambda o: -o.error("inertia"))[:15]:
        s, (value, low, high) = outcome.setting, outcome.intervals["inertia"]
        percent = 100.0 / outcome.truth["inertia"]
        off, half = (value - outcome.truth["inertia"]) * percent, 0.5 * (high - low) * percent
        late = f"{1e3 * outcome.error('delay'):.3g}" if "delay" in outcome.intervals else "-"
        row = (s["law"], s["motion"], str(s["counts"]), f"{1.0 / s['row']:.0f} Hz", f"{s['duration']:.0f}")
        table.add_row(str(s["seed"]), *row, f"{off:+.2f}", f"{half:.2f}", late)
    return table


def _table(title: str, caption: str, columns: Sequence[str]) -> Table:
    table = Table(title=title, caption=caption, title_justify="left", caption_justify="left", box=box.SIMPLE)
    table.add_column("")
    for column in columns:
        table.add_column(column, justify="right", overflow="fold")
    return table


def _share(values: Sequence[bool]) -> str:
    """``18/20 90% (70-97)``."""
    if not values:
        return "-"
    low, high = binomtest(sum(values), len(values)).proportion_ci(method="wilson")
    return f"{sum(values)}/{len(values)} {_percent(values)} ({100.0 * low:.0f}-{100.0 * high:.0f})"


def _percent(values: Sequence[bool]) -> str:
    return f"{100.0 * sum(values) / len(values):.0f}%" if values else "-"


def _median(values: Sequence[float]) -> str:
    return f"{statistics.median(values):.3g}" if values else "-"
