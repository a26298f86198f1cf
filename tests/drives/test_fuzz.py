"""Ten thousand frames at each end; tools/fuzz.py takes a million."""

from __future__ import annotations

import logging

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stagectl.drives.bus.frames import frame
from stagectl.drives.drive import Simulation
from stagectl.drives.simulated import Plant
from tests.drives.fuzzing import enables, fuzz_controller, fuzz_node
from tests.drives.workbench import DT, Script, Workbench, linear_stage

frames = st.builds(frame, st.integers(0, 0x7FF), st.binary(max_size=8))


def test_the_drive_takes_ten_thousand_frames(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.CRITICAL)
    assert "no motion" in fuzz_node(10_000, 5)


def test_the_controller_takes_ten_thousand_frames(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.CRITICAL)
    assert "no motion" in fuzz_controller(10_000, 5)


@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(frames, max_size=30))
def test_no_sequence_of_frames_gives_power_without_being_asked_to(bench: Workbench, sequence: list[bytes]) -> None:
    script = Script()
    node = bench.node(script)
    script.steps += [raw for raw in sequence if not enables(raw)]
    node.run(script.done)
    assert not node.axis.enabled
    assert node.axis.plant.position_counts == Plant(linear_stage(), Simulation(), DT).position_counts
