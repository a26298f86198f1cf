"""The pictures of the effects: each effect has a text and a scene, and the scene shows the size of its effect."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.colors import same_color
from stagectl_studies.effect_pictures import pictures
from stagectl_studies.effect_pictures.measured_effect import motion_named, residuals
from stagectl_studies.effect_pictures.scenes import scenes
from stagectl_studies.effect_pictures.texts import chapters

from stagectl.config.stage_file import Setup
from stagectl.gap.effects.library import EFFECTS

SCENES = scenes()
# A step that comes 0.3 ms late has only 0.2 ms of the period for its way through the current loop (lag 0.159 ms).
LATE = 0.0005 * (math.exp(-0.2 / 0.159) - math.exp(-0.5 / 0.159))


def test_every_effect_has_a_text_and_a_scene() -> None:
    texts = [text for chapter in chapters() for text in chapter.effects]
    assert sorted(text.name for text in texts) == sorted(EFFECTS) == sorted(SCENES)
    assert all((text.what, text.size, text.mistaken_for, text.separated_by) for text in texts)


def test_a_text_says_why_a_stage_file_has_no_lines() -> None:
    texts = [text for chapter in chapters() for text in chapter.effects]
    assert {text.name for text in texts if text.lines} == {e.name for e in EFFECTS.values() if not e.in_stage_file}


def test_every_scene_is_drawn_over_a_coordinate_and_moves_as_the_library_knows(ball_screw: Setup) -> None:
    for scene in SCENES.values():
        assert scene.across in (*pictures.AXES, pictures.FREQUENCY)
        assert motion_named(ball_screw, scene.motion).duration > 1.0


@pytest.mark.parametrize(
    ("name", "across", "size"),
    [
        ("inertia", "acceleration", -0.1 * 0.010),  # N m per rad/s^2
        ("viscous", "velocity", -0.1 * 0.14),  # N m per rad/s
        ("force_constant", "current", 0.05 * 0.72),  # N m per A: more than the model's
        ("current_gain", "current", 0.02),  # A per A
        ("dead_time", "slope", -LATE),  # A per A/s
    ],
)
def test_a_line_has_the_slope_of_the_effect(ball_screw: Setup, name: str, across: str, size: float) -> None:
    """Least squares over the coordinate, in SI."""
    with_effect, without = residuals(ball_screw, SCENES[name])
    x, y = getattr(with_effect, across), with_effect.residual
    if across == "slope":  # where the command runs smoothly
        kept = np.abs(x) < 450.0
        x, y = x[kept], y[kept]
    slope = float(x @ y / (x @ x))
    assert slope == pytest.approx(size, rel=0.06)
    assert np.sqrt(np.mean(with_effect.residual**2)) > 10.0 * np.sqrt(np.mean(without.residual**2))


def test_a_constant_force_is_found_whole(ball_screw: Setup) -> None:
    with_effect, without = residuals(ball_screw, SCENES["bias"])
    moving = np.abs(with_effect.velocity) > 0.1 * np.abs(with_effect.velocity).max()
    assert float(np.mean(with_effect.residual[moving])) == pytest.approx(0.1, rel=0.01)
    assert abs(float(np.mean(without.residual[moving]))) < 1e-3


def test_a_picture_on_both_grounds(ball_screw: Setup, tmp_path: Path) -> None:
    """Axes with units, the machine with the effect and the one without, and nothing left open."""
    light, dark = pictures.pictures(ball_screw, SCENES["current_offset"], tmp_path)
    assert light.read_bytes()[:4] == dark.read_bytes()[:4] == b"\x89PNG"
    both = residuals(ball_screw, SCENES["current_offset"])
    figure = pictures.picture(ball_screw, SCENES["current_offset"], both, pictures.LIGHT)
    (axes,) = figure.axes
    assert axes.get_ylabel() == "unexplained current [A]" and axes.get_xlabel().endswith("[A]")
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == [
        "without the effect",
        "with it, forward",
        "with it, backward",
    ]
    plt.close(figure)
    figure = pictures.picture(ball_screw, SCENES["current_offset"], both, pictures.DARK)
    legend = figure.axes[0].get_legend()
    assert legend is not None
    assert all(same_color(text.get_color(), pictures.DARK.ink) for text in legend.get_texts())
    plt.close(figure)
    assert not plt.get_fignums()
