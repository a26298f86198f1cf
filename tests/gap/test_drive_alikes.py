"""Which of two scales of the current is kept: what the drive gives, or what it reports."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from stagectl.gap.selection import drive_alikes, refine

AMPLITUDES = {"current_gain": ["size"], "torque_path": ["gain", "gain_asymmetry", "offset", "directed_offset"]}


def valued(name: str, gain: float) -> Any:
    amplitudes = [SimpleNamespace(name=each) for each in AMPLITUDES[name]]
    values = {each.name: 0.0 for each in amplitudes} | {amplitudes[0].name: gain}
    return SimpleNamespace(effect=SimpleNamespace(name=name, amplitudes=amplitudes), values=values)


def fitted(name: str, left: float = 1e5, off: float = 0.0, gain: float = -0.05) -> Any:
    """With inertia and viscous friction `off` the nominal values, squared and in their widths."""
    return SimpleNamespace(effects=(valued(name, gain),), residual_sum_of_squares=left, model=off)


def evidence() -> Any:
    prior = SimpleNamespace(cost=lambda off, names: off if "inertia" in names else 0.0)
    return SimpleNamespace(base=SimpleNamespace(prior=prior, model=None))


@pytest.mark.parametrize(
    ("gain", "path", "kept"),
    [
        (0.020, 0.019, "current_gain"),  # a machine whose inertia is off anyhow: the simpler one
        (0.0002, 0.010, "current_gain"),
        (0.010, 0.0002, "torque_path"),  # the nominal values are those of the machine
    ],
)
@pytest.mark.parametrize("first", AMPLITUDES)
def test_the_nearer_scale_is_kept_or_the_simpler_one(
    gain: float, path: float, kept: str, first: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    both = {"current_gain": fitted("current_gain", off=gain), "torque_path": fitted("torque_path", off=path)}
    other = next(fit for name, fit in both.items() if name != first)
    monkeypatch.setattr(refine, "nuisances", lambda _: ["inertia", "viscous"])
    monkeypatch.setattr(drive_alikes, "other_scales", lambda *_: [other])
    now: Any = drive_alikes.nearest(evidence(), SimpleNamespace(forms=()), both[first])  # type: ignore[arg-type]
    assert now.effects[0].effect.name == kept


@pytest.mark.parametrize(
    ("name", "left", "as_good"),
    [
        ("torque_path", 1.09e5, True),  # efforts, and their noise, are 5 % larger
        ("torque_path", 1.13e5, False),
        ("current_gain", 1.0005e5, True),
        ("current_gain", 1.02e5, False),  # they are smaller
    ],
)
def test_the_other_scale_may_leave_the_noise_that_it_makes_larger(
    name: str, left: float, as_good: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = next(each for each in AMPLITUDES if each != name)
    sizes = AMPLITUDES[other]
    form = SimpleNamespace(
        effect=valued(other, 0.0).effect,
        typical=(0.1,) * len(sizes),
        values=lambda of: dict(zip(sizes, of, strict=True)),
    )
    tried = fitted(other, left)
    monkeypatch.setattr(drive_alikes, "shaped_as", lambda model, _: model)
    monkeypatch.setattr(refine, "refine", lambda *_: tried)
    library: Any = SimpleNamespace(forms=(form,))
    assert drive_alikes.other_scales(evidence(), library, fitted(name)) == ([tried] if as_good else [])
