"""The same capture fitted three ways: our method, scipy's output error, and CMA-ES over simulated rollouts.

The last is what BAM ("better actuator models", Rhoban) does for servos: a covariance-matrix evolution strategy over a
simulation of the actuator, its error the mean square of positions.  Both simulating fits have the same model, the same
five logarithms of parameters, the same start a fifth off, and are told the plant's own structure; each ends by itself.
"""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from stagectl.config.friction_laws import Rolling
from stagectl.config.stage_file import Setup
from stagectl.identification.capture import Capture
from stagectl.identification.simultaneous.method import identify
from stagectl.kernels import stage
from stagectl.kernels.jit import kernel

SUBSTEPS = 4
THINNED = 20  # rows of the position error that the simulating fits look at: every twentieth
WRONG = 1.2  # times the truth, where they start
SPREAD = 0.1  # of the logarithms, with which CMA-ES begins
SEED = 1


class Fit(NamedTuple):
    """What one of them took, and found."""

    seconds: float
    inertia: float  # kg m^2
    simulations: int


def simultaneous(captures: list[Capture], setup: Setup) -> Fit:
    """Our method."""
    begin = time.perf_counter()
    found = identify(captures, setup.file)
    return Fit(time.perf_counter() - begin, found.parameters["inertia"].value, 0)


@kernel
def _driven(p: stage.Stage, x: stage.State, inputs: Any, dt: float, substeps: int) -> stage.State:
    """The plant under measured currents: inputs = (currents (n,) A, positions (n,) to be filled)."""
    currents, positions = inputs
    for k in range(len(currents)):
        positions[k] = x.position
        x = stage.period(p, x, currents[k], stage.SILENT, dt, substeps)
    return x


class Misfit:
    """The position error of the simulated plant, over the logarithms of five parameters."""

    def __init__(self, capture: Capture, setup: Setup) -> None:
        friction, mechanics = setup.file.friction, setup.stage.mechanics
        assert isinstance(friction, Rolling)
        # The measured current is the motor's: no delay, no current loop.
        self._drive = setup.stage.drive._replace(current_quantum=0.0, delay_samples=0, current_lag=0.0)
        self._capture, self._setup, self._friction = capture, setup, friction
        self._positions = np.empty(len(capture.current))
        self.nominal = np.array(
            [mechanics.inertia, mechanics.viscous, friction.coulomb, friction.shortest, friction.longest],
            dtype=np.float64,
        )
        self.start = np.full(len(self.nominal), np.log(WRONG))
        self.count = 0

    def __call__(self, logarithms: Any) -> Any:
        """Errors (rad), thinned."""
        self.count += 1
        inertia, viscous, coulomb, shortest, longest = (float(value) for value in self.nominal * np.exp(logarithms))
        rolling = self._friction._replace(coulomb=coulomb, shortest=shortest, longest=max(longest, shortest))
        truth, capture = self._setup.stage, self._capture
        p = truth._replace(
            drive=self._drive,
            mechanics=truth.mechanics._replace(inertia=inertia, viscous=viscous),
            friction=truth.friction._replace(operators=rolling.operators()),
        )
        at_rest = stage.at_rest(p, capture.position[0])
        _driven(p, at_rest, (capture.current, self._positions), capture.dt, SUBSTEPS)
        return (self._positions - capture.position)[::THINNED]


def _fitted(capture: Capture, setup: Setup, solve: Callable[[Misfit], Any]) -> Fit:
    begin, error = time.perf_counter(), Misfit(capture, setup)
    found = solve(error)
    return Fit(time.perf_counter() - begin, float(error.nominal[0] * np.exp(found[0])), error.count)


def output_error(capture: Capture, setup: Setup) -> Fit:
    """By scipy's trust region."""
    return _fitted(
        capture,
        setup,
        lambda e: least_squares(e, e.start, x_scale=0.1, diff_step=[1e-4] * len(e.start), ftol=1e-6, xtol=1e-6).x,
    )


def cma_es(capture: Capture, setup: Setup) -> Fit:
    """By the `cma` package, with its own size of a population."""
    import cma

    options = {"seed": SEED, "verbose": -9, "tolx": 1e-5, "tolfun": 1e-16}
    return _fitted(
        capture, setup, lambda e: cma.fmin2(lambda x: float(np.mean(e(x) ** 2)), e.start, SPREAD, options)[0]
    )
