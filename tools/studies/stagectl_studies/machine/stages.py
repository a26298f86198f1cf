"""Stages like stage A: random values, a random law of friction, and what their user believes of them."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from stagectl_studies.machine.battery import UM
from stagectl_studies.machine.contact import MEMORY, slip
from stagectl_studies.machine.controller import Model
from stagectl_studies.machine.jit import compiled
from stagectl_studies.machine.machine import BRISTLE, DAHL, MAXWELL, Body, Floats, Law, Machine

LAWS = ("maxwell", "dahl", "bristle")


class Ground(NamedTuple):
    """What a trial takes from another machine: its body, its contact and its noise, in the units of this one."""

    body: Body
    law: Law
    step: float  # rad, of the encoder
    sensor_noise: float  # A rms in the record


def maxwell(random: np.random.Generator) -> Law:
    """Elements of random number, weight and spacing."""
    n = int(random.integers(6, 25))
    lengths = np.geomspace(random.uniform(0.2, 0.6), random.uniform(6.0, 14.0), n)
    lengths = np.sort(lengths * np.exp(random.normal(0.0, 0.15, n))) * UM
    trend = (lengths / lengths[0]) ** random.uniform(-0.3, 0.3)
    weights = random.gamma(4.0, 1.0, n) * trend
    return Law(MAXWELL, weights / weights.sum(), 1.0 / lengths)


def dahl_law(random: np.random.Generator) -> Law:
    """Dahl with any exponent; a full reversal is 95 % done after 10 to 20 micrometres."""
    n, zone = float(random.uniform(0.5, 2.0)), float(random.uniform(10.0, 20.0)) * UM
    reach = np.log(20.0) if abs(n - 1.0) < 1e-3 else (2.0 ** (1.0 - n) - 0.1 ** (1.0 - n)) / (1.0 - n)
    return Law(DAHL, np.ones(1), np.ones(1), zone / float(reach), n)


def bristle_law(random: np.random.Generator) -> Law:
    """LuGre or elasto-plastic, with its own damping at low speed."""
    breakaway = 0.0 if random.random() < 0.4 else float(random.uniform(0.1, 0.6))
    length = float(random.uniform(3.0, 6.0)) * UM
    damping, speed = float(random.uniform(0.01, 0.06)), float(random.uniform(0.05, 0.5))
    return Law(BRISTLE, np.ones(1), np.ones(1), length, 1.0, breakaway, damping, speed)


def law_of(kind: str, random: np.random.Generator) -> Law:
    """A random law of a kind."""
    return {"maxwell": maxwell, "dahl": dahl_law, "bristle": bristle_law}[kind](random)


def stage(kind: str, random: np.random.Generator) -> Machine:
    """A stage like stage A."""
    body = Body(
        float(random.uniform(0.009, 0.0115)), float(random.uniform(0.10, 0.18)), float(random.uniform(0.75, 1.2)), 0.0
    )
    return Machine(law_of(kind, random), body)


def on(machine: Machine, ground: Ground | None) -> Machine:
    """The machine on the ground of another; itself where there is none."""
    if ground is None:
        return machine
    return machine._replace(
        law=ground.law,
        body=ground.body,
        encoder=machine.encoder._replace(step=ground.step),
        drive=machine.drive._replace(sensor_noise=ground.sensor_noise),
    )


@compiled
def walk(law: Law, dx: float, mem: Floats, out: Floats) -> None:
    """Normalised force after each of equal displacements."""
    for k in range(out.size):
        out[k] = slip(law, mem, mem, 0, (dx, -1.0, 1.0))


def reversal(law: Law, s: Floats) -> Floats:
    """Normalised force over the displacement since a full reversal, from -1 to 1, on an even grid `s`."""
    memory, out = np.zeros(MEMORY), np.empty(s.size - 1)
    memory[:40] = -1.0
    walk(law, float(s[1] - s[0]), memory, out)
    return np.concatenate([[-1.0], out])


def believed(machine: Machine, random: np.random.Generator, off: float) -> Model:
    """The user's model: stop operators as an identification finds them, all values off by up to `off`.

    A Maxwell contact is known element by element; any other law by twelve stop operators, fitted to its reversal
    curve (least squares, weights not negative).  The force constant is right.
    """
    law, body = machine.law, machine.body
    if law.kind == MAXWELL:
        weight, lengths = np.asarray(law.weights), 1.0 / np.asarray(law.inverse_slip)
    else:
        s = np.linspace(0.0, 60.0 * UM, 1201)
        grid = np.geomspace(0.3, 14.0, 12) * UM
        basis = np.clip(s[:, None] / grid - 1.0, -1.0, 1.0)
        weights = nnls(basis, reversal(law, s))[0]
        weight, lengths = weights[weights > 0.0], grid[weights > 0.0]
        weight = weight / weight.sum()
    wrong = 1.0 + off * random.uniform(-1.0, 1.0, 3)
    return Model(
        body.inertia * float(wrong[0]),
        body.viscous * float(wrong[1]),
        machine.motor.force_constant,
        weight * body.coulomb * float(wrong[2]),
        lengths,
    )
