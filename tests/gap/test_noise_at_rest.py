"""What the sensors add to a standing axis does not work its friction."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from stagectl_studies.machine.stage_trial import stage_trial
from stagectl_studies.machine.stages import reversal
from stagectl_studies.machine.trials import Options as Drawn
from stagectl_studies.machine.trials import draw

from stagectl.gap import diagnose
from stagectl.gap.logs import load_session
from stagectl.gap.residuals import friction_family
from stagectl.gap.residuals.noise_at_rest import quiet

DT = 5e-4


def test_noise_goes_and_ringing_stays() -> None:
    time = np.arange(1000) * DT
    ringing = 1e-3 * np.exp(-time / 0.02) * np.sin(2.0 * np.pi * 60.0 * time)
    creep = 1e-4 * time
    noise = 2e-6 * np.random.default_rng(1).standard_normal(len(time))
    after = quiet(ringing + creep + noise, [(100, 900)], DT)
    still = slice(600, 850)  # the ringing has died away
    assert np.std(np.diff(after[still])) < 0.05 * np.std(np.diff(noise[still]))
    assert np.allclose(after[still], creep[still], atol=1e-6)
    assert np.abs(after - ringing - creep)[100:160].max() < 2e-5  # 2 % of the ringing
    assert np.array_equal(after[:100], (ringing + creep + noise)[:100])


@pytest.mark.parametrize("seed", [1, 2])
def test_a_bristle_is_found_as_it_is(tmp_path: Path, seed: int) -> None:
    """Vibrations unload a standing bristle; sensor noise must not do it, and the current tells how far they did."""
    trial = draw(seed, "null-law", Drawn(short=True, law="dahl"))
    stage_trial(trial, tmp_path)
    fitted = diagnose.baseline(load_session.load([tmp_path / "captures"]), ()).base.model.stage.friction
    coulomb = trial.rig.machine.body.coulomb
    displacement = np.linspace(0.0, 20.0 * trial.rig.machine.law.length, 800)
    true = coulomb * (1.0 + reversal(trial.rig.machine.law, displacement))
    found = friction_family.reversal(fitted, displacement)
    assert np.abs(found - true).max() < 0.01 * 2.0 * coulomb
    assert fitted.bristle.coulomb > 0.9 * coulomb
