"""The compensators of rolling friction: table, GMS and rheology along a reference, and made from a friction law."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.compensation import derived
from stagectl.compensation.forms import Compensators, Model, name_of, named
from stagectl.compensation.legs import Legs, legs
from stagectl.compensation.rolling import FORMS, GeneralisedMaxwell, ReversalTable, RheologySpring
from stagectl.kernels import friction, friction_bristle
from stagectl.kernels.plant import Friction
from tests.conftest import ROOT, SOURCES

Array = NDArray[np.float64]
DT, COULOMB = 5e-4, 2.0
WEIGHT, SLIP = (0.5, 0.7, 0.8), (1e-6, 4e-6, 9e-6)
OPERATORS = Friction(friction.bundle(WEIGHT, SLIP), friction.Stribeck())
BRISTLE = Friction(
    friction.bundle([0.0], [1.0]), friction.Stribeck(), friction_bristle.Bristle(COULOMB, COULOMB / 3e-6)
)


def made(form: str, p: Friction = OPERATORS) -> Any:
    """The compensator of this form of the friction `p`."""
    block = derived.block(form, p)
    if "stribeck" in block:
        block["stribeck"] = friction.Stribeck(**block["stribeck"])
    return FORMS[form](**{name: value for name, value in block.items() if name != "form"})


def sine(amplitude: float, periods: float = 3.0, frequency: float = 1.6) -> Legs:
    """A sine that begins at rest with its cosine's turn."""
    t = DT * np.arange(int(periods / (frequency * DT)) + 1)
    angle = 2.0 * np.pi * frequency * t
    return legs(amplitude * (1.0 - np.cos(angle)), amplitude * 2.0 * np.pi * frequency * np.sin(angle), DT)


def operators(cut: Legs) -> Array:
    """Forces (n,) of the law itself."""
    state = friction.relaxed(OPERATORS.operators)
    moves = np.diff(cut.path)
    return np.array([friction.stops(OPERATORS.operators, state, float(dx)) for dx in moves])


@pytest.mark.parametrize("form", ["table", "gms"])
def test_beyond_the_last_row_table_and_gms_are_the_operators(form: str) -> None:
    """After each full reversal, and from rest, the three are one law."""
    cut = sine(5e-3)
    assert made(form).along(cut) == pytest.approx(operators(cut), abs=1e-9)


def test_the_table_saturates_at_coulomb_friction() -> None:
    force = made("table").along(sine(5e-3))
    assert (force.max(), force.min()) == (pytest.approx(COULOMB), pytest.approx(-COULOMB))


def test_the_table_is_straight_between_its_rows() -> None:
    """Reversal at full friction, then 3 um back: half-way between the rows at 2 and 4 um."""
    p = ReversalTable((0.0, 2e-6, 4e-6, 10e-6), (-COULOMB, 0.0, 1.0, COULOMB))
    path = np.concatenate([np.linspace(0.0, 50e-6, 200), 50e-6 - np.linspace(0.0, 3e-6, 50)[1:]])
    cut = legs(path, np.gradient(path, DT), DT)
    assert p.along(cut)[-1] == pytest.approx(-0.5, abs=1e-2)


def test_at_an_inner_loop_the_paper_restarts_and_the_default_continues() -> None:
    """3 um back and then on: ``restart`` jumps to -T_c, ``continue`` goes on from the force that was reached."""
    back = 3e-6
    path = np.concatenate([np.linspace(0.0, 50e-6, 200), np.linspace(50e-6, 50e-6 - back, 60)[1:]])
    path = np.concatenate([path, np.linspace(path[-1], path[-1] + 1e-8, 30)[1:]])
    cut = legs(path, np.gradient(path, DT), DT)
    p = made("table")
    before = p.along(cut)[257]
    assert p.inner_loops == "continue"
    assert p.along(cut)[-1] == pytest.approx(before, abs=0.05)
    assert p._replace(inner_loops="restart").along(cut)[-1] == pytest.approx(-COULOMB, abs=0.05)


@pytest.mark.parametrize("form", ["gms", "rheology", "table"])
def test_no_compensator_jumps_on_small_motions(form: str) -> None:
    """A sine inside the rolling zone: no step of the force is larger than that of the steepest curve."""
    force = made(form).along(sine(2e-6))
    steepest = COULOMB / 1e-6 * 2e-6 * 2.0 * np.pi * 1.6 * DT
    assert np.max(np.abs(np.diff(force))) < steepest


def test_gms_slips_on_stribecks_curve() -> None:
    rise = friction.Stribeck(0.3, 0.01, 1.0)
    p, plain = GeneralisedMaxwell(WEIGHT, SLIP, rise), GeneralisedMaxwell(WEIGHT, SLIP)
    cut = sine(5e-3)
    assert np.max(np.abs(plain.along(cut))) == pytest.approx(COULOMB)
    assert np.max(np.abs(p.along(cut))) > 1.05 * COULOMB
    fastest = int(np.argmax(cut.speed))
    expected = COULOMB * friction.stribeck(rise, float(cut.speed[fastest]))
    assert abs(p.along(cut)[fastest]) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("form", ["table", "gms", "rheology"])
def test_a_bristle_is_held_by_every_form(form: str) -> None:
    """Dahl's curve after a full reversal, ``T_c (1 - 2 exp(-s / length))``, within 1 % of T_c; rheology within 7 %."""
    since = np.linspace(0.0, 20e-6, 400)
    p = made(form, BRISTLE)
    path = np.concatenate([np.linspace(0.0, -100e-6, 400), -100e-6 + since[1:]])
    force = p.along(legs(path, np.gradient(path, DT), DT))[399:]
    expected = COULOMB * (1.0 - 2.0 * np.exp(-since / 3e-6))
    low, high = (0.03, 0.07) if form == "rheology" else (0.001, 0.01)
    assert low * COULOMB < np.max(np.abs(force - expected)) < high * COULOMB


def test_stribecks_rise_goes_into_gms_alone() -> None:
    rising = OPERATORS._replace(stribeck=friction.Stribeck(0.2, 0.05, 2.0))
    assert made("gms", rising).stribeck == rising.stribeck
    assert made("table", rising) == made("table")
    assert isinstance(made("rheology", rising), RheologySpring)


def test_a_standstill_is_exactly_still() -> None:
    """The path of the legs does not move while the reference stands, whatever its rounding; no table reverses there."""
    t = DT * np.arange(4000)
    place = 1e-3 * np.clip(t - 0.2, 0.0, 1.0) + 1e-15 * np.sin(1e4 * t)
    velocity = np.where((t > 0.2) & (t < 1.2), 1e-3, 0.0) + 1e-15 * np.cos(1e4 * t)
    cut = legs(place, velocity, DT)
    assert not np.any(np.diff(cut.path)[2500:])
    assert made("table").along(cut)[-1] == pytest.approx(COULOMB)


def test_a_compensator_is_found_by_its_name() -> None:
    table = made("table")
    compared = Compensators(table=table)
    assert named("table", Model(), compared) is table
    assert named("gms", Model(), compared) is None
    assert named("model", table, Compensators()) == Model()
    assert (name_of(table), name_of(made("rheology")), name_of(Model())) == ("table", "rheology", "model")


BITS = """
import sys, hashlib
import numpy as np
from tests.compensation.test_rolling import made, sine
digest = hashlib.sha256()
for form in ("table", "gms", "rheology"):
    digest.update(made(form).along(sine(8e-6, 0.5)).tobytes())
print(digest.hexdigest())
"""


def test_compiled_and_interpreted_give_the_same_bits() -> None:
    outputs = set()
    for way in ("compiled", "interpreted"):
        environment = {**os.environ, "STAGECTL_KERNELS": way, "PYTHONPATH": SOURCES}
        outputs.add(subprocess.check_output([sys.executable, "-c", BITS], env=environment, cwd=ROOT))
    assert len(outputs) == 1
