"""Slider paper: Figs. 3 to 5 as parts of a page, ours beside the paper's numbers."""

from typing import Any

from stagectl.report.figures import embedded
from stagectl.report.page import Picture, Section, Table
from stagectl_studies.reproduction import chosen, published
from stagectl_studies.reproduction import figures_slider as figures
from stagectl_studies.reproduction.bench import Run
from stagectl_studies.reproduction.part import Part
from stagectl_studies.reproduction.slider import Evidence
from stagectl_studies.reproduction.slider_contact import SAME_DECELERATION, current_before, opening, turning

LEAST = 560  # px, of the wide figures


def parts(e: Evidence) -> list[Part]:
    """Figs. 3 to 5, in their order."""
    return [_stroke_end(e), _standstill(e), _release(e)]


def _shown(e: Evidence, run: Run, label: str, instant: float) -> figures.ShownRun:
    return figures.ShownRun(label, run.samples, instant, e.bench.machine.stage.motor.force_constant)


def _stroke_end(e: Evidence) -> Part:
    runs = [_shown(e, run, f"{speed} mm/s", turning(run)) for speed, run in e.reversals.items()]
    constant = e.bench.machine.stage.motor.force_constant
    force = {speed: constant * current_before(run, turning(run)) for speed, run in e.reversals.items()}
    words = [
        "The paper: around the end of a stroke the output force differs with the speed before it, does not fall as the "
        "axis slows down, and changes its direction behind the reversal: friction goes on assisting the motion for a "
        "while. Velocity feedforward is 0. The paper gives no numbers here.",
        "Ours, all slowed down at 0.1 m/s²: "
        + ", ".join(f"{value:.2f} N at {speed} mm/s" for speed, value in force.items())
        + " over the 10 ms before the reference reverses, M a of 0.6 N included. The guide's friction follows the "
        f"speed {1e3 * chosen.FRICTION_LAG:.0f} ms late (frictional lag): after a fast stroke it has not yet risen to "
        "Stribeck's peak.",
        "The table: without the lag and at the same deceleration the forces hardly differ; what remains is the loop. "
        "The paper speaks of different deceleration profiles and does not give them. Where the axis takes the same "
        "time to stop from each speed, M a alone makes the forces differ. Both causes act the same way, and the text "
        "that we "
        "have cannot tell one from the other.",
    ]
    image = Picture(
        embedded(figures.stroke_end(runs, (-0.15, 0.2))), "Velocity and output force (calculated, Kt i).", LEAST
    )
    return Part(
        "figure 3",
        Section("Fig. 3 - Stroke end", words, [image], [_contacts(e)]),
        {"force_at_reversal": force, "contacts": _numbers(e)},
    )


def _contacts(e: Evidence) -> Table:
    """Lag and profile against each other, all speeds in each cell."""
    speeds = list(e.reversals)
    rows = []
    for lag, profile in dict.fromkeys((lag, profile) for lag, profile, _ in e.contacts):
        stops = [e.contacts[lag, profile, speed] for speed in speeds]
        cells = (
            " / ".join(f"{stop.reversal:.2f}" for stop in stops),
            " / ".join(f"{stop.holding:.2f}" for stop in stops),
            " / ".join(f"{1e6 * abs(stop.offset):.1f}" for stop in stops),
        )
        rows.append([f"{1e3 * lag:.0f} ms, {profile}", *cells])
    title = f"After {' / '.join(speeds)} mm/s, by the friction's lag and the way the axis stops; Stribeck's rise alike"
    return Table(title, ["", "force at the reversal [N]", "force at standstill [N]", "back to rest [µm]"], rows)


def _numbers(e: Evidence) -> dict[str, Any]:
    return {
        f"lag {1e3 * lag:.0f} ms, {profile}, {speed} mm/s": stop._asdict()
        for (lag, profile, speed), stop in e.contacts.items()
    }


def _standstill(e: Evidence) -> Part:
    stops = [_shown(e, run, f"{speed} mm/s", turning(run)) for speed, run in e.stops.items()]
    rows = [
        [f"{speed} mm/s", f"{published.HOLDING_FORCE} N", f"{result.value:.2f} N"]
        for speed, result in e.holding.items()
    ]
    words = [
        "The paper: the force falls while the axis slows down, and about 5.3 N keep it at zero velocity. Ours: it "
        "falls by M a, 0.6 N, and the axis then stands for 0.2 s behind each stroke. That the force is about 5.3 N is "
        "how the stage was built (4.5 N of rolling friction and Stribeck's rise), so it confirms the model, not the "
        "paper. With the lag of Fig. 3 it falls slightly with the speed before; the paper gives one value for all.",
    ]
    image = Picture(
        embedded(figures.stroke_end(stops, (-0.15, 0.15), "stop")), "Slowing down to a standstill and standing.", LEAST
    )
    table = Table("Force at zero velocity", ["speed before", "paper", "ours"], rows)
    numbers = {speed: {"ours": result.value, "paper": published.HOLDING_FORCE} for speed, result in e.holding.items()}
    return Part("figure 4", Section("Fig. 4 - Zero velocity", words, [image], [table]), numbers)


def _release(e: Evidence) -> Part:
    runs = [_shown(e, run, f"{speed} mm/s before", opening(run)) for speed, run in e.releases.items()]
    low, high = published.RELEASE_TRAVEL
    rows, numbers = [], {}
    for speed, result in e.ringing.items():
        f = result.frequency
        rows.append(
            [
                f"{speed} mm/s",
                f"{f.value:.2f} Hz",
                f"{1e6 * abs(result.offset):.1f} µm",
                f"{1e6 * result.travel:.1f} µm",
            ]
        )
        numbers[speed] = {"frequency": f.value, "offset": result.offset, "travel": result.travel}
    rows.append(["paper", f"{published.VIBRATION:g} Hz", f"{1e6 * low:.0f} to {1e6 * high:.0f} µm", ""])
    slowest, fastest = next(iter(e.ringing)), list(e.ringing)[-1]
    low_speed, high_speed = (abs(e.ringing[speed].offset) for speed in (slowest, fastest))
    lags = list(dict.fromkeys(lag for lag, _, _ in e.contacts))
    ends = [abs(e.contacts[lags[-1], SAME_DECELERATION, speed].offset) for speed in (slowest, fastest)]
    widest = ends[0] - ends[1]
    words = [
        "The paper: the output force is set to zero and the guide springs back: up to 20 µm (2000 pulses), more than "
        "15 µm, with a free vibration of 40 Hz that does not depend on the force. At low speeds the displacement is "
        f"larger. Ours: from {slowest} to {fastest} mm/s it falls from {1e6 * low_speed:.1f} to {1e6 * high_speed:.1f} "
        "µm. The friction that follows the speed late is larger after a slow stroke, and so is what the guide has "
        f"stored. Without the lag it is the same at all speeds; a lag of {1e3 * lags[-1]:.0f} ms widens it to "
        f"{1e6 * widest:.1f} µm. The paper's difference is not stated; Stribeck's rise limits ours.",
        "The travel is taken to where the axis comes to rest; the first swing goes further. The paper does not say "
        "which of the two it means.",
    ]
    image = Picture(embedded(figures.release(runs)), "Position from where the force was set to zero.", LEAST)
    table = Table("", ["speed before", "frequency", "back to rest", "first swing"], rows)
    return Part(
        "figure 5",
        Section("Fig. 5 - Spring-like behaviour at zero force", words, [image], [table]),
        {**numbers, "paper": {"frequency": published.VIBRATION, "travel": [low, high]}},
    )
