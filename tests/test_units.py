"""Units: exact where a person would expect it, strict about dimensions, deaf to look-alikes."""

from __future__ import annotations

import contextlib
import math
import time
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stagectl.units import LINEAR, ROTARY, Quantity, StageError, UnitError, factor, in_base_units, parse, quantity_of


@pytest.mark.parametrize(
    ("unit", "scale", "exponents"),
    [
        ("N m s/rad", 1.0, {"kg": 1, "m": 2, "s": -1, "rad": -1}),
        ("mm", 1e-3, {"m": 1}),
        ("V", 1.0, {"kg": 1, "m": 2, "A": -1, "s": -3}),
        ("rad/rad", 1.0, {}),
    ],
)
def test_exponents_of_the_base_units(unit: str, scale: float, exponents: dict[str, int]) -> None:
    assert in_base_units(unit) == (scale, exponents)


def test_an_unknown_unit_has_no_base_units() -> None:
    with pytest.raises(UnitError):
        in_base_units("furlong")


@pytest.mark.parametrize(
    ("text", "to", "value"),
    [
        ("12 mm", "m", 0.012),
        ("0.3 um", "m", 3e-7),
        ("9 µm", "m", 9e-6),  # micro sign
        ("9 μm", "m", 9e-6),  # Greek mu
        ("11.44 nm", "m", 1.144e-8),
        ("0.159 ms", "s", 0.000159),
        ("2 min", "s", 120.0),
        ("40 Hz", "Hz", 40.0),
        ("1 kHz", "Hz", 1000.0),
        ("20 1/s", "Hz", 20.0),
        ("1 Mbit/s", "bit/s", 1e6),
        ("300 mm/s", "m/s", 0.3),
        ("5 m/s^2", "m/s^2", 5.0),
        ("5 m/s**2", "m/s^2", 5.0),
        ("5 m s^-2", "m/s^2", 5.0),
        ("0.72 N m/A", "N m/A", 0.72),
        ("720 mN·m/A", "N m/A", 0.72),
        ("720 N*mm/A", "N m/A", 0.72),
        ("0.14 N m s/rad", "N m s/rad", 0.14),
        ("100 g m^2", "kg m^2", 0.1),
        ("3 kg m/s^2", "N", 3.0),
        ("4 mA", "A", 0.004),
        ("20 deg", "rad", math.radians(20)),
        ("20°", "rad", math.radians(20)),
        ("60 rpm", "rad/s", 2.0 * math.pi),
        ("1 rev", "rad", 2.0 * math.pi),
        ("5 %", "", 0.05),
        ("2 ‰", "", 0.002),
        ("-0.5", "", -0.5),
        ("  +1.5e-3   m ", "m", 0.0015),
        (".5 mm", "m", 0.0005),
        ("5. mm", "m", 0.005),
        ("12mm", "m", 0.012),
        ("12\u00a0mm", "m", 0.012),  # the space of a word processor
    ],
)
def test_a_value_is_the_double_nearest_to_what_stands_there(text: str, to: str, value: float) -> None:
    assert parse(text, to) == value


@pytest.mark.parametrize(
    ("text", "to", "reason"),
    [
        ("40", "Hz", "the unit is missing"),
        ("40 mm", "Hz", "'mm' does not measure Hz"),
        ("1 Hz", "rad/s", "'Hz' does not measure rad/s"),  # 1 Hz is 2 pi rad/s or 1/s; nobody knows
        ("1 rad/s", "Hz", "'rad/s' does not measure Hz"),
        ("1 N m", "N m/rad", "'N m' does not measure N m/rad"),  # the angle is a dimension
        ("1 rad", "", "'rad' does not measure a pure number"),
        ("1 N m", "N", "'N m' does not measure N"),
        ("1 MM", "m", "unknown unit 'MM', perhaps mm"),
        ("1 parsec", "m", "unknown unit 'parsec'"),
        ("1 m^99999", "m", "'m^99999' is not a unit"),
        ("1 m**-10", "m", "'m**-10' is not a unit"),
        ("5 1", "", "'1' is not a unit"),
        ("1 m + 1 m", "m", "'m + 1 m' is not a unit"),
        ("1 (m)", "m", "'(m)' is not a unit"),
        ("1e400 m", "m", "too large for a number"),
        ("1e308 Mm", "m", "too large for a number"),
        ("", "m", "not a number with a unit"),
        ("", "", "not a number"),
        ("1 Nm", "N m", "unknown unit 'Nm', perhaps N m"),
        ("1 mm/sec", "m/s", "unknown unit 'mm/sec', 'sec' in it, perhaps mm/second"),
        ("1 MB/s", "bit/s", "unknown unit 'MB/s', 'MB' in it, perhaps Mbit/s"),
        ("1 MBit/s", "bit/s", "unknown unit 'MBit/s', 'MBit' in it, perhaps Mbit/s"),
        ("90 d", "", "unknown unit 'd': a plain number belongs here"),
        ("4 secs", "s", "unknown unit 'secs', perhaps second"),
        ("15 Amps", "A", "unknown unit 'Amps', perhaps ampere"),
        ("1 MHZ", "Hz", "unknown unit 'MHZ', perhaps MHz"),
        ("1 m/s²", "m/s^2", "'m/s²' is not a unit: U+00B2 in it, type it in ASCII, a power as in m^2"),
        ("−1 mm", "m", "not a number with a unit: U+2212 in it, type it in ASCII"),
        ("fast", "m/s", "not a number with a unit"),
        ("nan", "", "not a number"),
        (".inf", "", "not a number"),
        ("1,5 mm", "m", "not a number with a unit; its decimals need a point"),
        ("1_000 mm", "m", "not a number with a unit"),
        ("0x10 m", "m", "'x10 m' is not a unit"),
        ("１２ mm", "m", "not a number with a unit: U+FF11 in it, type it in ASCII"),  # full-width digits
        ("١٢ mm", "m", "not a number with a unit: U+0661 in it, type it in ASCII"),  # Arabic digits
        ("12 ｍｍ", "m", "'ｍｍ' is not a unit: U+FF4D in it, type it in ASCII"),
        ("12 мм", "m", "'мм' is not a unit: U+043C in it, type it in ASCII"),  # Cyrillic
        ("1 " + "m " * 50, "m", "not a number with a unit"),
    ],
)
def test_what_is_no_such_quantity_is_refused_in_words(text: str, to: str, reason: str) -> None:
    with pytest.raises(UnitError) as caught:
        parse(text, to)
    assert str(caught.value) == reason
    assert isinstance(caught.value, StageError)


@pytest.mark.parametrize(
    ("unit", "to", "expected"),
    [
        ("mm", "m", 1e-3),
        ("um", "m", 1e-6),
        ("nm", "m", 1e-9),
        ("kN", "N", 1e3),
        ("g", "kg", 1e-3),
        ("ms", "s", 1e-3),
        ("h", "s", 3600.0),
        ("arcsec", "rad", math.pi / 648_000),
        ("arcmin", "rad", math.pi / 10_800),
        ("deg", "rad", math.pi / 180),
        ("rev", "rad", 2 * math.pi),
        ("rpm", "rad/s", math.pi / 30),
        ("V s", "kg m^2/A/s^2", 1.0),
        ("Ohm A", "V", 1.0),
        ("%", "", 0.01),
        ("", "", 1.0),
    ],
)
def test_factors(unit: str, to: str, expected: float) -> None:
    assert factor(unit, to) == pytest.approx(expected, rel=1e-15)


def test_a_factor_no_float_can_hold_is_refused() -> None:
    for unit in ("Mm^9/nm^9 * Mm^9/nm^9 * Mm^9/nm^9", "nm^9/Mm^9 * nm^9/Mm^9 * nm^9/Mm^9"):
        with pytest.raises(UnitError):
            factor(unit, "")
        with pytest.raises(UnitError):
            parse(f"0 {unit}", "")


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(["m", "rad", "N m/A", "kg m^2", "Hz", ""]))
def test_what_is_written_in_its_own_unit_comes_back(value: float, unit: str) -> None:
    assert parse(f"{value!r} {unit}", unit) == value


@given(st.integers(-(10**9), 10**9), st.sampled_from([("mm", -3), ("um", -6), ("nm", -9), ("km", 3)]))
def test_a_prefix_only_shifts_the_decimal_point(number: int, prefixed: tuple[str, int]) -> None:
    unit, power = prefixed
    assert parse(f"{number} {unit}", "m") == float(f"{number}e{power}")


@given(st.text(max_size=120), st.sampled_from(["", "m", "rad/s", "N m s/rad"]))
def test_any_text_is_a_finite_number_or_an_error(text: str, unit: str) -> None:
    with contextlib.suppress(UnitError):
        assert math.isfinite(parse(text, unit))


@pytest.mark.parametrize("text", ["1 " + " " * 10**6 + "!", "1" * 10**6, "1 " + "m " * 10**6, "1 m" + "^9" * 10**6])
def test_no_text_keeps_the_parser_busy(text: str) -> None:
    began = time.process_time()  # what other programs do does not count
    with pytest.raises(UnitError):
        parse(text, "m")
    with pytest.raises(UnitError):
        factor(text, "m")
    assert time.process_time() - began < 1.0


def test_the_declaration_beside_a_field() -> None:
    quantity = quantity_of(Annotated[float, Quantity("N m | N", "(0, 5]", "holds the axis")])
    assert quantity is not None
    assert (quantity.unit_for(ROTARY), quantity.unit_for(LINEAR)) == ("N m", "N")
    assert Quantity("s", "[0, 1]", "").unit_for(LINEAR) == "s"
    assert quantity.bounds() == (0.0, 5.0)
    assert quantity_of(Annotated[str, "text"]) is None
    assert quantity_of(float) is None


@pytest.mark.parametrize(
    ("interval", "inside", "outside"),
    [
        ("(0, 5]", (5e-324, 5.0), (0.0, -0.0, 5.000001, math.nan, math.inf, -1.0)),
        ("[0, 5)", (0.0, -0.0, 4.999999), (5.0, -5e-324, math.nan)),
        ("[-inf, inf]", (-math.inf, math.inf, 0.0), (math.nan,)),
        ("[1, 64]", (1, 64, 10), (0, 65, 10**400)),
    ],
)
def test_intervals(interval: str, inside: tuple[float, ...], outside: tuple[float, ...]) -> None:
    quantity = Quantity("", interval, "")
    assert all(quantity.admits(value) for value in inside)
    assert not any(quantity.admits(value) for value in outside)
