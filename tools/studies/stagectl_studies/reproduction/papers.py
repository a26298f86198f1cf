"""The two papers by name: carried out, judged in a sentence, and written as a page and as numbers."""

from pathlib import Path

from stagectl.number_format import length
from stagectl.recording.metadata import versions
from stagectl.report.page import Page, write
from stagectl.units import StageError
from stagectl_studies.reproduction import (
    ball_screw,
    ball_screw_conventional,
    ball_screw_proposed,
    ball_screw_summary,
    ball_screw_tracking,
    chosen,
    slider,
    slider_forms,
    slider_friction_parts,
    slider_parts,
    slider_summary,
    summary,
)
from stagectl_studies.reproduction.bench import CONFIG
from stagectl_studies.reproduction.part import Outcome, by_name
from stagectl_studies.reproduction.progress import Course, Tell
from stagectl_studies.reproduction.tracking import NOISES

PAPERS = ("ball-screw", "slider")


def check(paper: str) -> None:
    """Say what is wrong with the name of a paper, before anything is done.

    Raises StageError where it is unknown or the checkout's configuration is missing.
    """
    if paper not in PAPERS:
        raise StageError(f"paper {paper}; must be one of {', '.join(PAPERS)}")
    if not CONFIG.is_dir():
        raise StageError(f"reproducing needs the checkout's config folder, and there is none at {CONFIG}: run it there")


def reproduce(paper: str, tell: Tell) -> Outcome:
    """All figures of `paper`; progress goes to `tell` (done, total).

    Raises StageError as `check` does.
    """
    check(paper)
    if paper == "slider":
        course = Course({**slider.STEPS, "figures": 4.0}, tell)
        outcome = slider_outcome(slider.evidence(course), course)
    else:
        course = Course({**ball_screw.STEPS, "figures": 12.0}, tell)
        outcome = ball_screw_outcome(ball_screw.evidence(course), course)
    course.finish()
    return outcome


def ball_screw_outcome(e: ball_screw.Evidence, course: Course) -> Outcome:
    """The ball-screw paper's parts, and what they amount to."""
    tell = course.begin("figures")
    conventional = ball_screw_conventional.parts(e)
    tell(1, 3)
    *proposed, parameters = ball_screw_proposed.parts(e)
    tell(2, 3)
    tracking = ball_screw_tracking.parts(e)
    p = e.proposed[ball_screw.MAIN].parameters
    peaks = next(part for part in tracking if part.name == "figure 13").numbers
    bare = max(row["without noise"]["none"]["peak"] for row in peaks.values())
    worst = {noise: max(row[noise]["proposed"]["peak"] for row in peaks.values()) for noise in NOISES}
    answer = (
        f"One record of a current sine gives J {p['inertia'].value:.5f} kg m² and D {p['viscous'].value:.4f} N m s/rad "
        "(paper 0.010 and 0.14) and the rolling friction; compensated with it, the stage tracks within "
        f"{length(worst['without noise'], 'm')} ({length(worst['with noise'], 'm')} with current noise) where it peaks "
        f"at {length(bare, 'm')} without."
    )
    notes = [
        "Simulated: the machine is a model (config/ball-screw.yaml) with 0.045 A rms of noise on its motor current and "
        "the encoder's steps. No method was told the model's parameters; the operator's data sheet was wrong by a "
        "fifth and more. An error against the truth here is a floor, not a promise for a real stage.",
        "The paper's figures hold no numbers beyond those in its text, which stand beside ours.",
    ]
    parts = [parameters, *conventional, *proposed, *tracking]
    return Outcome(answer, notes, parts, ball_screw_summary.compared(by_name(parts)))


def slider_outcome(e: slider.Evidence, course: Course) -> Outcome:
    """The slider paper's parts, and what they amount to."""
    course.begin("figures")
    fastest = list(e.reversals)[-1]
    lag, first, second = (
        slider.extremes(e.turns[fastest, form]) for form in (slider.NONE, slider_forms.FIRST, slider_forms.SECOND)
    )
    ringing = e.ringing[fastest]
    answer = (
        f"Let go, the slider springs back by {length(abs(ringing.offset), 'm')} and rings at "
        f"{ringing.frequency.value:.1f} Hz (paper: 15 to 20 µm, 40 Hz). At its reversals it lags by "
        f"{length(abs(lag[0]), 'm')} without compensation (paper 4.7 µm), with the paper's form by "
        f"{length(abs(first[0]), 'm')} read as a first power and {length(abs(second[0]), 'm')} as a second (paper 2.4 "
        f"µm), and leads by {length(first[1], 'm')} and {length(second[1], 'm')} (paper: suppressed)."
    )
    notes = [
        "Simulated: the machine is a model (config/linear-slider.yaml) with its encoder's steps and the drive's, and "
        f"no noise. Its friction follows the speed {1e3 * chosen.FRICTION_LAG:.0f} ms late, which the stage file's "
        "does not. The paper gives its holding force, its frequency and its travel; mass, stiffness and loop were "
        "chosen to agree with them, so these three confirm the model. The errors at the reversals were not.",
        "The mass and the viscous friction that the method takes off the force are wrong by a tenth, as a data sheet's "
        "are; it is told nothing of the rolling friction.",
    ]
    parts = [*slider_parts.parts(e), *slider_friction_parts.parts(e)]
    return Outcome(answer, notes, parts, slider_summary.compared(by_name(parts), e.forms.friction))


def page(paper: str, outcome: Outcome, path: Path) -> Path:
    """Write the page of `outcome`."""
    return write(
        Page(
            f"stagectl reproduce {paper}",
            outcome.answer,
            outcome.notes,
            [],
            [summary.table(outcome.compared)],
            [f".venv/bin/stagectl reproduce {paper}", *_COMMANDS[paper]],
            versions(),
            sections=tuple(part.section for part in outcome.parts),
        ),
        path,
    )


_COMMANDS: dict[str, list[str]] = {
    "ball-screw": [
        ".venv/bin/stagectl simulate config/ball-screw.yaml config/experiments/current-sine-1.6hz-5a.yaml -o sine.h5",
        ".venv/bin/stagectl identify simultaneous config/ball-screw.yaml sine.h5",
        ".venv/bin/stagectl simulate config/ball-screw.yaml config/trajectories/sine-1.6hz.yaml --without friction",
    ],
    "slider": [
        ".venv/bin/stagectl simulate config/linear-slider.yaml config/trajectories/slider-10mms.yaml -o reversals.h5",
        ".venv/bin/stagectl identify zero-crossing config/linear-slider.yaml reversals.h5",
    ],
}
