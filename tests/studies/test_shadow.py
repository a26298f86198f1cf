"""The share of an effect against closed forms along the same motion."""

import numpy as np
import pytest
from stagectl_studies.machine.controller import prepared
from stagectl_studies.machine.effects import Rig, applied, draw_of
from stagectl_studies.machine.machine import Floats
from stagectl_studies.machine.plant import Setting, Trace, ideal, silent, simulated
from stagectl_studies.machine.shadow import current_share, position_share, reported_share, torque_share
from stagectl_studies.machine.stages import LAWS, believed, stage

from tests.studies.test_plant import AROUND, REFERENCE, rig_of

FINE = Setting(fine=True)


def along(rig: Rig) -> Trace:
    model = believed(stage("maxwell", np.random.default_rng(3)), np.random.default_rng(1), 0.0)
    rows = prepared(model, rig.loop, REFERENCE, np.zeros(REFERENCE.size))
    return simulated(ideal(rig.machine), rig.loop, rows, silent(REFERENCE.size), FINE)


def shared(name: str, kind: str = "maxwell") -> tuple[Rig, Rig, Trace, Floats]:
    plain = rig_of(kind)
    rig = applied(name, plain, draw_of(name, 5, 1.0, AROUND))
    trace = along(rig)
    return rig, plain, trace, torque_share(plain, trace, FINE)


@pytest.mark.parametrize("kind", LAWS)
def test_nothing_is_missing_from_the_same_machine(kind: str) -> None:
    rig = rig_of(kind)
    assert np.abs(torque_share(rig, along(rig), FINE)).max() < 1e-6


@pytest.mark.parametrize("name", ["compliance", "backlash", "base_vibration", "dwell", "stribeck", "ball_pass_ripple"])
def test_nothing_is_missing_from_the_same_machine_with_an_effect(name: str) -> None:
    """Below 1 % of the share of the effect itself."""
    rig, _, trace, share = shared(name)
    assert np.abs(torque_share(rig, trace, FINE)).max() < 0.01 * np.abs(share).max()


def test_share_of_the_rigid_body() -> None:
    rig, plain, trace, share = shared("inertia")
    acceleration = trace.fine[:: FINE.substeps, 2]
    wanted = (rig.machine.body.inertia - plain.machine.body.inertia) * acceleration
    assert share[:-1] == pytest.approx(wanted[:-1], abs=1e-6)
    rig, plain, trace, share = shared("viscous")
    wanted = (rig.machine.body.viscous - plain.machine.body.viscous) * trace.true_speed
    assert share[:-1] == pytest.approx(wanted[:-1], abs=1e-6)


def test_share_of_gravity_and_of_the_motor() -> None:
    rig, plain, trace, share = shared("bias")
    assert share[10:-1] == pytest.approx(-rig.machine.body.bias, abs=1e-6)
    rig, plain, trace, share = shared("force_constant")
    wanted = (plain.machine.motor.force_constant - rig.machine.motor.force_constant) * trace.fine[::20, 3]
    assert share[:-1] == pytest.approx(wanted[:-1], abs=1e-6)


def test_share_of_a_drive_and_of_an_encoder() -> None:
    rig, plain, trace, _ = shared("dead_time")
    share = current_share(rig, plain, trace, silent(trace.position.size))
    since = np.arange(1, 12) * 0.0005  # s since each step of the command acted
    kernel = np.exp(-since / 0.000159) - np.exp(-(since - 0.00025) / 0.000159)
    jumps = np.diff(trace.command, prepend=0.0)
    wanted = np.convolve(jumps, np.concatenate([[0.0, 0.0], kernel]))[: share.size]
    assert np.abs(share - wanted).max() < 1e-9 and np.abs(share).max() > 0.05
    rig, plain, trace, _ = shared("encoder_eccentricity")
    assert np.abs(position_share(rig, plain, trace) - (trace.position - trace.true_position)).max() < 1e-12
    rig, plain, trace, _ = shared("current_gain")
    gain = rig.machine.drive.reported_gain
    wanted = (gain - 1.0) / gain * trace.current
    assert reported_share(rig, plain, trace, FINE)[:-1] == pytest.approx(wanted[:-1], abs=1e-12)
