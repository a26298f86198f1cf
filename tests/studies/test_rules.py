"""What counts as an alarm, as named, found and covered; figures from hand and from the literature."""

import numpy as np
import pytest
from stagectl_studies.exam import intervals, rules, spans
from stagectl_studies.exam.detection_sizes import Noticed, intervals_of, limits
from stagectl_studies.exam.rules import Entry, Truth
from stagectl_studies.exam.scoring import naming, probabilities
from stagectl_studies.machine.effects import EFFECTS


def entry(name: str, *alternatives: str, p: float = 0.9, parameter: bool = False, change: float | None = None) -> Entry:
    return Entry(name, alternatives, p, parameter, change)


def truth(*hidden: str, offsets: tuple[str, ...] = (), companions: tuple[str, ...] = (), poor: bool = False) -> Truth:
    return Truth(hidden, companions, offsets, poor)


def scored(t: Truth, *named: Entry, verdict: str = "effects") -> dict[str, object]:
    return naming(t, {"verdict": verdict}, named, rules.considered(t, named))


def test_every_effect_has_a_class_and_a_coordinate() -> None:
    elsewhere = {"gravity", "torque_path", "cogging_map"}  # of measured records; no machine of the exam has them
    assert set(rules.CLASS_OF) == {*EFFECTS, *elsewhere}
    assert set(rules.COORDINATES) == {*EFFECTS, *elsewhere} - {"controller"}
    assert {effect.seen_in for effect in EFFECTS.values()} == set(rules.BLOCKS)


def test_the_name_first() -> None:
    assert scored(truth("dwell"), entry("dwell"), entry("cogging"))["top1"]
    second = scored(truth("dwell"), entry("cogging"), entry("dwell"))
    assert not second["top1"] and second["all_found"] and second["precision"] == 0.5
    ambiguous = scored(truth("dwell"), entry("stribeck", "dwell"))
    assert not ambiguous["top1"] and ambiguous["covered"] and ambiguous["all_found"]
    assert ambiguous["sizes"] == [2]
    nothing = scored(truth("dwell"), verdict="none")
    assert not any(nothing[name] for name in ("alarm", "top1", "covered", "all_found")) and nothing["top"] == "none"


def test_an_effect_that_no_library_has_is_only_itself() -> None:
    assert rules.same("cubic_hysteresis", poor=True) == {"cubic_hysteresis"}


def test_a_cogging_with_its_multiples_is_a_cogging() -> None:
    """That of the exam's machines has two harmonics; a lag, in contrast, is more than a Stribeck curve."""
    assert scored(truth("cogging"), entry("cogging_map"))["top1"]
    assert not scored(truth("stribeck"), entry("friction_lag"))["top1"]


def test_exact_symmetries_are_the_same_answer() -> None:
    assert scored(truth("force_constant"), entry("current_gain"))["top1"]
    assert scored(truth("jitter"), entry("dead_time"))["top1"]
    assert not scored(truth("bias"), entry("current_offset"))["top1"]
    assert scored(truth("bias", poor=True), entry("current_offset"))["top1"]


def test_a_common_scale_is_the_force_constant() -> None:
    common = [entry(name, parameter=True, change=0.05) for name in ("inertia", "viscous", "coulomb")]
    assert scored(truth("force_constant"), *common)["top1"]
    apart = [common[0], common[1]._replace(change=0.2), common[2]]
    assert not scored(truth("force_constant"), *apart)["top1"]


def test_values_that_are_off_are_no_false_alarm() -> None:
    shift = entry("viscous", parameter=True, change=0.1)
    assert not scored(truth(offsets=("viscous",)), shift, verdict="parameters")["alarm"]
    alarm = scored(truth(), shift, verdict="parameters")
    assert alarm["alarm"] and not alarm["effects_alarm"] and alarm["top"] == "viscous"
    assert scored(truth("dwell", offsets=("viscous",)), shift, entry("dwell"))["top1"]
    beside = scored(truth("dwell"), shift, entry("dwell"))
    assert not beside["top1"] and beside["top1_effects"]
    assert scored(truth("viscous", offsets=("viscous", "inertia")), shift)["top1"]


def test_an_effect_of_the_library_is_an_alarm_where_a_value_is_off() -> None:
    assert scored(truth(offsets=("viscous",)), entry("viscous_asymmetry"))["effects_alarm"]
    assert scored(truth(), verdict="unknown")["effects_alarm"]
    assert scored(truth(), verdict="not-identifiable")["alarm"]


def test_companions_are_passed_over() -> None:
    assert scored(truth("friction_lag", companions=("stribeck",)), entry("stribeck"), entry("friction_lag"))["top1"]
    assert not scored(truth("friction_lag", companions=("stribeck",)), entry("stribeck"))["all_found"]


def test_the_controller_is_an_answer() -> None:
    assert rules.entries({"verdict": "controller", "effects": []}) == [Entry("controller", (), 1.0, False)]
    entries = rules.entries({"verdict": "controller"})
    assert scored(truth("controller"), *entries, verdict="controller")["top1"]


def test_each_effect_has_an_entry_of_its_own() -> None:
    """One entry with many alternatives finds one effect; the best assignment counts."""
    both = truth("dwell", "stribeck")
    assert rules.found(both, [entry("presliding", "dwell", "stribeck")]) == [True, False]
    assert rules.found(both, [entry("dwell", "stribeck"), entry("dwell")]) == [True, True]
    three = truth("dwell", "stribeck", "cogging")
    assert sum(rules.found(three, [entry("stribeck"), entry("dwell"), entry("bias")])) == 2


def test_probabilities() -> None:
    pairs = probabilities(truth("dwell", "cogging", offsets=("inertia",)), [entry("dwell", p=0.7), entry("bias")])
    assert pairs == [[0.7, 1.0], [0.9, 0.0], [0.0, 1.0]]
    assert probabilities(truth("jitter"), [entry("dead_time", p=0.6)]) == [[0.6, 1.0]]


def test_when_the_gap_is_open() -> None:
    """Half of the truth and as much beside it: precision, recall and F1 are 1/2."""
    rows = np.zeros(400, dtype=bool)
    rows[100:200] = True
    truth_file = {"effects": [{"name": "dwell"}], "noise_free": {"a-1.csv": "a-1.csv", "a-2.csv": "a-1.csv"}}
    arrays = {"where/dwell/a-1.csv": rows}
    spans_of = [{"file": name, "spans": [[0.075, 0.125]]} for name in truth_file["noise_free"]]
    judgement = spans.judged(truth_file, arrays, spans_of)
    assert {name: judgement[name] for name in ("precision", "recall", "f1")} == {
        "precision": 0.5,
        "recall": 0.5,
        "f1": 0.5,
    }
    assert spans.judged(truth_file, arrays, spans_of[:1])["recall"] == 0.25
    assert spans.judged(truth_file, arrays, [])["f1"] == 0.0


@pytest.mark.parametrize(
    ("hits", "count", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson(hits: int, count: int, low: float, high: float) -> None:
    """Newcombe, Statistics in Medicine 17, 1998, table I, method 3."""
    assert intervals.wilson(hits, count) == pytest.approx((low, high), abs=5e-5)


def test_median() -> None:
    """Of ten values the second and the ninth hold the median with 97.9 % (Conover)."""
    assert intervals.median([float(k) for k in range(1, 11)]) == (5.5, 2.0, 9.0)
    assert intervals.median([3.0]) == (3.0, 3.0, 3.0)


def test_limits() -> None:
    """Drawn from the model itself, both limits come back within half an octave; what is always seen stays below."""
    random = np.random.default_rng(3)
    trials = []
    for kind, limit in (("drive", 0.7), ("structure", 2.0)):
        for scale in (0.5, 1.0, 2.0, 4.0) * 40:
            p = 1.0 / (1.0 + np.exp(-2.0 * np.log2(scale / limit)))
            trials.append(Noticed(kind, scale, bool(random.random() < p)))
    trials += [Noticed("parameters", scale, True) for scale in (0.5, 1.0, 2.0, 4.0) * 5]
    end = limits(trials)
    assert abs(np.log2(end["drive"] / 0.7)) < 0.5 and abs(np.log2(end["structure"] / 2.0)) < 0.5
    assert end["parameters"] < 0.4 and limits([]) == {}
    between = intervals_of(trials)
    assert all(between[kind][0] <= end[kind] <= between[kind][1] for kind in end)
    assert between["drive"][0] < 0.7 < between["drive"][1] and between["structure"][0] < 2.0 < between["structure"][1]
    few = intervals_of(trials[:40])["drive"]
    assert few[1] / few[0] > 1.3 * between["drive"][1] / between["drive"][0]  # a quarter of the trials
