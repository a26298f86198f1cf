"""What comes in as a capture: gaps, stamps, units, clipping: refused or said, with value, place and next step."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stagectl.config.stage_file import Setup
from stagectl.identification.capture import Capture, IdentificationError, Refusal
from stagectl.identification.capture_checks import check_possible, contradictions, implausible, suspicions
from stagectl.identification.captures import CURRENTS, opened, prepared
from stagectl.identification.least_squares import method as least_squares
from stagectl.identification.methods import identify
from stagectl.identification.result import Parameter, Topic, topics
from stagectl.recording.clipping import clipped
from stagectl.recording.hdf5 import Recording
from tests.identification.synthetic import DT, ROWS, TC, Array, D, J, motion

Spoil = Callable[[dict[str, Array]], object]


@pytest.fixture(scope="module")
def columns() -> dict[str, Array]:
    return motion()


def recording(columns: dict[str, Array], **meta: Any) -> Recording:
    rows = len(columns["time"])
    samples = np.zeros(rows, dtype=[(name, "<f8") for name in columns])
    for name, values in columns.items():
        samples[name] = values
    axis = {"kind": "rotary", "travel_per_unit": 0.012 / 2 / math.pi, "travel_unit": "m", "encoder_step": 5.992e-6}
    return Recording(Path("made.h5"), {"axis": axis, "dt": DT, **meta}, samples, True, "complete", 0)


def spoilt(columns: dict[str, Array], spoil: Spoil) -> Recording:
    copies = {name: values.copy() for name, values in columns.items()}
    spoil(copies)
    return recording(copies)


def silent(_done: int, _total: int) -> None:
    """Nobody watches."""


def solved(captures: list[Capture], setup: Setup) -> list[float]:
    parameters = identify("least-squares", captures, setup.file, silent, {}).parameters
    return [parameters[name].value for name in ("inertia", "viscous", "coulomb")]


def test_a_sound_recording_comes_as_it_is(columns: dict[str, Array], ball_screw: Setup) -> None:
    (capture,) = prepared([recording(columns)], ball_screw)
    np.testing.assert_array_equal(capture.position, columns["measured"])
    np.testing.assert_array_equal(capture.current, columns["measured_current"])
    assert capture.reference is not None and capture.excitation is None
    assert (capture.current_column, capture.dt) == ("measured_current", pytest.approx(DT))
    assert capture.notes == ()
    assert solved([capture], ball_screw) == pytest.approx([J, D, TC], rel=0.02)


@pytest.mark.parametrize("rows", [slice(9000, 9400), slice(9000, 9010), slice(0, 3), slice(19000, 19950)])
def test_a_gap_splits_and_the_rest_is_used(columns: dict[str, Array], ball_screw: Setup, rows: slice) -> None:
    left = {name: np.delete(values, rows) for name, values in columns.items()}
    parts = prepared([recording(left)], ball_screw)
    if rows.start == 0:
        assert [len(part.time) for part in parts] == [ROWS - 3] and parts[0].notes == ()
        return
    assert len(parts) == (1 if rows.stop == 19950 else 2)  # 50 rows are too few
    assert len(parts[0].time) == rows.start and parts[0].time[0] == 0.0
    assert Topic.GAPS in topics(parts[0].notes)
    assert f"from {DT * (rows.start - 1):.6g} to {DT * rows.stop:.6g} s" in parts[0].notes[0]
    if len(parts) == 1:
        assert topics(parts[0].notes[1:]) == {Topic.LEFT_OUT} and "380 rows" in parts[0].notes[1]
    else:
        assert len(parts[1].time) == ROWS - rows.stop
        assert Topic.GAPS not in topics(parts[1].notes)  # once for one record
        assert parts[1].name == f"made.h5 (part 2 of 2, from {DT * rows.stop:.6g} s)"
    assert solved(parts, ball_screw) == pytest.approx([J, D, TC], rel=0.02)


def test_a_part_that_stands_still_or_is_too_short_costs_only_itself(
    columns: dict[str, Array], ball_screw: Setup
) -> None:
    """One of four parts has the axis at rest, one too few rows for the filter of the regression."""
    left = {
        name: np.delete(values, [*range(9000, 9100), *range(12000, 12100), *range(12500, 12600)])
        for name, values in columns.items()
    }
    left["measured"][9000:11900] = left["measured"][9000]
    captures = prepared([recording(left)], ball_screw)
    assert [len(capture.time) for capture in captures] == [9000, 400, ROWS - 12600]
    assert Topic.LEFT_OUT in topics(captures[0].notes)
    fit = identify("least-squares", captures, ball_screw.file, silent, {})
    assert fit.parameters["inertia"].value == pytest.approx(J, rel=0.02)
    assert Topic.LEFT_OUT in topics(fit.notes)


def test_an_excitation_goes_with_their_part(columns: dict[str, Array], ball_screw: Setup) -> None:
    spans = [{"start": 1.0, "end": 4.0, "kind": "sine"}, {"start": 4.2, "end": 6.0}, {"start": 6.0, "end": 9.0}]
    left = {name: np.delete(values, slice(9000, 9400)) for name, values in columns.items()}
    first, second = prepared([recording(left, excitation=spans)], ball_screw)
    assert first.meta["excitation"] == spans[:1]
    assert second.meta["excitation"] == [{"start": pytest.approx(1.3), "end": pytest.approx(4.3)}]


def test_numbers_that_are_none(columns: dict[str, Array], ball_screw: Setup) -> None:
    """Two rows are bridged, a block splits; both are noted."""
    (capture,) = prepared(
        [spoilt(columns, lambda c: c["measured_current"].__setitem__(slice(500, 502), np.nan))], ball_screw
    )
    assert (len(capture.time), capture.dt) == (ROWS, pytest.approx(DT, rel=1e-9))  # the other rows stay where they were
    assert Topic.LEFT_OUT in topics(capture.notes) and "row 501" in capture.notes[0]
    assert solved([capture], ball_screw) == pytest.approx([J, D, TC], rel=0.02)
    both = prepared([spoilt(columns, lambda c: c["measured"].__setitem__(slice(500, 900), np.nan))], ball_screw)
    assert [len(part.time) for part in both] == [500, ROWS - 900]
    with pytest.raises(IdentificationError) as caught:
        prepared([spoilt(columns, interlaced)], ball_screw)
    assert (caught.value.reason, caught.value.value) == (Refusal.TOO_SHORT, 0)


def interlaced(columns: dict[str, Array]) -> None:
    columns["measured"][::2] = np.nan
    columns["measured_current"][1::2] = np.nan


@pytest.mark.parametrize(
    ("spoil", "kind", "token"),
    [
        (lambda c: c["time"].__setitem__(700, c["time"][699]), Refusal.TIME_ORDER, "row 701 repeats"),
        (lambda c: c["time"].__setitem__(700, 0.1), Refusal.TIME_ORDER, "row 701"),
        (lambda c: c["time"].__setitem__(slice(None), c["time"][::-1].copy()), Refusal.TIME_ORDER, "19999 of"),
        (lambda c: c["time"].__setitem__(5, np.nan), Refusal.NOT_FINITE, "row 6"),
        (lambda c: c["measured"].__setitem__(slice(None), 1.0), [Topic.AT_REST], "0 rad"),
        (lambda c: c["measured_current"].__setitem__(slice(None), 2.0), [Topic.CONSTANT_CURRENT], "2 A"),
        (lambda c: c["measured_current"].clip(-4.0, 4.0, out=c["measured_current"]),
         [Topic.CLIPPED], "4 A"),
        (lambda c: c["measured_current"].clip(None, 4.0, out=c["measured_current"]),
         [Topic.CLIPPED], "4 A"),
        (lambda c: c["measured"].__setitem__(slice(9000, None), c["measured"][9000]),
         [Topic.FROZEN], r"4\.5 s on"),
        (lambda c: c["measured"].__setitem__(5000, c["measured"][5000] + 3.0),
         [Topic.JUMP], r"2\.4995 s"),
        (lambda c: c["time"].__imul__(1e3),
         [Topic.UNITS], "in ms"),
        (lambda c: c["time"].__imul__(1e-3),
         [Topic.LIMIT, Topic.UNITS], "times are 1000 times too small"),
        (lambda c: c["measured"].__imul__(1e3),
         [Topic.LIMIT, Topic.LIMIT, Topic.UNITS], "positions are 1000 times too large"),
        (lambda c: c["measured"].__imul__(1e-3), [Topic.UNITS], "positions are 1000 times too small"),
        (lambda c: c["measured_current"].__imul__(1e3),
         [Topic.LIMIT, Topic.UNITS], "in mA"),
        (lambda c: c["measured_current"].__imul__(1e-3), [Topic.UNITS], "currents are 1000 times too small"),
        (lambda c: c["measured_current"].__imul__(-1.0), [Topic.UNITS], "opposite sign"),
        (lambda c: c["measured"].__imul__(180.0 / math.pi), [Topic.LIMIT, Topic.LIMIT, Topic.UNITS], "in deg"),
        (lambda c: c["measured"].__imul__(math.pi / 180.0), [Topic.UNITS], "in rad where deg is named"),
    ],
)  # fmt: skip
def test_a_spoilt_recording_is_refused(
    columns: dict[str, Array], ball_screw: Setup, spoil: Spoil, kind: Refusal | list[Topic], token: str
) -> None:
    with pytest.raises(IdentificationError, match=token) as caught:
        prepared([spoilt(columns, spoil)], ball_screw)
    assert caught.value.reason is (kind if isinstance(kind, Refusal) else Refusal.IMPLAUSIBLE)
    assert caught.value.capture == "made.h5" and str(caught.value).startswith("made.h5: ")
    assert isinstance(kind, Refusal) or caught.value.value == ", ".join(kind)


@pytest.mark.parametrize(("column", "factor"), [("measured_current", 1e-3), ("measured", 1e-3)])
def test_the_advice_is_about_the_column_that_is_wrong(
    columns: dict[str, Array], ball_screw: Setup, column: str, factor: float
) -> None:
    """The unit that it names is the one that the column is in."""
    entry = {"measured_current": "current=N:A", "measured": "position=N:"}[column]
    with pytest.raises(IdentificationError) as caught:
        prepared([spoilt(columns, lambda c: c[column].__imul__(factor))], ball_screw)
    assert entry in str(caught.value)


@pytest.mark.parametrize(("factor", "named"), [(1.02, False), (2.5, True)])
def test_captures_that_contradict_each_other_are_named(
    columns: dict[str, Array], ball_screw: Setup, factor: float, named: bool
) -> None:
    """Each by itself fits, together they do not: two machines, or two scales."""
    (one,) = prepared([recording(columns)], ball_screw)
    pair = [one, one._replace(name="other", current=factor * one.current)]
    found = least_squares.identify(pair, ball_screw.file)
    doubts = contradictions(pair, found, ball_screw.file)
    assert bool(doubts) is named and all("other" in doubt and one.name in doubt for doubt in doubts)
    assert contradictions([one], found, ball_screw.file) == []


@pytest.mark.parametrize(("high", "possible"), [(-0.001, False), (0.001, True)])
def test_a_negative_inertia_is_no_result(high: float, possible: bool) -> None:
    found = {"inertia": Parameter(-0.01, -0.02, high, "kg m^2")}
    if possible:
        check_possible(found)
        return
    with pytest.raises(IdentificationError) as caught:
        check_possible(found)
    assert caught.value.reason is Refusal.IMPLAUSIBLE and caught.value.admissible == "(0, inf)"


def test_a_clear_friction_speaks_for_the_columns() -> None:
    """A slow joint whose gravity is not modelled: its friction is found, the columns are not exchanged."""
    friction = Parameter(5.0, 4.8, 5.2, "N m")
    with pytest.raises(IdentificationError) as caught:
        check_possible({"inertia": Parameter(-0.01, -0.02, -0.001, "kg m^2"), "coulomb": friction})
    assert caught.value.reason is Refusal.ILL_CONDITIONED and caught.value.admissible == "(0, inf)"


def test_with_doubtful_it_is_noted_instead(columns: dict[str, Array], ball_screw: Setup) -> None:
    (capture,) = prepared([spoilt(columns, lambda c: c["measured_current"].__imul__(1e3))], ball_screw, doubtful=True)
    assert topics(capture.notes) == {Topic.LIMIT, Topic.UNITS} and "in mA" in capture.notes[-1]
    (strange,) = implausible({"inertia": 11.0, "viscous": 130.0, "coulomb": 900.0}, ball_screw.stage)
    assert "inertia is 11, 0.01 in the stage file; viscous is 130, 0.14" in strange
    assert "the currents are 1000 times too large" in strange


@pytest.mark.parametrize(
    ("values", "cause"),
    [
        ((0.011, 0.13, 0.9), None),
        ((0.2, 0.13, 0.9), None),
        ((11.0, 130.0, 0.9), "positions are 1000 times too small"),
        ((0.563, 7.8, 0.9), "in rad where deg is named"),
        ((1.1e4, 130.0, 0.9), "times are 1000 times too large"),
        ((1.1e-5, 1.3e-4, 0.9e-3), "currents are 1000 times too small"),
        ((0.0004, 0.0058, 0.037), "drive.wire.rated_current"),
        ((0.042, 0.6, 3.7), "motor.force_constant"),
        ((0.021, 0.28, 1.8), None),
        ((0.042, 0.6, 0.9), None),
        ((-0.011, 0.13, 0.9), "not the same machine, or a wrong unit"),
    ],
)
def test_what_was_found_is_compared_by_decades(
    ball_screw: Setup, values: tuple[float, float, float], cause: str | None
) -> None:
    doubts = implausible(dict(zip(("inertia", "viscous", "coulomb"), values, strict=True)), ball_screw.stage)
    assert (doubts == []) if cause is None else (cause in doubts[0])


@pytest.mark.parametrize("factor", [0.4, 1.0, 2.5])
def test_nominal_values_may_be_wrong(columns: dict[str, Array], ball_screw: Setup, factor: float) -> None:
    p = ball_screw.stage.mechanics
    other = p._replace(inertia=factor * p.inertia, viscous=factor * p.viscous)
    setup = ball_screw._replace(stage=ball_screw.stage._replace(mechanics=other))
    assert prepared([recording(columns)], setup)[0].notes == ()


@pytest.mark.parametrize(("column", "factor"), [("measured", 1e-3), ("time", 1e3)])
def test_wrong_units_are_seen_by_a_model_that_is_a_third_off(
    columns: dict[str, Array], ball_screw: Setup, column: str, factor: float
) -> None:
    """Slow or small motions leave the model its Coulomb friction alone, which explains a third of a force."""
    p = ball_screw.stage.mechanics
    other = p._replace(inertia=1.3 * p.inertia, viscous=1.3 * p.viscous)
    setup = ball_screw._replace(stage=ball_screw.stage._replace(mechanics=other))
    with pytest.raises(IdentificationError) as caught:
        prepared([spoilt(columns, lambda c: c[column].__imul__(factor))], setup)
    assert Topic.UNITS in str(caught.value.value)


def test_an_inertia_that_is_three_times_too_large_is_no_wrong_unit_of_time(
    columns: dict[str, Array], ball_screw: Setup
) -> None:
    """Slow, the axis is all friction, which is right; times a thousand times too small would hide the inertia."""
    velocity = np.gradient(columns["measured"], DT)
    acceleration = np.gradient(velocity, DT)
    force = TC * np.sign(velocity) + 0.34 * J * acceleration + 0.34 * D * velocity
    made = {**columns, "measured_current": force / ball_screw.file.motor.force_constant}
    (capture,) = prepared([recording(made)], ball_screw)
    assert Topic.UNITS not in topics(capture.notes)


def test_the_step_of_the_positions_names_their_unit(columns: dict[str, Array], ball_screw: Setup) -> None:
    """Millimetres of the table under a header in rad: a lead of 12 mm makes 1.91 of each step of the encoder."""
    step, per_unit = ball_screw.stage.encoder.step, 1e3 * ball_screw.file.axis.travel_per_unit
    made = {**columns, "measured": per_unit * step * np.round(columns["measured"] / step)}
    (capture,) = prepared([recording(made)], ball_screw, doubtful=True)
    (note,) = [note for note in capture.notes if topics((note,)) == {Topic.UNITS}]
    assert "in mm where rad is named" in note


def test_a_reference_comes_in_steps_only_where_it_was_measured(columns: dict[str, Array], ball_screw: Setup) -> None:
    """A smooth start's first changes are far below the rounding of the positions: of such a step all are multiples."""
    (capture,) = prepared([recording(columns)], ball_screw)
    smooth = np.array(columns["measured"]) + 1e-9 * np.sin(np.arange(len(columns["measured"])))
    start = np.r_[0.0, 1e-45, 1e-3 * np.sin(1e-3 * np.arange(1, len(smooth) - 1))]
    swapped = capture._replace(position=smooth, reference=capture.position)
    assert Topic.REFERENCE in topics(tuple(suspicions(swapped, ball_screw)))
    assert Topic.REFERENCE not in topics(tuple(suspicions(swapped._replace(reference=start), ball_screw)))


@pytest.mark.parametrize("late", [-3, 3])
def test_a_reference_rounded_to_counts_leads_the_position(
    columns: dict[str, Array], ball_screw: Setup, late: int
) -> None:
    """What comes in steps is the position where it is behind, and the reference where it is ahead."""
    (capture,) = prepared([recording(columns)], ball_screw)
    smooth = np.array(columns["measured"]) + 1e-9 * np.sin(np.arange(len(columns["measured"])))
    shifted = capture._replace(position=np.roll(smooth, late)[5:-5], reference=capture.position[5:-5])
    shifted = shifted._replace(current=capture.current[5:-5], time=capture.time[5:-5])
    assert (Topic.REFERENCE in topics(tuple(suspicions(shifted, ball_screw)))) == (late < 0)


def test_a_flat_top_is_no_clipping_by_itself() -> None:
    """A sine in steps of 4 mA, friction that saturates; cut off at 0.6 and at 0.95 of the amplitude."""
    time = np.arange(20000) * DT
    sine = 5.0 * np.sin(2.0 * math.pi * 1.6 * time)
    noise = np.random.default_rng(1).normal(0.0, 0.045, len(time))
    saturating = 1.4 * np.sign(sine) * (1.0 - 2.0 * np.exp(-((time * 3.2) % 1.0) / 0.05))
    for sound in (sine, sine + noise, 0.004 * np.round(sine / 0.004), 0.004 * np.round(saturating / 0.004), saturating):
        assert not len(clipped(sound))
    for cut in (0.6, 0.8, 0.95):
        rows = clipped(np.clip(sine + noise, -5.0 * cut, 5.0 * cut))
        assert len(rows) == pytest.approx(2.0 * math.acos(cut) / math.pi * len(time), rel=0.15)


def test_stamps_that_jitter_are_resampled(columns: dict[str, Array], ball_screw: Setup) -> None:
    jitter = np.random.default_rng(2).uniform(-0.2 * DT, 0.2 * DT, ROWS)
    time = columns["time"] + jitter
    moved = {name: np.interp(time, columns["time"], values) for name, values in columns.items()}
    (capture,) = prepared([recording({**moved, "time": time})], ball_screw)
    assert topics(capture.notes) == {Topic.RESAMPLED} and "every 0.5 ms" in capture.notes[0]
    np.testing.assert_allclose(capture.position, columns["measured"], atol=3e-3)
    assert solved([capture], ball_screw) == pytest.approx([J, D, TC], rel=0.02)
    rounded = {**columns, "time": np.round(columns["time"], 5)}  # digits only
    assert prepared([recording(rounded)], ball_screw)[0].notes == ()


def test_a_late_position_belongs_to_an_earlier_row(columns: dict[str, Array], ball_screw: Setup) -> None:
    late = {**columns, "measured": np.concatenate([columns["measured"][:1]] * 3 + [columns["measured"]])[:ROWS]}
    late["measured"][3:] = columns["measured"][:-3]
    (capture,) = prepared([recording(late, nm=3)], ball_screw)
    np.testing.assert_array_equal(capture.position, columns["measured"][: ROWS - 3])
    np.testing.assert_array_equal(capture.current, columns["measured_current"][: ROWS - 3])
    assert topics(capture.notes) == {Topic.DELAY} and "3 periods" in capture.notes[0]


def test_a_log_that_is_there_twice_is_refused(columns: dict[str, Array], ball_screw: Setup) -> None:
    """It would make all intervals too narrow; two motions in memory may be planned for one path."""
    with pytest.raises(IdentificationError) as caught:
        prepared([recording(columns), recording(columns)], ball_screw)
    assert (caught.value.reason, caught.value.capture) == (Refusal.GIVEN_TWICE, "made.h5")
    other = {name: column.copy() for name, column in columns.items()}
    other["measured"][-1] += 1e-9
    assert len(prepared([recording(columns), recording(other)], ball_screw)) == 2


def test_the_current_can_be_chosen(columns: dict[str, Array], ball_screw: Setup) -> None:
    more = {**columns, "command": 1.01 * columns["measured_current"]}
    assert prepared([recording(more)], ball_screw, "command")[0].current_column == "command"
    with pytest.raises(IdentificationError) as caught:
        prepared([recording(more)], ball_screw, "current")
    error = caught.value
    assert (error.reason, error.value, error.admissible) == (
        Refusal.MISSING_COLUMN,
        "current",
        "measured_current, command",
    )
    empty = {**more, "measured_current": np.full(ROWS, np.nan)}
    assert prepared([recording(empty)], ball_screw)[0].current_column == "command"
    assert CURRENTS[0] == "measured_current"


def test_columns_of_a_log_without_a_header(columns: dict[str, Array], ball_screw: Setup, tmp_path: Path) -> None:
    """Numbers count from 1; milliseconds, counts and mA are said in words of units."""
    table = np.column_stack(
        [
            1e3 * columns["time"],
            columns["time"],
            columns["measured"] * 2**20 / 2 / math.pi,
            1e3 * columns["measured_current"],
        ]
    )
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", fmt="%.9g")
    words = {"time": "1:ms", "position": "3:counts", "current": "4:mA"}
    (capture,) = prepared(opened([tmp_path / "log.csv"], ball_screw, words), ball_screw)
    np.testing.assert_allclose(capture.position, columns["measured"], atol=1e-6)
    assert solved([capture], ball_screw) == pytest.approx([J, D, TC], rel=0.02)
