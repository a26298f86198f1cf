"""What the entries of a friction compensator must hold together."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

from stagectl.compensation.forms import Compensators
from stagectl.compensation.rolling import GeneralisedMaxwell, ReversalTable
from stagectl.config.bounds import SAME_VALUE
from stagectl.config.stage_blocks import StageFile
from stagectl.problem import Problem, ProblemKind

_CONFLICT = ProblemKind.CONFLICT


def compensator_conflicts(file: StageFile) -> Iterator[Problem]:
    """Conflicts of the compensator that acts, and of those next to it."""
    compared = file.compensators
    blocks: list[tuple[str, Any]] = [("compensation", file.compensation)]
    blocks += [(f"compensators.{name}", getattr(compared, name)) for name in Compensators._fields]
    for name, block in blocks:
        if isinstance(block, ReversalTable):
            yield from _table(block, name)
        elif isinstance(block, GeneralisedMaxwell):
            yield from _same_length((f"{name}.weight", block.weight), (f"{name}.slip", block.slip))


def _table(p: ReversalTable, name: str) -> Iterator[Problem]:
    """A curve from -T_c to T_c over a displacement that rises from 0."""
    unequal = list(_same_length((f"{name}.force", p.force), (f"{name}.displacement", p.displacement)))
    yield from unequal
    if unequal:
        return
    if p.displacement[0] != 0.0 or len(p.displacement) < 2 or not _rises(p.displacement, strictly=True):
        reason = "must begin with 0 and rise from row to row, over two rows at least"
        yield Problem(reason, _CONFLICT, f"{name}.displacement")
    first, last = p.force[0], p.force[-1]
    if not _rises(p.force) or last <= 0.0 or abs(first + last) > SAME_VALUE * last:
        reason = f"must rise from -T_c to T_c; it goes from {first:g} to {last:g}"
        yield Problem(reason, _CONFLICT, f"{name}.force")


def _same_length(one: tuple[str, tuple[float, ...]], other: tuple[str, tuple[float, ...]]) -> Iterator[Problem]:
    if len(one[1]) != len(other[1]):
        reason = f"has {len(one[1])} entries, and {other[0]} has {len(other[1])}: give one for each"
        yield Problem(reason, _CONFLICT, one[0])


def _rises(values: tuple[float, ...], strictly: bool = False) -> bool:
    steps = [after - before for before, after in itertools.pairwise(values)]
    return all(step > 0.0 if strictly else step >= 0.0 for step in steps)
