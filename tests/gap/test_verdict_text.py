"""The sentence, and the JSON that section 5 of the design asks for."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from stagectl.gap.result import remarks_text, verdict_text
from stagectl.gap.result.diagnosis import BLOCKS, FORM, NOISE, UNEXPLAINED, VERDICTS, FoundEffect, Gap
from stagectl.gap.result.result_json import NAME, NotADiagnosisError, as_json, load, restored, save
from stagectl.replacing import json_text
from stagectl.report.tables import gap as tables
from tests.gap.examples import ASYMMETRY, COGGING, SHAPE, VISCOUS, every, found, gap

FOUND = every()


def test_there_is_an_example_of_every_verdict() -> None:
    assert {diagnosis.verdict for diagnosis in FOUND.values()} == set(VERDICTS)


@pytest.mark.parametrize(
    ("verdict", "expected"),
    [
        ("effects", "82 % of the closable gap is viscous asymmetry (share 0.182), 9 % cogging or encoder eccentricity. "
                    "Position gap 2.9 -> 0.34 µm on held-out runs, noise floor 0.21 µm."),
        ("parameters", "These logs show no missing effect, but parameters of the model are off: 91 % of the "
                       "closable gap is viscous friction (0.168 N m s/rad). Position gap 2.9 -> 0.34 µm on held-out "
                       "runs, noise floor 0.21 µm."),
        ("effects+unknown", "55 % of the closable gap is presliding friction (length 14 µm). 37 % of the gap repeats "
                            "and is unexplained; it follows the position, which predicts 71 % of it on unused runs. "
                            "Position gap 2.9 -> 0.34 µm on held-out runs, noise floor 0.21 µm."),
        ("none", "The model agrees with the machine: these logs show no missing effect and no parameter error. "
                 "Position gap 230 nm on held-out runs, noise floor 210 nm."),
        ("controller", "The controller that ran is not the one described, so no loop is simulated. The "
                       "integral gain looks like 0.5 of the nominal one. Correct its description, then diagnose "
                       "again."),
        ("not-identifiable", "These logs do not identify the cause of the gap. Only one speed was run."),
        ("foreign", "82 % of the closable gap is viscous asymmetry (share 0.182). Effort gap 12 -> 3.1 N (10 % of the "
                    "effort) on held-out runs, noise floor not known: no held-out run was repeated."),
    ],
)  # fmt: skip
def test_the_sentence(verdict: str, expected: str) -> None:
    assert FOUND[verdict].sentence == expected


def test_repeats_that_contradict_each_other_are_no_agreement() -> None:
    """Their scatter is no noise floor where the model follows each of them more closely."""
    sentence = found("none", effects=(), gaps={}, gap=gap(0.87, 0.87, 18.0)).sentence
    assert "not of one machine" in sentence and "agrees" not in sentence


def test_what_oscillates_by_itself_is_looked_for_around_the_axis() -> None:
    oscillating = found("unknown", effects=(), unknown=SHAPE._replace(coordinate="frequency", line=7.3, fields=()))
    assert any("7.3 Hz" in line for line in remarks_text.lines(oscillating))
    assert remarks_text.outside(found("unknown", effects=(), unknown=SHAPE)) == []


def test_a_value_that_is_off_hides_no_effect() -> None:
    """However much more it takes of the gap: what is missing in the model is the news."""
    values = [
        ASYMMETRY._replace(name=name, share=0.3, parameter=True) for name in ("inertia", "viscous", "coulomb", "bias")
    ]
    sentence = found("effects", effects=(*values, ASYMMETRY._replace(share=0.05))).sentence
    assert sentence.startswith(
        "5 % of the closable gap is viscous asymmetry (share 0.182); parameters of the model are off as well: 30 % "
    )
    assert "and 1 smaller one." in sentence


def test_what_undoes_each_other_is_told_as_one() -> None:
    values = [
        ASYMMETRY._replace(name=name, share=share, parameter=True)
        for name, share in (("viscous", -1.7), ("bias", -0.9))
    ]
    sentence = found("effects", effects=(ASYMMETRY._replace(share=3.3), *values)).sentence
    assert sentence.startswith(
        "70 % of the closable gap is viscous asymmetry (share 0.182) together with viscous friction (0.182) "
        "and constant force on the axis (0.182), which partly cancel. "
    )


@pytest.mark.parametrize(
    ("shares", "beginning"),
    [
        ((-0.03,), "Missing in the model: viscous asymmetry (share 0.182). "),
        ((1.31,), "All of the closable gap is viscous asymmetry (share 0.182). "),
        ((0.97, -0.03), "97 % of the closable gap is viscous asymmetry (share 0.182), none of it Stribeck "),
        ((1.31, -0.4), "91 % of the closable gap is viscous asymmetry (share 0.182) together with Stribeck "),
        ((1.31, 0.4), "All of the closable gap is viscous asymmetry (share 0.182) together with Stribeck "),
        ((-0.4, -0.3), "Missing in the model: viscous asymmetry (share 0.182) together with Stribeck "),
    ],
)
def test_no_share_below_nothing_or_above_all_is_a_per_cent(shares: tuple[float, ...], beginning: str) -> None:
    names = ("viscous_asymmetry", "stribeck")
    effects = tuple(ASYMMETRY._replace(name=name, share=share) for name, share in zip(names, shares, strict=False))
    diagnosis = found("effects", effects=effects)
    assert diagnosis.sentence.startswith(beginning)
    printed = [*remarks_text.lines(diagnosis), *(cell for row in tables.effects(diagnosis).rows for cell in row)]
    figures = [float(figure) for figure in re.findall(r"(\S+) %", " ".join([diagnosis.sentence, *printed]))]
    assert all(0.0 <= figure <= 100.0 for figure in figures)


def test_where_the_model_comes_out_worse_all_of_the_gap_is_unexplained() -> None:
    grown = found("unknown", effects=(), unknown=SHAPE, shares=((UNEXPLAINED, 1.31), ("parameters", -0.31)))
    assert "All of the gap repeats and is unexplained" in grown.sentence and "131" not in grown.sentence


def test_what_may_be_missing_is_said_where_nothing_is_sure() -> None:
    likely = ASYMMETRY._replace(probability=0.48, alternatives=("bias",))
    words = found("none", effects=(likely,)).sentence
    assert words.startswith("No effect is certain. Viscous asymmetry or constant force on the axis: probability 0.48. ")
    unlikely = (likely._replace(probability=0.1),)
    open_gap = found("none", effects=unlikely, gaps={}, gap=gap(2.9, 2.8)).sentence
    assert open_gap.startswith("No effect of the library and no parameter explains the gap")


def test_without_a_floor_nothing_is_said_to_be_complete() -> None:
    """What was not repeated may hide anything: neither is an effect denied nor the model confirmed."""
    effects = (ASYMMETRY._replace(name="viscous", parameter=True),)
    off = found("parameters", effects=effects, gap=gap(2.9, 0.34, 0.0), gaps={}).sentence
    assert off.startswith("Parameters of the model are off: ") and "Without a repeat these logs do not show" in off
    none = found("none", effects=(), gap=gap(2.9, 2.8, 0.0), gaps={}).sentence
    assert "agrees" not in none and "do not show whether more is missing" in none


@pytest.mark.parametrize(("low", "off"), [(0.61, True), (0.02, False), (math.nan, True)])
@pytest.mark.parametrize("floor", [0.0, 0.1])
def test_a_gap_that_surely_shrinks_is_a_model_that_is_off(low: float, off: bool, floor: float) -> None:
    """70 % of it closed on runs left out of the fit, though no single parameter stands out."""
    closed = Gap(0.39, 0.21, floor, "N m", 0.70, low, 0.77)
    sentence = found("none", effects=(), gaps={}, gap=closed).sentence
    assert (sentence.startswith("The model is off") and "70 % of the gap" in sentence) is off


def test_effects_without_a_name_are_not_in_the_sentence() -> None:
    assert "Stribeck" not in FOUND["effects"].sentence and len(FOUND["effects"].effects) == 3
    many = tuple(ASYMMETRY._replace(name=f"effect_{n}") for n in range(5))
    assert "and 2 smaller ones" in found("effects", effects=many).sentence


@pytest.mark.parametrize("verdict", sorted(FOUND))
def test_json_has_the_keys_of_the_design_and_comes_back(verdict: str, tmp_path: Path) -> None:
    diagnosis = FOUND[verdict]
    result = json.loads(json.dumps(as_json(diagnosis), allow_nan=False))
    assert {"verdict", "effects", "gap", "where", "next_experiment"} <= set(result)
    assert set(result["where"]["blocks"]) == set(BLOCKS)
    assert {"before", "after", "floor", "unit", "closure"} <= set(result["gap"])
    for effect in result["effects"]:
        assert {"name", "alternatives", "probability", "share", "parameters"} <= set(effect)
        assert all(set(value) == {"value", "low", "high", "unit"} for value in effect["parameters"].values())
    back = load(save(diagnosis, tmp_path).parent)
    assert as_json(back) == result
    assert [effect.fields for effect in back.effects] == [effect.fields for effect in diagnosis.effects]
    assert (
        back.next_experiment == diagnosis.next_experiment and back.captures == diagnosis.captures and back.traces == ()
    )


def test_shapes_come_back(tmp_path: Path) -> None:
    sentence = found("effects+unknown", effects=(COGGING,), unknown=SHAPE._replace(fields=(("mechanics.bias", 1.0),)))
    back = load(save(sentence, tmp_path))
    assert back.unknown is not None and back.unknown.fields == (("mechanics.bias", 1.0),)
    np.testing.assert_array_equal(back.unknown.force, SHAPE.force)


def test_what_a_command_wrote_with_json_is_a_diagnosis_too(tmp_path: Path) -> None:
    sentence = found("effects+unknown", effects=(COGGING,), unknown=SHAPE)
    path = tmp_path / "answer.json"
    path.write_text(json_text(as_json(sentence)))
    assert as_json(load(path)) == as_json(sentence)


def test_what_is_no_number_is_null() -> None:
    sentence = found(
        "effects", gap=gap(2.9, 0.34)._replace(floor=math.nan), effects=(COGGING._replace(share=math.inf),)
    )
    result = as_json(sentence)
    assert result["gap"]["floor"] is None and result["effects"][0]["share"] is None
    assert math.isnan(restored(result).gap.floor)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        (None, ""),
        ("{", ""),
        ("[]", "verdict"),
        ('{"verdict": "perhaps"}', "verdict"),
        ('{"verdict": "none"}', "where"),
    ],
)
def test_a_file_that_is_not_a_diagnosis_is_refused(text: str | None, place: str, tmp_path: Path) -> None:
    if text is not None:
        (tmp_path / NAME).write_text(text)
    with pytest.raises(NotADiagnosisError) as refused:
        load(tmp_path)
    assert (refused.value.path, refused.value.place) == (tmp_path / NAME, place)


def test_a_wrong_entry_is_named(tmp_path: Path) -> None:
    data = as_json(FOUND["effects"])
    data["effects"][1]["share"] = "much"
    (tmp_path / NAME).write_text(json.dumps(data))
    with pytest.raises(NotADiagnosisError) as refused:
        load(tmp_path)
    assert (refused.value.place, refused.value.value) == ("effects[1].share", "much")


def test_ambiguity_and_advice_in_words() -> None:
    (line,) = remarks_text.ambiguous(FOUND["effects"])
    assert line == "Cogging or encoder eccentricity: these data fit each of them; cogging has probability 0.61."
    assert remarks_text.advice(FOUND["effects"])[0] == (
        "Next experiment: stairs both ways, 8 speeds. It separates cogging from encoder eccentricity by 11.3 sigma, "
        "and takes 14 s of machine time."
    )
    assert remarks_text.spans(FOUND["effects"])[2] == "micro-sine-8um-1.csv: nowhere"
    assert verdict_text.closure(Gap(2.0, 1.0, 0.1, "m", 0.752, 0.71, 0.79)) == "75 % (71 to 79 %)"


def test_an_effect_nobody_has_described_is_shown_by_its_name() -> None:
    odd = FoundEffect("brand_new_effect", (), 0.9, 0.5, {})
    assert "50 % of the closable gap is brand new effect." in found("effects", effects=(odd,)).sentence


def test_a_gap_that_stays_is_not_told_in_shares() -> None:
    """Near its floor the gap of the held-out position has no shares, and the sentence says that."""
    before = found("effects")
    stays = before._replace(gaps={}, gap=Gap(9.2e-6, 1.06e-5, 5e-6, "rad", -0.46, -1.6, -0.2, 0.45))
    text = verdict_text.sentence(stays)
    assert text.startswith("Missing in the model: ")
    assert "%" not in text and "closable" not in text
    assert text.endswith("; the model comes no closer.")
    assert "closable gap" in verdict_text.sentence(before) and "significant" not in verdict_text.sentence(before)


@pytest.mark.parametrize(("after", "left"), [(0.34e-6, False), (0.9e-6, True)])
def test_what_effects_leave_above_the_floor_is_said(after: float, left: bool) -> None:
    """Twice the floor is closed; above it, what is left has no cause that is known."""
    shares = (("parameters", 0.1), ("viscous_asymmetry", 0.8), (UNEXPLAINED, 0.09), ("not repeatable", 0.01))
    closed = Gap(2.9e-6, after, 0.21e-6, "rad", 0.9, 0.85, 0.95)
    result = found("effects", gap=closed, gaps={}, shares=shares)
    assert (" 9 % of the gap is left unexplained. " in verdict_text.sentence(result)) == left


def test_it_says_where_and_when_and_counts_further_captures() -> None:
    capture = FOUND["effects"].captures[0]
    lines = remarks_text.where(found("effects", captures=(capture,) * 11))
    assert lines[0] == "where in the loop: controller 0 %, drive 3 %, mechanics 95 %, sensor 2 %"
    opened = [line for line in lines if line.startswith("open in sine-1.6hz-1.csv")]
    assert len(opened) == remarks_text.MOST_SPANS and lines[-1] == "and 3 more captures"
    assert remarks_text.where(FOUND["none"]) == []


def test_the_form_of_the_friction_has_its_own_share() -> None:
    """It is no parameter that would be named: what it takes must not stand with those that are."""
    shares = (("parameters", 0.04), (FORM, 0.9), (NOISE, 0.06))
    result = found("parameters", effects=(VISCOUS,), shares=shares, friction=(("friction.law", "dahl"),))
    assert f"96 % of the closable gap is the {FORM}." in verdict_text.sentence(result)
    assert FORM not in verdict_text.sentence(result._replace(friction=()))
    zone = VISCOUS._replace(name="presliding")
    assert FORM not in verdict_text.sentence(result._replace(effects=(VISCOUS, zone)))
