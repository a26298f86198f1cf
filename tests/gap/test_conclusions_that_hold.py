"""What is said of a session, once the held-out runs have refuted an effect."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from stagectl.gap import conclusions_that_hold as module
from stagectl.gap.conclusions_that_hold import Fits, conclusions_that_hold
from stagectl.gap.effects.library import label
from stagectl.gap.inference import verdict
from stagectl.gap.validation.validate import Validation


@pytest.mark.parametrize(
    ("selected", "kept"),
    [(("cogging",), ("cogging",)), (("dwell", "cogging"), ("cogging",)), (("dwell", "thermal_coulomb"), ())],
)
def test_refuted_effects_are_taken_out_one_after_the_other(
    monkeypatch: pytest.MonkeyPatch, selected: Any, kept: tuple[str, ...]
) -> None:
    """Each time all is said anew, and each has its note, the first one first."""
    wrong, nothing = ("dwell", "thermal_coulomb"), SimpleNamespace(begin=lambda step: None)

    def judged(session: Any, e: Any, names: tuple[str, ...], said: tuple[str, ...]) -> Validation:
        assert said == names
        refuted: Any = SimpleNamespace(refuted=next((name for name in wrong if name in names), ""))
        return Validation(None, refuted, ("a doubt",))  # type: ignore[arg-type]

    monkeypatch.setattr(module, "conclude", lambda session, e, library, names, *_: names)
    monkeypatch.setattr(module, "localise", lambda *_: None)
    monkeypatch.setattr(module, "validate", judged)
    monkeypatch.setattr(verdict, "taken_out", lambda e, names, gone: tuple(x for x in names if x != gone))
    given: Any = (None, None, None, None, None, ())
    held: Any = conclusions_that_hold(Fits(*given), selected, nothing)  # type: ignore[arg-type]
    assert held.selected == held.conclusions == kept
    assert held.refuted == tuple(name for name in selected if name in wrong)
    *notes, doubt = held.validation.warnings
    assert doubt == "a doubt"
    assert all(label(name) in note for name, note in zip(held.refuted, notes, strict=True))
