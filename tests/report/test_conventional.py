"""Figures of the conventional identification: what they draw is what was found."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from matplotlib.lines import Line2D

from stagectl.config.stage_file import load_stage
from stagectl.identification import constant_speed, low_speed
from stagectl.identification.response import method as frequency_response
from stagectl.report.methods.conventional import figures, pictures
from stagectl.trajectories import Sequence, Trapezoid
from tests.identification.test_constant_speed import followed
from tests.identification.test_frequency_response import sine
from tests.identification.test_low_speed import slow
from tests.identification.virtual import STAGE_A, Array, Machine

SETUP = load_stage(STAGE_A)


def drawn(line: Line2D) -> Array:
    return np.asarray(line.get_data(), dtype=np.float64)


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    yield
    import matplotlib.pyplot as plt

    plt.close("all")


def test_bode_and_describing_function() -> None:
    captures = [sine(Machine(SETUP), a, f) for a in (5.0, 7.0, 9.0) for f in (3.0, 10.0, 40.0)]
    result = frequency_response.identify(captures, SETUP.file)
    bode, describing = figures(result, SETUP.file).values()
    gain, phase, coherence = bode.axes
    assert [axes.get_ylabel() for axes in bode.axes] == ["gain [dB re 1 rad/(s A)]", "phase [deg]", "coherence"]
    labels = gain.get_legend_handles_labels()[1]
    assert {"5 A sine", "7 A sine", "9 A sine"} <= set(labels) and any(
        "identified: J = 0.01" in label for label in labels
    )
    line = next(candidate for candidate in gain.lines if drawn(candidate).shape == (2, 3))
    curve = result.details["curves"][0]
    np.testing.assert_allclose(drawn(line)[1], 20.0 * np.log10(curve["gain"]))
    assert coherence.get_xlabel() == "frequency [Hz]" and len(phase.lines) >= 5
    assert describing.axes[0].get_ylabel() == "Re(Kt/H) [N m s/rad]"


def test_force_over_speed() -> None:
    motion = Sequence(tuple(Trapezoid(0.012 + 0.3 * v, v, 0.5, 0.1) for v in (0.03, 0.06)))
    result = constant_speed.identify([followed(Machine(SETUP), motion)], SETUP.file)
    (figure,) = figures(result, SETUP.file).values()
    points = figure.axes[0].lines[-1]
    np.testing.assert_allclose(drawn(points)[0], [span["speed"] for span in result.details["spans"]])
    assert figure.axes[1].get_xlabel() == "speed [rad/s]" and figure.axes[1].get_ylabel() == "residual [mN m]"


def test_rolling_friction_in_travel() -> None:
    result = low_speed.identify([slow(Machine(SETUP), seconds=35.0)], SETUP.file)
    (picture,) = pictures(result, SETUP.file)
    assert picture.image.startswith("data:image/png;base64,") and picture.caption == "Rolling-friction characteristic."
    (figure,) = figures(result, SETUP.file).values()
    whole, near = figure.axes
    assert whole.get_xlabel() == "travel since the reversal [µm]"
    assert 90.0 < max(np.max(drawn(line)[0], initial=0.0) for line in whole.lines) < 100.0
    assert 15.0 < near.get_xlim()[1] < 45.0
    assert whole.get_legend_handles_labels()[1].count("stop operators") == 1
