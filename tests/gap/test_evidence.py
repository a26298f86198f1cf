"""The evidence against dense integrals: Gaussian densities of all rows, summed over all sets."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from stagectl.gap.effects.effect import Scales
from stagectl.gap.effects.library import definitions
from stagectl.gap.residuals.gram_matrices import Differences, Grams
from stagectl.gap.selection import evidence
from stagectl.gap.selection.candidates import EffectValues
from stagectl.gap.selection.constants import INCLUSION
from stagectl.gap.selection.evidence import Candidate, Conditioned, Prior, compare, conditioned, gains, means, temper
from stagectl.gap.selection.linearised import APART, Remains, powers_of, start_of
from stagectl.gap.selection.simulation_odds import simulated

ROWS = 40
SIZE = Scales(1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1e-3)
TORQUE_PATH = Candidate("torque_path", 1, Prior((1,), np.zeros(1), np.full(1, 3.0)), 1.0)
NONE = Conditioned(np.zeros((0, 0)), np.zeros(0), 0.0)


def _data(seed: int, columns: int, signal: dict[int, float]) -> tuple[np.ndarray, np.ndarray]:
    source = np.random.default_rng(seed)
    x = source.standard_normal((ROWS, columns)) + 0.5 * source.standard_normal((ROWS, 1))
    return x, x @ np.array([signal.get(k, 0.0) for k in range(columns)]) + source.standard_normal(ROWS)


def _start(x: np.ndarray, y: np.ndarray) -> Conditioned:
    return Conditioned(x.T @ x, x.T @ y, 0.0)


def _prior(places: tuple[int, ...], mean: float, deviation: float) -> Prior:
    return Prior(places, np.full(len(places), mean), np.full(len(places), deviation))


def _density(x: np.ndarray, y: np.ndarray, priors: list[Prior]) -> float:
    """log of the density of all rows with the amplitudes of `priors` integrated out, over that of noise alone."""
    mean, covariance = np.zeros(ROWS), np.eye(ROWS)
    for prior in priors:
        column = x[:, prior.places]
        mean = mean + column @ prior.mean
        covariance = covariance + column @ np.diag(prior.deviation**2) @ column.T
    noise = multivariate_normal.logpdf(y, np.zeros(ROWS), np.eye(ROWS))
    return float(multivariate_normal.logpdf(y, mean, covariance) - noise)


def test_each_amplitude_that_is_integrated_out_adds_its_evidence() -> None:
    x, y = _data(1, 5, {0: 1.0, 3: -2.0})
    priors = [_prior((0, 1), 0.3, 0.7), _prior((3,), -1.0, 0.5), _prior((2, 4), 0.0, 2.0)]
    state = _start(x, y)
    for count, prior in enumerate(priors):
        state = conditioned(state, prior)
        assert state.log_evidence == pytest.approx(_density(x, y, priors[: count + 1]))


def test_the_gain_of_a_candidate_is_what_it_adds() -> None:
    x, y = _data(2, 6, {1: 0.5})
    state = conditioned(_start(x, y), _prior((0,), 0.0, 1.0))
    tried = [
        Candidate("one", 0, _prior((1,), 0.2, 0.4), 1.0),
        Candidate("two", 1, _prior((2, 3), 0.0, 1.0), 1.0),
        Candidate("positive", 2, _prior((4,), 0.0, 1.0), 1.0, True),
    ]
    joined = [conditioned(state, c.prior, c.positive).log_evidence - state.log_evidence for c in tried]
    assert gains(state, tried) == pytest.approx(joined)


def test_an_amplitude_that_must_be_positive_has_twice_the_mass_above_zero() -> None:
    """The half-normal prior's integral, done by quadrature."""
    x, y = _data(3, 1, {0: 0.1})
    size = np.linspace(0.0, 10.0, 200_001)
    likelihood = np.exp(size * float(x[:, 0] @ y) - 0.5 * size**2 * float(x[:, 0] @ x[:, 0]))
    integral = np.trapezoid(2.0 * norm.pdf(size, 0.0, 1.0) * likelihood, size)
    (gain,) = gains(_start(x, y), [Candidate("one", 0, _prior((0,), 0.0, 1.0), 1.0, True)])
    assert gain == pytest.approx(np.log(integral), abs=1e-6)


def test_probabilities_are_those_of_all_sets_enumerated() -> None:
    x, y = _data(4, 4, {0: 0.6, 2: -0.5})
    tried = [Candidate(name, k, _prior((k,), 0.0, 1.0), 1.0) for k, name in enumerate("abcd")]
    verdict = compare(_start(x, y), tried, {})
    sets = [set_ for size in range(5) for set_ in itertools.combinations(range(4), size)]
    weight = {s: INCLUSION ** len(s) * np.exp(_density(x, y, [tried[k].prior for k in s])) for s in sets}
    whole = sum(weight.values())
    probability = verdict.of_effects()
    for k, name in enumerate("abcd"):
        expected = sum(value for s, value in weight.items() if k in s) / whole
        assert probability[name] == pytest.approx(expected, abs=1e-9)
    assert sum(verdict.of_sets().values()) == pytest.approx(1.0)


def test_sets_that_are_left_out_are_worth_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    x, y = _data(8, 16, {0: 3.0, 5: -2.0, 9: 0.5})
    tried = [Candidate(str(k), k, _prior((k,), 0.0, 1.0), 1.0) for k in range(16)]
    few = compare(_start(x, y), tried, {})
    monkeypatch.setattr(evidence, "NEGLIGIBLE", 1e-300)
    every = compare(_start(x, y), tried, {})
    assert len(few.sets) < len(every.sets)
    assert {item.members for item in few.sets} >= {(), *((k,) for k in range(16))}
    assert few.of_effects() == pytest.approx(every.of_effects(), abs=1e-5)


def test_forms_and_scales_of_one_effect_share_its_prior_and_never_stand_together() -> None:
    x, y = _data(5, 2, {0: 1.0})
    tried = [Candidate("a", k, _prior((k,), 0.0, 1.0), 0.5) for k in range(2)]
    verdict = compare(_start(x, y), tried, {})
    assert all(len(item.members) <= 1 for item in verdict.sets)
    odds = INCLUSION * np.mean([np.exp(_density(x, y, [candidate.prior])) for candidate in tried])
    assert verdict.of_effects()["a"] == pytest.approx(odds / (1.0 + odds))
    assert verdict.best(frozenset("a")).members == (0,)


def test_an_effect_and_its_wider_form_are_rivals() -> None:
    x, y = _data(6, 2, {0: 1.0, 1: 1.0})
    tried = [Candidate(name, k, _prior((k,), 0.0, 1.0), 1.0) for k, name in enumerate(("narrow", "wide"))]
    sets = compare(_start(x, y), tried, {"narrow": ("wide",)}).of_sets()
    assert frozenset({"narrow", "wide"}) not in sets and frozenset() in sets
    assert frozenset({"narrow", "wide"}) in compare(_start(x, y), tried, {}).of_sets()


def test_noise_alone_names_nothing() -> None:
    """Thirty effects that are not there, on fifty data sets: each probability is a small one."""
    largest = []
    for seed in range(50):
        x, y = _data(100 + seed, 30, {})
        tried = [Candidate(str(k), k, _prior((k,), 0.0, 1.0), 1.0) for k in range(30)]
        largest.append(max(compare(_start(x, y), tried, {}).of_effects().values()))
    assert np.mean(np.array(largest) > 0.5) <= 0.06
    assert np.median(largest) < 0.1


def test_a_direction_that_is_not_excited_keeps_its_prior() -> None:
    x, y = _data(7, 2, {0: 1.0})
    x[:, 1] = 0.0
    first, second = means(_start(x, y), [_prior((0,), 0.0, 10.0), _prior((1,), -0.3, 0.2)])
    assert first[0] == pytest.approx(1.0, abs=0.5)
    assert second[0] == -0.3
    assert means(_start(x, y), []) == []


def test_what_is_left_counts_once_a_half_stroke() -> None:
    assert temper(-5.0, 100) == 1.0
    assert temper(100.0, 100) == 0.5
    assert temper(1e8, 100) * 1e8 == pytest.approx(100.0, rel=1e-5)


def test_a_drift_counts_at_least_as_much_as_the_effort_it_is_in() -> None:
    assert powers_of((300.0, 100.0), 0.0, 100) == (0.25, 0.5, 1.0)
    assert powers_of((300.0, 100.0), 900.0, 100) == (0.25, 0.5, 0.25)
    assert powers_of((-300.0, 100.0), 900.0, 100) == (1.0, 0.5, 1.0)


def _odds(
    before: list[float],
    after: list[float],
    size: float = 0.01,
    current: float = 50.0,
    drift: float = 0.0,
    name: str = "dwell",
) -> float:
    """Of the effect of `size` whose simulation leaves `after` of each half stroke, over those of its being there.

    Without it repeats differ by `drift` more (sum of squares).
    """
    floor, samples = np.full(len(before), 1000.0), np.full(len(before), 5000.0)
    without, present = (Remains(floor + np.array(left), floor, samples, (len(left),), 50.0) for left in (before, after))
    effect = next(effect for effect in definitions(SIZE) if effect.name == name)
    valued = EffectValues(effect, {"rise": size * effect.amplitudes[0].typical[0], "time": 0.1, "length": 1e-3})
    without = without._replace(drift=drift)
    p = simulated(valued, without, present._replace(current=current), (0.1, 1.0, 0.5))
    return p / (1.0 - p) / INCLUSION


def test_no_effect_is_more_probable_than_its_simulation_fits() -> None:
    """However well its column explains what the values that are known of the friction leave."""
    assert _odds([1e5] * 100, [1e5] * 100) == pytest.approx(1.0, rel=0.02)
    assert _odds([1e5] * 100, [1e5] * 100, current=49.0) == pytest.approx(math.exp(0.5), rel=0.02)
    noise = 100.0 * math.sqrt(10.0)  # of the sum of ten
    assert _odds([400.0] * 10, [100.0] * 10) == pytest.approx(((noise + 4e3) / (noise + 1e3)) ** 5.0, rel=0.02)


def test_a_drift_shows_in_what_repeats_differ_by() -> None:
    """However large the error is that all repeats share; an effect that acts alike in all of them has no part in it."""
    shared = [1e6] * 10
    assert _odds(shared, shared, drift=20.0, name="thermal_coulomb") == pytest.approx(math.exp(5.0), rel=0.02)
    assert _odds(shared, shared, drift=20.0) == pytest.approx(1.0, rel=0.02)


def test_what_repeats_differ_by_has_the_power_of_its_own_likelihood() -> None:
    """Three repeats with one error of form and a drift: the error alone is tempered."""
    source = np.random.default_rng(9)
    ramp, form = np.array([-1.0, 0.0, 1.0]), 100.0 * source.standard_normal(ROWS)
    column = source.standard_normal(ROWS)
    y = form + 0.5 * np.outer(ramp, column) + source.standard_normal((3, ROWS))
    x = np.stack([np.outer(ramp, column), np.outer(np.ones(3), source.standard_normal(ROWS))]).reshape(2, -1)
    joined = np.vstack([x, y.reshape(1, -1)])
    apart = np.stack([joined[0], (y - y.mean(axis=0)).ravel()])
    g = Grams(
        ("drift", "form"), (joined @ joined.T)[None], np.zeros((1, 3, 3)), np.zeros((1, 2)), *[np.zeros(1, int)] * 2
    )
    power = temper(float(3.0 * form @ form), 10)
    found = start_of(g, [], (power, 1.0, 1.0), Differences((0,), (apart @ apart.T)[None]))
    assert found.right[0] == pytest.approx(x[0] @ y.ravel(), rel=1e-6)  # of white noise, as if no form were wrong
    assert found.right[1] == pytest.approx(power * x[1] @ y.ravel(), rel=1e-6)
    size = found.right[0] / found.gram[0, 0]
    assert size == pytest.approx(0.5, abs=4.0 / math.sqrt(x[0] @ x[0]))


def test_no_half_stroke_decides_alone() -> None:
    assert _odds([1e6, *[0.0] * 99], [0.0] * 100) < 1.0 / INCLUSION**1.3
    assert _odds([1e6, *[100.0] * 9], [0.0, *[200.0] * 9]) < 20.0


def test_half_strokes_that_err_alike_count_by_their_sum() -> None:
    """Four of ten have the error that an effect explains, the others have another one."""
    alike, alone = 60e3 / 15e3, 101.0 / 11.0  # ratios of the sums, and of what each of them leaves
    assert alone**2.5 < _odds([1e4, 2e3] * 5, [1e3, 2e3] * 5) < alike**5.0


def test_a_size_that_is_seldom_needs_a_better_fit() -> None:
    fit = [1e5] * 100
    assert _odds(fit, fit, size=16.0) == pytest.approx(0.007, rel=0.1)
    assert _odds(fit, fit, size=16.0) < 0.1 * _odds(fit, fit, size=3.0)


def test_two_scales_of_one_current_are_in_no_set_together() -> None:
    """With both, every force and every residual would be as small as one likes."""
    x, y = _data(3, 2, {0: 3.0, 1: 3.0})
    found = compare(_start(x, y), [Candidate("current_gain", 0, _prior((0,), 0.0, 3.0), 1.0), TORQUE_PATH], APART)
    assert {item.effects for item in found.sets} == {
        frozenset(),
        frozenset(["current_gain"]),
        frozenset(["torque_path"]),
    }
