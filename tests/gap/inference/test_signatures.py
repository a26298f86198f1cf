"""What a drive does to single commands, on signals whose truth is known in closed form."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stagectl.gap.inference import signatures
from stagectl.gap.inference.signatures import MissingCurrent
from stagectl.kernels.stage import Drive

NOISE = 0.04  # A
DRIVE = Drive(current_quantum=0.0, delay_samples=1, current_limit=math.inf, current_lag=0.0)


def _logs(step: float, gain: float = 0.0) -> list[MissingCurrent]:
    """Three repeats of a sine with a rough command, rounded to `step` (0: not), their current late by two rows."""
    source = np.random.default_rng(11)
    logs = []
    for _ in range(3):
        command = 4.0 * np.sin(np.arange(12000) * 0.004) + 0.2 * source.standard_normal(12000)
        rounded = np.floor(command / step + 0.5) * step if step else command
        late = np.concatenate([np.zeros(2), (rounded - command)[:-2]]) + gain * np.concatenate(
            [np.zeros(2), command[:-2]]
        )
        logs.append(MissingCurrent(command, late + NOISE * source.standard_normal(12000), np.zeros(12000)))
    return logs


@pytest.mark.parametrize("step", [0.012, 0.02, 0.05])
def test_the_step_of_a_command_is_read_off(step: float) -> None:
    signature = signatures.quantised(DRIVE, _logs(step))
    assert signature is not None and signature.fields == (("drive.current_quantum", pytest.approx(step, rel=2e-3)),)
    assert signature.parameters["step"].low < step * 1.002 and signature.parameters["step"].high > step * 0.998


def test_steps_that_only_the_model_has_are_no_effect() -> None:
    """The file's wire rounds to 20 mA, the machine does not: the model's rounding is what is missing."""
    assert signatures.quantised(DRIVE._replace(current_quantum=0.02), _logs(0.02)) is None


@pytest.mark.parametrize("gain", [0.0, 0.03])
def test_noise_and_a_wrong_gain_are_no_steps(gain: float) -> None:
    assert signatures.quantised(DRIVE, _logs(0.0, gain)) is None


@pytest.mark.parametrize(("name", "found"), [("voltage_saturation", []), ("cogging", ["current_saturation"])])
def test_a_plateau_behind_a_limit_of_the_voltage_is_no_limit_of_the_current(
    name: str, found: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(signatures, "plateau", lambda _: SimpleNamespace(current=16.5, spread=3.0, gain=False))
    monkeypatch.setattr(signatures, "is_measured", lambda _: False)
    nothing: Any = SimpleNamespace(runs=())
    now: Any = SimpleNamespace(effects=(SimpleNamespace(effect=SimpleNamespace(name=name)),))
    assert [each.name for each in signatures.signatures(nothing, nothing, now, ()).found] == found


def _jittering(size: float) -> list[list[MissingCurrent]]:
    source = np.random.default_rng(3)
    answer = -800.0 * np.cos(np.arange(8000) * 0.05)  # A/s
    repeats = [
        MissingCurrent(
            answer, size * source.standard_normal(8000) * answer + NOISE * source.standard_normal(8000), answer
        )
        for _ in range(3)
    ]
    return [repeats]


def test_jitter_is_what_grows_with_the_slope_of_the_current() -> None:
    signature = signatures.jittered(signatures.jitter_of(_jittering(5e-5)))
    assert signature is not None and signature.fields == (("drive.jitter", pytest.approx(5e-5, rel=0.05)),)
    steady = signatures.jitter_of(_jittering(0.0))
    assert steady is not None and signatures.jittered(steady) is None
    assert steady.most < 1e-5


def test_an_error_of_the_mean_delay_is_no_jitter() -> None:
    late = [[log._replace(current=log.current + 2e-4 * log.answer) for log in run] for run in _jittering(0.0)]
    assert signatures.jittered(signatures.jitter_of(late)) is None


@pytest.mark.parametrize(
    ("sigma", "delays", "named"),
    [(9.0, (), True), (6.0, (), False), (6.0, (1e-4,), True), (6.0, (1e-3,), False), (3.0, (1e-4,), False)],
)
def test_next_to_a_short_delay_a_jitter_needs_less(sigma: float, delays: tuple[float, ...], named: bool) -> None:
    """Its mean is the delay: one cause of both."""
    found = signatures.Jitter(6e-5, 7e-5, sigma, 0.04)
    assert (signatures.jittered(found, delays) is not None) is named


def test_jitter_needs_repeats() -> None:
    assert signatures.jitter_of([run[:1] for run in _jittering(5e-5)]) is None
