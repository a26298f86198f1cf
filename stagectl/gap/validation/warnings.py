"""What makes a diagnosis weaker than it looks, one sentence each."""

from __future__ import annotations

from stagectl.gap.logs.session import Session
from stagectl.gap.selection.refine import Evidence
from stagectl.kernels.stage import Stage

NOTHING_HELD_OUT = (
    "no log is held out: the gap is judged on the runs that chose the effects, so the closure is too optimistic"
)
NOTHING_CLOSER = (
    "no fitted model brings the simulated loop closer to the runs that it was fitted on: the gap after is that of the "
    "nominal model, and only the forces support the effects named here"
)


def warnings(session: Session, e: Evidence, improved: Stage) -> list[str]:
    """Warnings of repeats that are copies, of runs that were used twice, and of a fit that the loop does not confirm.

    `improved` is the model that the loop was found to follow best.
    """
    lines = []
    copies = sum(not log.held_out for log in session.logs) - sum(len(run.logs) for run in e.runs)
    if copies:
        lines.append(f"{copies} repeats are copies, to the last bit, and are ignored: they show nothing of the noise")
    if not any(log.held_out for log in session.logs):
        lines.append(NOTHING_HELD_OUT)
    if improved is session.stage:
        lines.append(NOTHING_CLOSER)
    return lines
