"""The contact's laws against closed forms, and that none of them gives energy."""

import numpy as np
import pytest
from stagectl_studies.machine.contact import MEMORY, slip
from stagectl_studies.machine.machine import DAHL, MAXWELL, Floats, Law
from stagectl_studies.machine.stages import LAWS, believed, law_of, reversal, stage

UM = 2.0 * np.pi / 12000.0
S = np.linspace(0.0, 40.0 * UM, 801)


def force(law: Law, steps: Floats) -> Floats:
    mem = np.zeros(MEMORY)
    return np.array([slip(law, mem, mem, 0, (float(step), -1.0, 1.0)) for step in steps])


def test_maxwell_reversal_is_the_table() -> None:
    lengths, weights = np.array([1.0, 4.0, 9.0]) * UM, np.array([0.5, 0.2, 0.3])
    law = Law(MAXWELL, weights, 1.0 / lengths)
    table = (weights * np.clip(-1.0 + S[:, None] / lengths, -1.0, 1.0)).sum(axis=1)
    assert np.abs(reversal(law, S) - table).max() < 1e-12


@pytest.mark.parametrize("exponent", [0.5, 1.0, 1.5, 2.0])
def test_dahl_reversal_is_its_integral(exponent: float) -> None:
    """du/ds = -u^n/length from u = 2: Dahl (1968)."""
    length = 5.0 * UM
    law = Law(DAHL, np.ones(1), np.ones(1), length, exponent)
    s = S / length
    if exponent == 1.0:
        u = 2.0 * np.exp(-s)
    else:
        base = 2.0 ** (1.0 - exponent) - (1.0 - exponent) * s
        u = np.where(base > 0.0, np.abs(base) ** (1.0 / (1.0 - exponent)), 0.0)
    assert np.abs(reversal(law, S) - (1.0 - u)).max() < 1e-9


def test_dahl_does_not_depend_on_the_step() -> None:
    law = Law(DAHL, np.ones(1), np.ones(1), 5.0 * UM, 1.6)
    coarse, fine = force(law, np.full(8, 2.0 * UM)), force(law, np.full(64, 0.25 * UM))
    assert np.abs(coarse - fine[7::8]).max() < 1e-12


@pytest.mark.parametrize("kind", LAWS)
def test_no_law_gives_energy(kind: str) -> None:
    """Work over closed cycles of displacement is not negative, whatever the cycle's size."""
    random = np.random.default_rng(11)
    for _ in range(4):
        law = law_of(kind, random)
        for size in (1.0, 5.0, 40.0):
            x = size * UM * np.sin(2.0 * np.pi * np.arange(2401) / 800.0)
            z = force(law, np.diff(x))
            last = slice(1600, 2400)
            work = float(np.sum(z[last] * np.diff(x)[last])) / (size * UM)
            assert -1e-6 < work < 4.0


@pytest.mark.parametrize("kind", LAWS)
def test_a_long_slide_saturates(kind: str) -> None:
    law = law_of(kind, np.random.default_rng(5))
    assert 0.95 < force(law, np.full(400, 0.25 * UM))[-1] <= 1.0 + 1e-12


@pytest.mark.parametrize("kind", LAWS)
def test_the_user_knows_the_reversal_curve(kind: str) -> None:
    """Stop operators fitted to any law follow its reversal within 6 % of Coulomb; Maxwell is known exactly."""
    machine = stage(kind, np.random.default_rng(8))
    model = believed(machine, np.random.default_rng(1), 0.0)
    weight = model.weight / model.weight.sum()
    seen = (weight * np.clip(-1.0 + S[:, None] / model.slip, -1.0, 1.0)).sum(axis=1)
    gap = float(np.abs(seen - reversal(machine.law, S)).max())
    assert gap < (1e-12 if kind == "maxwell" else 0.06)
    assert model.weight.sum() == pytest.approx(machine.body.coulomb, rel=1e-9)
