"""What the next experiment is for: the first ambiguous effect of an answer, or what no run has shown."""

from __future__ import annotations

from stagectl.gap.experiment_design.experiment_proposal import propose
from stagectl.gap.inference import verdict
from stagectl.gap.logs.session import Session
from stagectl.gap.result.diagnosis import Found, Next
from stagectl.gap.selection.refine import Evidence
from stagectl.gap.selection.search import Selected


def next_experiment(session: Session, found: Found, selected: Selected, e: Evidence) -> Next | None:
    """The experiment that separates the first ambiguous effect from its alternatives.

    Where no effect is ambiguous it shows what no run has shown.  Raises GapError where no experiment can be made.
    """
    ambiguous = next((effect for effect in found.named if effect.alternatives and not effect.parameter), None)
    models = {"nominal": session.stage}
    if ambiguous is not None:
        models = {ambiguous.name: selected.fitted.equipped.stage, **verdict.rivals(e, selected, ambiguous)}
    return propose(session, models, found.gap.floor)
