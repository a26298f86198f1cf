"""Comparisons against textbook figures, scipy's own tests, and the counts that a balanced order must have."""

from __future__ import annotations

import math
import re
from collections import Counter

import numpy as np
import pytest
from scipy import stats

from stagectl.paired_comparison import Figures, best, differences, order, verdict

NAMES = ["off", "ptc", "ptc+friction", "ptc+ilc"]


def drawn(means: list[float], spread: float, repeats: int = 6, seed: int = 4) -> list[Figures]:
    """Peaks (m) around `means` with a noise of each repeat that all share, and one of their own."""
    source = np.random.default_rng(seed)
    shared = source.normal(0.0, 10.0 * spread, repeats)
    figures = []
    for name, mean in zip(NAMES, means, strict=False):
        peak = mean + shared + source.normal(0.0, spread, repeats)
        figures.append(Figures(name, peak, 0.3 * peak))
    return figures


def test_the_order_is_balanced_and_seeded() -> None:
    """Each variant has each place twice in eight repeats; another seed, another order."""
    blocks = order(NAMES, 8, 1)
    places = Counter((name, place) for block in blocks for place, name in enumerate(block))
    assert set(places.values()) == {2}
    assert len(places) == 16
    assert blocks == order(NAMES, 8, 1) != order(NAMES, 8, 2)
    assert all(sorted(block) == sorted(NAMES) for block in order(NAMES, 5, 3))
    assert len({tuple(block) for block in blocks}) > 3


def test_intervals_and_probabilities_are_those_of_the_paired_t_test() -> None:
    figures = drawn([5.0e-6, 4.9e-6, 0.02e-6], 1e-7)
    for difference in differences(figures, figures[0]):
        mine = next(variant for variant in figures if variant.name == difference.name)
        expected = stats.ttest_rel(figures[0].peak, mine.peak)
        interval = expected.confidence_interval(0.95)
        assert difference.probability == pytest.approx(expected.pvalue, rel=1e-9)
        assert (difference.low, difference.high) == pytest.approx((interval.low, interval.high), rel=1e-9)


def test_holms_rule_by_hand() -> None:
    """Three differences whose p are known: the smallest times 3, the next times 2, never falling."""
    figures = drawn([5.0e-6, 4.8e-6, 4.9e-6, 4.99e-6], 1e-7)
    compared = sorted(differences(figures, figures[0]), key=lambda difference: difference.probability)
    p = [difference.probability for difference in compared]
    expected = [3 * p[0], max(3 * p[0], 2 * p[1]), min(1.0, max(3 * p[0], 2 * p[1], p[2]))]
    assert [difference.adjusted for difference in compared] == pytest.approx(expected, rel=1e-12)


def test_repeats_agree_whose_difference_has_the_sign_of_the_mean() -> None:
    """Lower in three of five repeats, the same in one and higher in one."""
    off = Figures("off", np.full(5, 5e-6), np.full(5, 1e-6))
    other = Figures("ptc", off.peak - np.array([1.0, 2.0, 0.0, -0.5, 1.5]) * 1e-6, off.rms)
    assert [(difference.agree, difference.repeats) for difference in differences([off, other], off)] == [(3, 5)]


def test_pairing_sees_what_the_shared_noise_hides() -> None:
    """A tenth of the shared noise is found, and the sentence has the figures in it."""
    figures = drawn([5.31e-6, 0.02e-6], 1e-9)
    sentence = verdict(figures, "m")[0]
    before, after = (float(np.mean(figure.peak)) * 1e6 for figure in figures)
    assert sentence.startswith(f"ptc cuts the peak error from {before:.2f} µm (off) to {after * 1e3:.1f} nm")
    assert f"({100 * (1 - after / before):.1f} % less); all 6 of 6 repeats agree (95 %: " in sentence


def test_worse_and_undecided_are_said() -> None:
    worse = verdict(drawn([1.0e-6, 2.0e-6], 1e-8), "m")
    assert len(worse) == 1
    assert worse[0].startswith("ptc raises the peak error from ")
    low, high = re.findall(r"95 %: (\S+) nm to (\S+) µm more", worse[0])[0]
    assert 950.0 < float(low) < 1000.0 * float(high) < 1050.0  # 1 µm more, and no "-1 µm less"
    assert "(100 times as much)" in verdict(drawn([1e-8, 1e-6], 0.0), "m")[-1]
    same = verdict(drawn([1.0e-6, 1.0e-6], 1e-8), "m")
    assert same[0].startswith("ptc: no difference from off is shown; ")


def test_chance_alone_is_rarely_certain() -> None:
    """Of 300 comparisons of three equal variants with a fourth at most 5 % name any difference; and not none."""
    wrong = 0
    for seed in range(300):
        figures = drawn([1e-6] * 4, 1e-8, 5, seed)
        wrong += any(difference.certain for difference in differences(figures, figures[0]))
    assert 2 <= wrong <= 22


def test_identical_repeats_give_no_false_certainty() -> None:
    """No interval and no probability where nothing has varied, and it is said; one repeat likewise."""
    figures = [Figures("off", np.full(5, 5e-6), np.full(5, 1e-6)), Figures("ptc", np.full(5, 4e-6), np.full(5, 1e-6))]
    (compared,) = differences(figures, figures[0])
    assert math.isnan(compared.low)
    assert math.isnan(compared.adjusted)
    assert not compared.certain
    words = verdict(figures, "m")
    assert words[0].startswith("All 5 repeats are identical")
    assert words[1] == "ptc: the peak error goes from 5.00 µm (off) to 4.00 µm (20.0 % less)."
    single = [Figures(x.name, x.peak[:1], x.rms[:1]) for x in figures]
    assert "--repeats 5" in verdict(single, "m")[0]


def test_the_lowest_is_named_with_those_not_shown_to_differ() -> None:
    figures = drawn([5e-6, 4e-6, 1e-6, 1e-6], 1e-8)
    lowest = best(figures).name
    assert lowest in ("ptc+friction", "ptc+ilc")
    other = next(name for name in NAMES[2:] if name != lowest)
    last = verdict(figures, "m")[-1]
    assert last.startswith(f"Lowest: {lowest} with ")
    assert last.endswith(f"; not shown to differ from it: {other}.")
    apart = drawn([5e-6, 4e-6, 1e-6], 1e-8)
    assert verdict(apart, "m")[-1].endswith("all others are higher, beyond chance.")
