"""What the compensation of each effect is worth on a running service: motions with and without it, interleaved.

::

    repeat 1: all, without a, without b   repeat 2: without b, all, ...   --> smaller without b?  drop b, and again

A client of the service: it gives orders and fetches recordings.  One effect is dropped at a time, that without which
the error is the smallest, as another one may only have made up for it.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stagectl import paired_comparison
from stagectl.evaluation import size
from stagectl.number_format import length
from stagectl.realtime.states import State
from stagectl.recording.hdf5 import open_recording
from stagectl.typed_json import plain
from stagectl.web import client
from stagectl.workflows.closing_errors import WITHOUT, smaller
from stagectl.workflows.trials import Result, Shown

ALL = "all"  # the variant in which a current answers every effect
MEASURES = ("peak", "rms")
BACK = 1e-6  # of the distance travelled by which an axis may stand beside its beginning and is left there; rounding


class Running(NamedTuple):
    """An axis of a running service, and the trajectory that it follows."""

    socket: Path
    axis: str
    trajectory: dict[str, Any]  # name, yaml and tables, as the service takes them
    folder: Path  # of the recordings

    def ask(self, method: str, what: str, **body: Any) -> Any:
        """The answer of the service; raises ControlError."""
        return client.ask(self.socket, method, f"/v1/{what}", {**body, "axis": self.axis} if body else None)

    def answered(self) -> list[str]:
        """The effects that a current answers now."""
        effects: dict[str, bool] = self.ask("GET", "effects")[self.axis]
        return [place for place, on in effects.items() if on]


def measured(running: Running, plan: tuple[int, int], keep: bool, shown: Shown) -> Result:
    """Compare in each of `plan` = (repeats, seed), and drop what makes the error grow, unless all is to be kept.

    Raises ControlError where the service refuses, or a motion is stopped.
    """
    running.folder.mkdir(parents=True, exist_ok=True)
    rounds, dropped = list[Result](), list[str]()
    if not running.answered():
        shown.say(f"{running.axis}: its model has no effect to compensate, so nothing was run: see `stagectl gap`")
    while effects := running.answered():
        rounds.append(_round(running, effects, plan, shown, len(rounds) + 1))
        worst = rounds[-1]["worst"]
        if keep or not worst:
            break
        running.ask("PATCH", "effects", unanswered=[worst])
        dropped.append(worst)
        shown.say(f"{running.axis}: dropped {worst}: the error is smaller without its compensation")
    return {"axis": running.axis, "trajectory": running.trajectory["name"], "rounds": rounds, "dropped": dropped}


def _round(running: Running, effects: list[str], plan: tuple[int, int], shown: Shown, number: int) -> Result:
    """Every variant in each repeat; peak and rms, differences with intervals, and the effect to drop."""
    left = {ALL: list[str](), **{f"{WITHOUT}{place}": [place] for place in effects}}
    blocks = enumerate(paired_comparison.order(list(left), *plan), 1)
    turns = [(repeat, name) for repeat, block in blocks for name in block]
    runs: dict[str, list[dict[str, float]]] = {name: [] for name in left}
    with shown.bar(f"compare {len(left)} variants on {running.axis}", len(turns)) as update:
        for done, (repeat, name) in enumerate(turns, 1):
            label = f"round-{number}-{repeat}-{name.replace(' ', '-')}"
            runs[name].append(_followed(running, left[name], label))
            update(done, len(turns))
    outcome = _compared(runs, running)
    for line in outcome["words"]:
        shown.say(line)
    return outcome


def _followed(running: Running, unanswered: list[str], label: str) -> dict[str, float]:
    """Peak and rms (m | rad of travel) of one motion; the axis then stands where it began."""
    begun = _status(running)
    name = running.ask("POST", "recordings", name=f"{running.folder.name}-{label}")["file"]
    try:
        running.ask("POST", "trajectory", **running.trajectory, unanswered=unanswered)
    finally:
        client.ask(running.socket, "POST", f"/v1/recordings/end?axis={running.axis}")
    path = running.folder / f"{label}.h5"
    client.fetch(running.socket, running.axis, name, path)
    recording = open_recording(path)
    moving = recording.samples[recording.column("state") == State.MOVING]
    scale = recording.meta["axis"]["travel_per_unit"]
    if abs(_status(running)["reference"] - begun["reference"]) > BACK * scale * float(np.ptp(moving["reference"])):
        place = f"{begun['reference']} {begun['unit']}"
        client.ask(running.socket, "POST", "/v1/move", {"to": {running.axis: place}})
    return {measure: value or 0.0 for measure, value in size(moving["error"] * scale).items()}


def _status(running: Running) -> dict[str, Any]:
    """The axis now.  Raises ControlError where its loop does not say where it stands."""
    status = client.status_of(running.socket, running.axis)
    if status["reference"] is None:
        raise client.ControlError(f"{running.axis}: {status['state_words']}; the comparison is stopped")
    return status


def _compared(runs: dict[str, list[dict[str, float]]], running: Running) -> Result:
    """The outcome of a round as JSON values."""
    figures = [paired_comparison.Figures.of(name, row) for name, row in runs.items()]
    rows = {figure.name: figure.as_json() for figure in figures}
    against = {measure: paired_comparison.differences(figures, figures[0], measure) for measure in MEASURES}
    errors = {running.trajectory["name"]: rows}
    better = [name for name in rows if name != ALL and smaller(errors, ALL, name)]
    worst = min(better, key=lambda name: rows[name]["rms"]["mean"], default="")
    unit = _status(running)["unit"]
    words = [
        f"{peak.name}: peak error {_change(peak, unit)}, rms {_change(rms, unit)}"
        for peak, rms in zip(*against.values(), strict=True)
    ]
    differences = {measure: [plain(row) for row in each] for measure, each in against.items()}
    return {"errors": rows, "against_all": differences, "worst": worst.removeprefix(WITHOUT), "words": words}


def _change(d: paired_comparison.Difference, unit: str) -> str:
    """``+12.0 nm (95 %: +10.0 nm to +14.0 nm)``: by what the error is larger."""
    mean, low, high = (f"{'-' if x > 0.0 else '+'}{length(abs(x), unit)}" for x in (d.mean, d.high, d.low))
    return mean if np.isnan(d.low) else f"{mean} (95 %: {low} to {high})"
