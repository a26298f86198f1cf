"""A stage as a configuration of Isaac Lab, tried by the rule that PhysX documents."""

from __future__ import annotations

from pathlib import Path

from stagectl.config.stage_file import Setup
from stagectl.interchange.exported import ExportedModel, write_texts
from stagectl.interchange.isaac import configuration, physx, published
from stagectl.interchange.losses import lost
from stagectl.interchange.round_trip import compared

SIMULATOR = f"Isaac Lab {published.VERSION}, by PhysX' rule of joint friction,"
NOTES = (
    f"Checked against the field names of {published.CLASS} that Isaac Lab {published.VERSION} publishes.",
    "Isaac Sim did not run: the motions are those of the rule that PhysX documents.",
    "Isaac Lab 2.3 calls `actuator_effort_limit` `effort_limit`.",
)


def to_isaac(setup: Setup, path: Path) -> ExportedModel:
    """Write the Python file `path`, and run the parameters in it by PhysX' rule.

    Raises ExportError where it cannot be written.
    """
    write_texts({path: configuration.text(configuration.configuration(setup), setup.file.name)})
    variants = {path.name: compared(setup, physx.simulated(path))}
    losses = [*lost(setup, configuration.HELD), *configuration.shapes(setup.stage)]
    return ExportedModel(SIMULATOR, (path,), variants, losses, NOTES)
