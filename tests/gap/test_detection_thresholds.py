"""An experiment with little information takes nothing from the others; a doubtful cause hides nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stagectl.gap.effects.effect import Amplitude, Definition
from stagectl.gap.inference import verdict
from stagectl.gap.residuals.gram_matrices import Grams
from stagectl.gap.result.diagnosis import FoundEffect
from stagectl.gap.selection import refine, search
from stagectl.gap.selection.candidates import EffectValues, Form
from stagectl.gap.selection.detection_thresholds import Clarity, clarity, thresholds
from stagectl.gap.selection.refine import Fitted
from stagectl.gap.selection.swap_tests import Selection
from stagectl.gap.selection.thresholds import SMALLEST_GAIN

EFFECT = Definition("effect", "mechanics", "none", (Amplitude("size", "", (1.0,)),), (), lambda p, _: p)
FORM = Form(EFFECT, {}, (1.0,), ("effect.size",))
HALF_STROKES = 24


def _data(size: float, off: float, experiments: int = 2) -> Grams:
    """An effect of `size` in unit noise; in the last experiment another law leaves `off` times the same column."""
    source = np.random.default_rng(5)
    squares, each = [], np.arange(experiments * HALF_STROKES)
    for k in each:
        column, noise = source.standard_normal((2, 20))
        last = k % experiments == experiments - 1
        rows = np.stack([np.ones(20), column, off * last * column, size * column + noise])
        squares.append(rows @ rows.T)
    nothing = np.zeros((len(each), 4, 4))
    names = ("constant", "effect.size", "null_0")
    return Grams(names, np.array(squares), nothing, np.zeros((len(each), 2)), each % experiments, each // experiments)


def test_an_experiment_in_which_the_law_shows_takes_nothing_from_the_other() -> None:
    clear, doubtful = _data(1.0, 0.0, 1), _data(1.0, 3.0)
    known = thresholds(doubtful, [0], [FORM])["effect"]
    assert known.limit > 2.0 * HALF_STROKES * 20  # more than all that the effect can take
    assert clarity(clear, [0], [FORM]).doubt == pytest.approx(clarity(doubtful, [0], [FORM]).doubt, rel=0.25)
    assert clarity(doubtful, [0], [FORM]).doubt < 0.2


def test_what_no_experiment_shows_stays_in_doubt() -> None:
    assert clarity(_data(0.0, 3.0), [0], [FORM]).doubt > 1.0
    alone = _data(1.0, 3.0, 1)  # the one experiment there is: the law gives more than the effect
    assert clarity(alone, [0], [FORM]).doubt > 1.0


def test_noise_gives_the_limit_where_no_law_does() -> None:
    g = _data(1.0, 0.0, 1)
    gain = SMALLEST_GAIN / clarity(g, [0], [FORM]).doubt
    assert gain == pytest.approx(HALF_STROKES * 20, rel=0.2)


def _selected(gains: dict[str, float], inclusion: dict[str, float]) -> Selection:
    effects = tuple(EffectValues(EFFECT._replace(name=name), {}) for name in gains)
    fitted = Fitted(None, effects, [], 0.0)  # type: ignore[arg-type]
    return Selection(fitted, {}, gains, {}, inclusion, dict.fromkeys(gains, Clarity(0.1, 0.0)), 0.0)


@pytest.fixture
def without_data(monkeypatch: pytest.MonkeyPatch) -> None:
    """A refit that only takes the effects it is given."""
    monkeypatch.setattr(refine, "refine", lambda e, model, effects, *_: Fitted(model, tuple(effects), [], 0.0))


@pytest.mark.usefixtures("without_data")
def test_an_idle_effect_goes_and_those_it_hid_are_judged_again(monkeypatch: pytest.MonkeyPatch) -> None:
    judged = [
        _selected({"lag": 6.0, "dwell": 160.0, "bias": 50.0}, {"lag": 0.9, "dwell": 1.0, "bias": 1.0}),
        _selected({"dwell": 1600.0, "bias": 500.0}, {"dwell": 1.0, "bias": 1.0}),
    ]
    answers, reports, nothing = iter(judged), list[str](), Any
    monkeypatch.setattr(search, "swap_tests", lambda *_: next(answers))
    selection = search._stable(nothing, nothing, judged[0].fitted, reports.append)  # type: ignore[arg-type]
    assert selection.gains == {"dwell": 1600.0, "bias": 500.0}
    (report,) = reports
    assert report.startswith("dropped lag: ")


def test_an_effect_alone_is_never_idle(monkeypatch: pytest.MonkeyPatch) -> None:
    selection, nothing = _selected({"dwell": 20.0}, {"dwell": 1.0}), Any
    monkeypatch.setattr(search, "swap_tests", lambda *_: selection)
    assert search._stable(nothing, nothing, selection.fitted, lambda _: None) is selection  # type: ignore[arg-type]


@pytest.mark.usefixtures("without_data")
def test_what_is_not_named_explains_nothing() -> None:
    selected, nothing = _selected({"cogging": 900.0, "dwell": 300.0}, {}), Any
    effects = [FoundEffect(name, (), p, 0.0, {}) for name, p in (("cogging", 0.9), ("dwell", 0.4))]
    sure = verdict.only_named(nothing, selected, effects)  # type: ignore[arg-type]
    assert [fitted.effect.name for fitted in sure.fitted.effects] == ["cogging"]
    assert verdict.only_named(nothing, sure, effects) is sure  # type: ignore[arg-type]


def test_an_experiment_alone_may_be_clear_of_what_is_left_in_the_others() -> None:
    """In one experiment all of the rest is the effect's; in the other, form error leaves ten times as much."""
    g = _data(1.0, 0.0)
    unexplained = np.zeros_like(g.effort)
    unexplained[:, -1, -1] = np.where(g.experiment == 1, 200.0, 0.0)  # of what no column explains
    g = g._replace(effort=g.effort + unexplained, floor=np.where(g.stroke >= 0, 20.0, 0.0)[:, None] * np.ones(2))
    both, first = clarity(g, [0], [FORM]), g.experiment == 0
    alone = g._replace(
        **{name: getattr(g, name)[first] for name in ("effort", "current", "floor", "experiment", "stroke")}
    )
    assert both.share == pytest.approx(clarity(alone, [0], [FORM]).share) and both.share > 0.8
    assert clarity(_data(0.1, 0.0, 1), [0], [FORM]).share == 0.0  # noise might give as much


def test_a_law_that_gives_as_much_in_one_experiment_makes_it_doubtful() -> None:
    """The first holds the effect and more that nothing explains; the second shows nothing but a friction law."""
    g = _data(1.0, 50.0)
    unexplained = np.zeros_like(g.effort)
    unexplained[:, -1, -1] = np.where(g.experiment == 0, 400.0, 0.0)
    clearness = clarity(g._replace(effort=g.effort + unexplained), [0], [FORM])
    assert clearness.doubt < 0.3 and clearness.share < 0.1


@pytest.mark.parametrize(
    ("name", "block", "apart", "clear"),
    [("cogging", "mechanics", False, 0.1), ("cogging", "mechanics", True, 1.0), ("dead_time", "drive", True, 0.4)],
)
def test_what_is_faint_on_all_data_is_clear_where_one_experiment_says_so(
    name: str, block: str, apart: bool, clear: float
) -> None:
    """250 units of an effect next to 10 000 unexplained ones; not for a delay, which shows in another channel."""
    gain = 250.0 if block == "mechanics" else 40.0
    selected = _selected({name: gain}, {name: 1.0})._replace(unexplained=10_000.0, clarity={name: Clarity(0.1, 0.6)})
    hidden = EffectValues(EFFECT._replace(name=name, block=block), {"time": 1e-4})
    assert verdict.clarity(selected, hidden, {"dead_time.time": 0.0}, apart) == pytest.approx(clear)
