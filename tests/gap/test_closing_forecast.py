"""The error that is left, said before the new controller runs: what the model does not know stays."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stagectl.workflows import closing_errors
from stagectl.workflows.closing_errors import foretold

TIME = np.arange(4000) / 2000.0
KNOWN, UNKNOWN = 3e-6 * np.sin(2.0 * np.pi * 2.0 * TIME), 1e-6 * np.cos(2.0 * np.pi * 7.0 * TIME)


def test_what_the_model_does_not_know_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """The machine's error has a part that the model knows and compensates, one that it does not know, and noise."""
    noise = 0.2e-6 * np.random.default_rng(1).standard_normal((3, TIME.size))
    kept = {
        "machine": KNOWN + UNKNOWN + noise,
        "old": np.stack([KNOWN] * 3),
        "new": np.zeros((3, TIME.size)),
    }
    monkeypatch.setattr(closing_errors, "traces", lambda recordings: kept[recordings[0]])
    machine = {"sine": {"before": recorded("machine")}}
    levels = foretold(machine, {"sine": {"before": recorded("old"), "after": recorded("new")}})
    before, after = (float(np.sqrt(np.mean((x + noise) ** 2))) for x in (KNOWN + UNKNOWN, UNKNOWN))
    assert levels == {"before": pytest.approx(before), "after": pytest.approx(after)}


def recorded(name: str) -> dict[str, Any]:
    return {"recordings": [name]}
