"""What makes an answer weaker than it looks, a line each."""

from __future__ import annotations

from stagectl.gap.logs.session import Session
from stagectl.gap.selection.refine import Evidence
from stagectl.kernels.stage import Stage

_SAME = "no log is held out: the gap is judged on the runs that chose the effects, so the closure is too good"
_NOMINAL = (
    "no fitted model brings the simulated loop nearer to the runs that it was fitted on: the gap after is that of the "
    "nominal model, and only the forces speak for what is told here"
)


def doubts(session: Session, e: Evidence, improved: Stage) -> list[str]:
    """Repeats that are none, runs that had to serve twice, and a fit that the loop does not confirm.

    `improved` is the model that the loop was found to follow best.
    """
    found = []
    copies = sum(not log.held_out for log in session.logs) - sum(len(run.logs) for run in e.runs)
    if copies:
        found.append(f"{copies} repeats are copies, to the last bit, and count for nothing: chance is not seen")
    if not any(log.held_out for log in session.logs):
        found.append(_SAME)
    if improved is session.stage:
        found.append(_NOMINAL)
    return found
