"""The translator of kernels to C: it follows the kernels, and refuses what it does not know."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest

from stagectl.interchange.c_code import types as read
from stagectl.interchange.c_code.translation import Translation
from stagectl.interchange.c_code.types import TranslationError
from stagectl.kernels import equilibrium, friction, friction_bristle, stage


@pytest.fixture
def ours(monkeypatch: pytest.MonkeyPatch) -> None:
    """The functions of this file count as kernels."""
    monkeypatch.setattr(read, "PACKAGE", "tests.")


def test_a_changed_kernel_is_another_translation(monkeypatch: pytest.MonkeyPatch) -> None:
    before = Translation()
    before.add(stage.period)

    def stribeck(p: friction.Stribeck, v: float) -> float:
        return 1.0 + p.rise * math.exp(-abs(v) / p.velocity)

    monkeypatch.setattr(friction, "stribeck", stribeck)
    stribeck.__module__ = friction.__name__
    after = Translation()
    after.add(stage.period)
    assert before.text() != after.text()
    assert "return (1.0 + (p.rise * exp(((-fabs(v)) / p.velocity))));" in after.text()


def test_each_kernel_and_structure_stands_before_its_use() -> None:
    translated = Translation()
    for kernel in (stage.period, equilibrium.standing):
        translated.add(kernel)
    text = translated.text()
    assert text.index("static double friction_stops_between(") < text.index("friction_stops_between(p, s, dx, (-limit)")
    assert text.index("} effects_Harmonic;") < text.index("} plant_Motor;") < text.index("} plant_Stage;")


def test_defaults_are_filled_in() -> None:
    translated = Translation()
    translated.add(friction_bristle.bent)
    assert "static tuple2_double friction_bristle_bent(" in translated.text()
    translated.add(equilibrium.efforts)
    assert "plant_with_effects_Path" in translated.text()


def test_interpreted_kernels_translate_alike() -> None:
    """Whatever form the kernels have in a process, the C is the same."""
    compiled = Translation()
    compiled.add(stage.period)
    script = (
        "from stagectl.interchange.c_code.translation import Translation\n"
        "from stagectl.kernels import stage\n"
        "translated = Translation()\n"
        "translated.add(stage.period)\n"
        "print(translated.text(), end='')"
    )
    environment = {**os.environ, "STAGECTL_KERNELS": "interpreted"}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == compiled.text()


class Pair(NamedTuple):
    """A block."""

    first: float
    second: int = 3


def swapped(a: float, b: float) -> float:
    """Both at once."""
    a, b = b, a
    return a - b


def counted(p: Pair, values: Any) -> tuple[float, Pair]:
    """Loops, an array, a block with its default."""
    values[0] += p.first
    k = 0
    while k < p.second and values[k] > 0.0:
        k += 1
    for j in range(1, len(values)):
        if j == 2:
            break
        values[j] = float(k) / p.second
    return max(values[0], 1.0, 2.0), Pair(values[1])


@pytest.mark.usefixtures("ours")
def test_what_is_known() -> None:
    translated = Translation()
    assert translated.add(swapped) == "test_c_code_swapped"
    translated.add(counted)
    text = translated.text()
    assert "kept1_ = b;" in text and "kept2_ = a;" in text
    assert "(test_c_code_Pair){values.at[INT64_C(1)], INT64_C(3)}" in text
    assert "max_double(max_double(values.at[INT64_C(0)], 1.0), 2.0)" in text


def whole_division(a: int, b: int) -> int:
    """Has another sign rule in C."""
    return a // b


def chained(a: float) -> bool:
    """Two comparisons."""
    return 0.0 < a < 1.0


def truthy(a: float) -> float:
    """A number as a condition."""
    return 1.0 if a else 0.0


def looped(values: Any) -> float:
    """Not over a range."""
    total = 0.0
    for value in values:
        total += value
    return total


def retyped(a: float) -> float:
    """One name, two types."""
    b = 0
    b = a  # type: ignore[assignment]
    return b


def untyped(a) -> float:  # type: ignore[no-untyped-def]
    """Without a type."""
    return float(a)


def foreign(a: float) -> float:
    """A function of another package."""
    return math.gamma(a)


def caught(a: float) -> float:
    """An exception."""
    try:
        return 1.0 / a
    except ZeroDivisionError:
        return 0.0


def reserved(a: float) -> float:
    """A name of C."""
    double = a
    return double


def endless(a: float) -> float:
    """Calls itself."""
    return endless(a)


@pytest.mark.usefixtures("ours")
@pytest.mark.parametrize(
    ("function", "said"),
    [
        (whole_division, "`a // b` has no translation to C"),
        (chained, "`0.0 < a < 1.0` has no translation to C"),
        (truthy, "where <class 'bool'> is wanted"),
        (looped, "only a range can be looped over in C"),
        (retyped, "is of type <class 'float'>, where <class 'int'> is wanted"),
        (untyped, "test_c_code_untyped has no type for a"),
        (foreign, "gamma> is not a function of tests."),
        (caught, "`try:` has no translation to C"),
        (reserved, "the variable `double` has a name that C reserves"),
        (endless, "test_c_code_endless calls itself"),
    ],
)
def test_what_is_refused(function: Callable[..., Any], said: str) -> None:
    with pytest.raises(TranslationError) as error:
        Translation().add(function)
    assert said in str(error.value)
