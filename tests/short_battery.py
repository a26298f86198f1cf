"""A battery of a few motions to close the gap with; the whole one takes a minute."""

from __future__ import annotations

import pytest

from stagectl.gap.experiment_design.battery import battery, held_out
from stagectl.workflows import gap_closing


def shorten(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Let `gap close` record only the motions of these names."""
    for what, whole in (("battery", battery), ("held_out", held_out)):
        monkeypatch.setattr(
            gap_closing, what, lambda setup, whole=whole: tuple(x for x in whole(setup) if x.name in names)
        )
