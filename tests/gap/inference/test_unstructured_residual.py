"""What follows no coordinate of the motion: machines of the exam whose effect is left out of the library."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.gap.inference import unstructured_residual
from stagectl.gap.residuals.thresholds import KEPT
from stagectl.gap.residuals.whitening import Whitener
from stagectl.gap.result import verdict_text
from stagectl.gap.result.diagnosis import UNORDERED, UnknownTerm
from stagectl.number_format import Travel
from tests.gap.drawn import by_night, diagnosed, drawn

TRAVEL = Travel(1.0, "m", rotary=False)


@pytest.mark.parametrize(
    ("effect", "experiments", "coordinate", "block", "words"),
    [
        pytest.param("base_vibration", "", "frequency", "mechanics", "oscillates", marks=by_night),
        ("thermal_viscous", "sine-5.0 stairs held-sine-b", "time", "mechanics", "from run to run"),
        ("current_loop", "sine-5.0 multisine-1 held-sine-b", "frequency", "drive", "another current"),
    ],
)
def test_an_effect_left_out_is_told_by_where_it_is(
    tmp_path: Path, effect: str, experiments: str, coordinate: str, block: str, words: str
) -> None:
    diagnosis = diagnosed(drawn(tmp_path, 4711, effect, scale=3.0, experiments=experiments), effect)
    assert diagnosis.verdict in ("unknown", "effects+unknown") and diagnosis.unknown is not None
    assert (diagnosis.unknown.coordinate, diagnosis.unknown.block) == (coordinate, block)
    assert words in diagnosis.sentence and len(diagnosis.unknown.grid) == len(diagnosis.unknown.force) > 3


def test_an_encoder_that_errs_twice_a_signal_period_leaves_nothing_unknown(tmp_path: Path) -> None:
    """Offsets of its signals give a wave a period; unequal gains give a second one, which is named with it."""
    slow = "scan micro-8 held-sine-b held-micro"
    diagnosis = diagnosed(drawn(tmp_path, 13, "encoder_interpolation", scale=4.0, experiments=slow))
    assert diagnosis.verdict == "effects" and diagnosis.unknown is None
    found = next(effect for effect in diagnosis.named if effect.name == "encoder_interpolation")
    assert found.parameters["second_amplitude"].low > 0.0
    assert diagnosis.gap.after < 1.5 * diagnosis.gap.floor


def test_what_stays_open_in_the_loop_is_unknown_whatever_lies_along_the_path(tmp_path: Path) -> None:
    """A gap between motor and load, left out: what is left may be friction's form, but the loop's gap stays."""
    session = drawn(tmp_path, 1, "backlash", scale=4.0, experiments="sine-1.6 multisine-1 held-sine-b")
    diagnosis = diagnosed(session, "backlash")
    assert diagnosis.gap.after > 10.0 * diagnosis.gap.floor
    assert diagnosis.verdict == "unknown" and diagnosis.unknown == UNORDERED
    assert "no coordinate predicts most of it" in diagnosis.sentence


def test_the_noise_of_a_machine_that_ran_once_is_nothing_unknown(tmp_path: Path) -> None:
    session = drawn(tmp_path, 7, stratum="null-exact", experiments="sine-1.6 held-sine-b")
    once = session._replace(logs=tuple(log for log in session.logs if log.repeat == 1))
    diagnosis = diagnosed(once)
    assert diagnosis.verdict == "none" and "floor not known" in diagnosis.sentence


def test_a_band_holds_what_lies_in_it() -> None:
    """A sine of 45 Hz has all its squares, and its size, in the half octave around it."""
    run = SimpleNamespace(mean=SimpleNamespace(dt=5e-4))
    e: Any = SimpleNamespace(runs=[run])
    clock = 1e-3 * np.arange(8000)
    power, edges = (
        unstructured_residual.powers(e, [np.sin(2.0 * np.pi * 45.0 * clock)]),
        unstructured_residual.edges_of(e),
    )
    band = int(np.searchsorted(edges, 45.0)) - 1
    assert power[band] == pytest.approx(0.5 * len(clock), rel=0.02) and power.sum() == pytest.approx(
        power[band], rel=0.02
    )


def test_words_of_a_band() -> None:
    shape = UnknownTerm("frequency", np.array([10.0, 20.0]), np.array([0.1, 0.4]), 0.8)
    assert verdict_text.where_unknown(shape, TRAVEL).startswith("it oscillates, most near 20 Hz")
    assert "another current" in verdict_text.where_unknown(shape._replace(block="drive"), TRAVEL)


@pytest.mark.parametrize(
    ("lines", "of_laws", "found"),
    [((17.3, 17.3), 0.0, True), ((17.3, 19.0), 0.0, False), ((17.3, 17.3), 1.0, False), ((0.0, 0.0), 0.0, False)],
)
def test_one_line_in_time_comes_from_outside(lines: tuple[float, float], of_laws: float, found: bool) -> None:
    """In every run, at one frequency, and none that friction has on the same path; noise has no line."""
    rng, dt, count = np.random.default_rng(3), 1e-3, 8000
    time = dt * KEPT * np.arange(count)
    run = SimpleNamespace(mean=SimpleNamespace(dt=dt), weight=np.ones(count))
    flat = Whitener(np.array([1.0, 100.0]), np.ones(2), np.ones(2))
    e: Any = SimpleNamespace(runs=[run, run], base=SimpleNamespace(noise=flat))
    waves = [np.sin(2.0 * np.pi * line * time) for line in lines]
    residual = [3.0 * wave + rng.standard_normal(count) for wave in waves]
    members = [of_laws * wave + 0.01 * rng.standard_normal((4, count)) for wave in waves]
    term = unstructured_residual.oscillation(e, unstructured_residual.FreeRows(residual, members), 100.0)
    assert (term is not None) is found
    if term is not None:
        assert (term.coordinate, term.line) == ("frequency", pytest.approx(17.3, abs=0.05))
        assert term.predicted == pytest.approx(4.5 / 5.5, abs=0.05)
        assert "17.3 Hz" in verdict_text.where_unknown(term, TRAVEL)


def test_a_narrow_force_has_a_place() -> None:
    grid = np.linspace(-0.05, 0.05, 241)
    pulse = UnknownTerm("position", grid, np.exp(-0.5 * ((grid - 0.015) / 1e-3) ** 2), 0.8)
    assert "near 15.0 mm" in verdict_text.where_unknown(pulse, TRAVEL)
    assert verdict_text.narrow_place(pulse._replace(force=np.sin(100.0 * grid))) is None
