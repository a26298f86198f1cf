"""The figures of the zero-crossing identification draw what they are given, in the units that their axes name."""

from __future__ import annotations

import numpy as np
import pytest

from stagectl.config.stage_blocks import Axis
from stagectl.report.methods.zero_crossing import forces_over


def test_the_forms_are_drawn_over_time_and_velocity() -> None:
    t = np.linspace(-0.1, 0.1, 50)
    names = ("friction", "exponential", "displacement", "symmetric", "symmetric-free")
    curves = {"time": t, "velocity": -0.1 * t, **{name: np.full(50, float(k)) for k, name in enumerate(names)}}
    details = {"curves": {name: values.tolist() for name, values in curves.items()}}
    (left,) = forces_over("time", details).axes
    (right,) = forces_over("velocity", details).axes
    assert [line.get_label() for line in left.lines[:2]] == [
        "measured: F - M a - D v",
        "proposed (exponential), rms 1 N",
    ]
    assert np.asarray(left.lines[0].get_xdata())[0] == pytest.approx(-100.0)  # ms
    assert np.asarray(right.lines[0].get_xdata())[0] == pytest.approx(10.0)  # mm/s
    assert right.get_xlabel() == "velocity [mm/s]"
    screw = forces_over("velocity", details, Axis("rotary", 12e-3)).axes[0]
    assert np.asarray(screw.lines[0].get_xdata())[0] == pytest.approx(10.0 * 12.0e-3 / (2.0 * np.pi))
    assert screw.get_ylabel() == "friction [N m]"
