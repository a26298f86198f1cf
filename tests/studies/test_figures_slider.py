"""The figures of the slider paper draw what they are given, in the units that their axes name."""

from __future__ import annotations

from collections.abc import Iterator

import matplotlib.pyplot as plt
import numpy as np
import pytest
from stagectl_studies.reproduction.figures_slider import Compensated, ShownRun, compensation, release, stroke_end

from tests.identification.slider import errors, recorded, slider, trapezoid


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    yield
    plt.close("all")


def test_stroke_end_and_release_draw_the_recording() -> None:
    rows = recorded(slider(), trapezoid())
    run = ShownRun("10 mm/s", rows, 0.6, 20.0)
    speed, force = stroke_end([run], (-0.1, 0.1)).axes
    reference, response = speed.lines[0], speed.lines[1]
    assert np.max(np.asarray(reference.get_ydata())) == pytest.approx(10.0)  # mm/s
    assert np.max(np.asarray(response.get_ydata())) == pytest.approx(10.0, rel=0.02)
    t, newton = np.asarray(force.lines[0].get_xdata()), np.asarray(force.lines[0].get_ydata())
    assert (t[0], t[-1]) == pytest.approx((-100.0, 100.0), abs=0.5)
    assert newton[0] == pytest.approx(20.0 * rows["measured_current"][1000], abs=1e-9)
    (position,) = release([run], (0.0, 0.1)).axes
    assert np.asarray(position.lines[0].get_ydata())[0] == 0.0
    assert position.get_ylabel() == "position [µm]" and force.get_ylabel() == "output force [N]"


def test_the_compensation_figure_has_the_papers_sign() -> None:
    rows = recorded(slider(), trapezoid())
    for instant in (0.6, 1.2):  # both turns: lagging is negative
        _, error = compensation([Compensated("none", rows, errors(rows))], instant).axes
        assert -5.0 < np.min(np.asarray(error.lines[0].get_ydata())) < -4.0
        assert error.lines[0].get_label() == "no compensation: -4.6 / +0.6 µm"
