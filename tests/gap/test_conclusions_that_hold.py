"""What is said of a session, once the held-out runs have refuted an effect."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from stagectl.gap import conclusions_that_hold as module
from stagectl.gap.conclusions_that_hold import Fits, answer_of, conclusions_that_hold
from stagectl.gap.effects.library import label
from stagectl.gap.inference import verdict
from stagectl.gap.selection.linearised import Library
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


@pytest.mark.parametrize(
    ("shut", "unknown", "found", "answer"),
    [
        (False, None, ("cogging", "backlash"), ("cogging", "backlash")),
        (False, None, ("dwell",), ("cogging",)),
        (False, "a shape", ("cogging", "backlash"), ("cogging",)),
        (True, None, ("cogging", "backlash"), ("cogging",)),
    ],
)
def test_what_the_loop_alone_shows_to_be_missing_is_searched_for_again(
    shut: bool, unknown: str | None, found: tuple[str, ...], answer: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Next to a current loop, a backlash of 82 % of a gap left less along the path than a friction law does."""

    def standing(e: str, library: Any, *_: Any) -> Any:
        again = library.unordered(None, None)
        names = found if again else ("cogging",)
        return f"{e} {'again' if again else 'once'}", SimpleNamespace(fitted=SimpleNamespace(effects=names))

    def said(fits: Fits, selected: Any, _: Any) -> Any:
        closure = SimpleNamespace(open=not shut, refuted="")
        conclusions: Any = SimpleNamespace(unknown=unknown)
        validation: Any = Validation(None, closure, ())  # type: ignore[arg-type]
        return module.Held(selected, conclusions, None, validation)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "standing", standing)
    monkeypatch.setattr(module, "conclusions_that_hold", said)
    library = Library((), cast("Any", None), (0.0, 0.0))
    given: Any = (None, None, "data", library, None, ())
    e, held = answer_of(Fits(*given), cast("Any", SimpleNamespace(begin=lambda step: None)), cast("Any", None))
    assert cast("Any", held.selected).fitted.effects == answer
    assert e == f"data {'again' if answer == ('cogging', 'backlash') else 'once'}"
