"""Pint gives the same factors: to the last bit for each unit in use, to rounding for made-up products."""

from __future__ import annotations

import functools
import itertools
import re
from typing import Any

import pint
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from stagectl import units
from stagectl.units import UnitError, factor
from tests.conftest import ROOT

DEFINITIONS = """
micro- = 1e-6 = u- = µ- = μ-
nano- = 1e-9 = n-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
kilo- = 1e3 = k-
mega- = 1e6 = M-
metre = [length] = m
second = [time] = s
kilogram = [mass] = kg
gram = 1e-3 kg = g
ampere = [current] = A
radian = [angle] = rad
count = [count] = count = counts
bit = [information] = bit
minute = 60 s = min
hour = 3600 s = h
revolution = 6.283185307179586 rad = rev
degree = 0.017453292519943295 rad = deg = °
arcminute = 2.908882086657216e-4 rad = arcmin
arcsecond = 4.84813681109536e-6 rad = arcsec
hertz = 1 / s = Hz
rpm = rev / min
newton = kg * m / s ** 2 = N
volt = kg * m ** 2 / A / s ** 3 = V
ohm = V / A = Ohm = Ω
percent = 0.01 = %
permille = 0.001 = ‰
"""
ATOMS = ("m", "s", "g", "A", "rad", "min", "h", "rev", "deg", "arcsec", "Hz", "N", "V", "Ohm", "metre", "newton")
PREFIXES = ("", "u", "n", "m", "c", "k", "M", "micro", "kilo")
SI = ("m", "s", "kg", "A", "rad", "N", "N m", "N m/A", "V", "Hz", "rad/s", "m/s^2", "kg m^2", "N m s/rad", "bit/s", "")


def _by_pint(unit: str, to: str) -> float | None:
    """The factor by a registry without memory: pint's own caches forget in which order a product was written."""
    registry = _registry()
    for memory in (registry._cache.root_units, registry._cache.conversion_factor):
        memory.clear()
    try:
        spelled = [" ".join(unit_name.split()).replace("·", "*") or "dimensionless" for unit_name in (unit, to)]
        return float(registry.Quantity(1.0, spelled[0]).to(spelled[1]).magnitude)
    except (pint.errors.UndefinedUnitError, pint.errors.DimensionalityError):
        return None
    except RecursionError:  # pint defines the kilogram by the gram and the gram by the kilogram
        assume(False)
        return None


@functools.cache
def _registry() -> Any:
    registry: Any = pint.UnitRegistry(None)
    registry.load_definitions(DEFINITIONS.strip().splitlines())
    return registry


def _ours(unit: str, to: str) -> float | None:
    try:
        return factor(unit, to)
    except UnitError:
        return None


def _declared() -> set[str]:
    """SI units of every quantity that the package declares."""
    sources = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "stagectl").rglob("*.py"))
    return {part.strip() for unit in re.findall(r'Quantity\(\s*"([^"]*)"', sources) for part in unit.split("|")}


def _written() -> set[str]:
    """What stands behind a number in the shipped configuration and the documents."""
    files = [*(ROOT / "config").rglob("*.yaml"), ROOT / "README.md"]
    text = "\n".join(path.read_text(encoding="utf-8") for path in files)
    words = re.findall(r"\d ([A-Za-zµμ°Ω%‰]+(?:[ ·*/^0-9A-Za-z-]*[A-Za-z0-9])?)", text)
    return {unit for unit in words if _ours(unit, unit) is not None}


USED = sorted(_declared() | set(SI))
# Relative; of two orders in which the factors of four powers are multiplied: no more than 24 roundings of 1.1e-16.
ROUNDING = 24 * 2.0**-53


def test_the_units_in_use_are_found() -> None:
    assert {"N m", "N", "rad", "m", "s", "A", "Hz"} <= set(USED)
    assert {"mm", "um", "Hz", "mm/s"} <= _written()


@pytest.mark.parametrize("to", USED)
def test_each_unit_in_use_has_the_factor_of_pint(to: str) -> None:
    written = sorted(_written())
    prefixed = [f"{prefix}{to}" for prefix in PREFIXES if to and to[0] != "1"]
    for unit in (*prefixed, *written, *USED):
        assert _ours(unit, to) == _by_pint(unit, to), (unit, to)


@pytest.mark.parametrize("prefix", units._PREFIXES)
def test_each_prefix_of_each_unit_has_the_factor_of_pint(prefix: str) -> None:
    names = [name for name in units._NAMED if name not in "%‰°"]  # pint rewrites these before it reads them
    for name, plural in itertools.product(names, ("", "s")):
        if not re.fullmatch("(k|kilo)g(ram)?s?", f"{prefix}{name}{plural}"):  # pint defines it by itself then
            for to in ("m", "s", "kg", "A", "rad", "N", "V", "Ohm", "Hz", "rad/s", "count", "bit", ""):
                unit = f"{prefix}{name}{plural}"
                assert _ours(unit, to) == _by_pint(unit, to), (unit, to)


@given(
    st.lists(
        st.tuples(st.sampled_from(PREFIXES), st.sampled_from(ATOMS), st.sampled_from((-3, -2, -1, 1, 2, 3))),
        min_size=1,
        max_size=4,
    ),
    st.lists(st.sampled_from(["*", "/", " "]), min_size=3, max_size=3),
    st.sampled_from(PREFIXES),
)
def test_a_product_of_units_has_the_factor_of_pint(
    parts: list[tuple[str, str, int]], signs: list[str], prefix: str
) -> None:
    words = [f"{before}{name}^{power}" if power != 1 else f"{before}{name}" for before, name, power in parts]
    unit = words[0] + "".join(f"{sign}{word}" for sign, word in zip(signs, words[1:], strict=False))
    to = "*".join(
        word.replace(part[0], prefix, 1) if part[0] else f"{prefix}{word}"
        for word, part in zip(words, parts, strict=True)
    )
    for target in (to, "m", "rad/s", ""):
        ours, pints = _ours(unit, target), _by_pint(unit, target)
        assert (ours is None) == (pints is None), (unit, target)
        assert ours is None or ours == pytest.approx(pints, rel=ROUNDING, abs=0.0), (unit, target)
