"""One machine with three encoders, simulated in its closed loop: what a coarse one says agrees with a fine one."""

from __future__ import annotations

from pathlib import Path

import pytest

import stagectl as sc
from stagectl.identification.result import Parameter

STAGE = Path(__file__).parents[2] / "config" / "ball-screw.yaml"
LEGS = "type: trapezoid\ndistance: 4 mm\nvelocity: 20 mm/s\nacceleration: 0.15 m/s^2\ndwell: 0.1 s\ncycles: 8\n"
COUNTS = (4096, 20000, 2**20)  # the rolling zone, 9 um, is three steps of the first
TRUE = {"inertia": 0.010, "viscous": 0.14, "coulomb": 1.0}


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[int, dict[str, Parameter]]:
    """Parameters by the encoder's counts per revolution."""
    legs = tmp_path_factory.mktemp("legs") / "legs.yaml"
    legs.write_text(LEGS)
    stages = {counts: sc.load_stage(STAGE).changed({"encoder.counts_per_revolution": counts}) for counts in COUNTS}
    slow = {counts: stage.changed({"control.bandwidth": 20.0}) for counts, stage in stages.items()}
    runs = {counts: sc.simulate(stage, sc.load_trajectory(legs)) for counts, stage in slow.items()}
    return {counts: dict(sc.identify(slow[counts], run).parameters) for counts, run in runs.items()}


@pytest.mark.parametrize("counts", COUNTS)
def test_the_intervals_hold_the_machine(found: dict[int, dict[str, Parameter]], counts: int) -> None:
    for name, value in TRUE.items():
        assert found[counts][name].low <= value <= found[counts][name].high, name
    assert found[counts]["inertia"].value == pytest.approx(TRUE["inertia"], rel=0.02)


@pytest.mark.parametrize("counts", COUNTS[:-1])
def test_a_coarse_encoder_makes_the_delay_uncertain_but_not_late(
    found: dict[int, dict[str, Parameter]], counts: int
) -> None:
    """A wide window hid the rounding, and with it that the controller answers after it: the delay was late."""
    coarse, fine = found[counts]["delay"], found[COUNTS[-1]]["delay"]
    assert coarse.low <= fine.value <= coarse.high and coarse.value == pytest.approx(fine.value, abs=2.5e-4)
    assert coarse.high - coarse.low > fine.high - fine.low
