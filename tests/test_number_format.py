"""Numbers on screens and pages."""

from __future__ import annotations

import math

from stagectl.gap.result.diagnosis import Value
from stagectl.number_format import Travel, duration, interval, length, percent, portion, prefix, three_digits, together

PER_UNIT = 0.012 / (2.0 * math.pi)  # m per rad
MICRON = 1e-6 / PER_UNIT  # rad
TRAVEL = Travel(PER_UNIT, "m", rotary=True)


def test_lengths_and_times_have_the_prefix_that_fits() -> None:
    assert [length(x, "m") for x in (2e-4, 4.97e-6, 1.23e-8, None)] == ["200 µm", "4.97 µm", "12.3 nm", "not reached"]
    assert [duration(x) for x in (24.8, 5e-4, 2e-5, 0.0)] == ["24.8 s", "0.5 ms", "20 µs", "0 s"]
    assert prefix(0.9996e-3) == ("m", 1e3) and prefix(0.0) == ("", 1.0)


def test_a_value_without_its_interval_has_three_digits() -> None:
    assert three_digits("slip", Value(2.0 * MICRON, 0.0, 0.0, "rad"), TRAVEL) == "2 µm"
    assert three_digits("share", Value(0.18234, 0.1, 0.2, ""), TRAVEL) == "0.182"


def test_numbers_share_the_prefix_of_the_largest() -> None:
    assert together((2.94 * MICRON, 0.336 * MICRON, 0.0), "rad", TRAVEL) == (["2.9", "0.34", "0"], "µm")
    assert together((0.0124, 3.1e-4), "A", TRAVEL) == (["12", "0.31"], "mA")
    assert together((math.nan, 1.5), "N", TRAVEL) == (["not known", "1.5"], "N")
    assert [portion(x) for x in (-0.001, -0.0001, 0.82, 1.004, 1.31)] == ["none", "0 %", "82 %", "100 %", "all"]
    assert [percent(x) for x in (0.824, 0.0041, -0.0001, 1.0)] == ["82 %", "0.4 %", "0 %", "100 %"]


def test_parameters_have_the_digits_of_their_interval() -> None:
    assert interval("time", Value(0.00123, 0.00113, 0.00133, "s"), TRAVEL) == "1.23 ms (1.13 to 1.33)"
    for name in ("phase", "second_phase", "phase_1"):
        assert interval(name, Value(1.2, 1.05, 1.35, "rad"), TRAVEL) == "1.20 rad (1.05 to 1.35)"
    assert interval("slip", Value(2.0 * MICRON, 1.9 * MICRON, 2.1 * MICRON, "rad"), TRAVEL) == "2.00 µm (1.90 to 2.10)"
    assert interval("order", Value(4.0, 4.0, 4.0, ""), TRAVEL) == "4"
    inertia = Value(0.010199, 0.0101968, 0.0102012, "kg m^2")
    assert interval("inertia", inertia, TRAVEL) == "0.010199 kg m^2 (0.0101968 to 0.0102012)"
    assert interval("rise", Value(0.3, -math.inf, math.inf, ""), TRAVEL) == "0.3"
