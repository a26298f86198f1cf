"""Compensation on the exam's machine: one motion identified, and what each compensator makes of the peak error."""

from __future__ import annotations

import pytest
from stagectl_studies.foreign import __main__ as command
from stagectl_studies.foreign.axis import Axis
from stagectl_studies.foreign.friction_laws import LAWS, machine
from stagectl_studies.foreign.trial import BARE, FORMS, LEARNED, MOTIONS, Tracked, trial

from stagectl.config.stage_file import load_stage
from stagectl.plan import plan
from stagectl.simulation import simulate
from stagectl.trajectories import Sine
from tests.conftest import CONFIG

SINE = "5 mm, 1.6 Hz"


@pytest.fixture(scope="module")
def tracked() -> Tracked:
    return trial("Dahl", 1, motions={SINE: MOTIONS[SINE]})


def test_every_compensator_lowers_the_peak(tracked: Tracked) -> None:
    """20 times at full amplitude, where the current's noise leaves 0.1 um; and from rest, too, at least 10 times."""
    assert tracked.refused == ""
    peaks, whole = tracked.steady[SINE], tracked.whole[SINE]
    assert set(peaks) == {BARE, *FORMS, LEARNED}
    assert 3e-6 < peaks[BARE] < 10e-6
    for form in (*FORMS, LEARNED):
        assert 20.0 < peaks[BARE] / peaks[form] < 120.0, form
        assert 10.0 < whole[BARE] / whole[form] < 120.0, form


def test_the_table_shows_median_and_worst(tracked: Tracked) -> None:
    half = tracked._replace(steady={SINE: {**tracked.steady[SINE], "gms": tracked.steady[SINE][BARE] / 4.0}})
    *_, row = command.rows([tracked, half, half], SINE)
    assert row.startswith("| Dahl | ")
    assert "| 4 (4) |" in row
    assert command.rows([Tracked("GMS", 1, {}, {}, "why")], SINE)[-1].count("refused") == 2 + len(FORMS)
    assert command.worse([tracked]) == ["no compensator makes any run worse"]
    grown = tracked._replace(whole={SINE: {**tracked.whole[SINE], "table": 1.0}})
    assert len(command.worse([grown])) == 1


@pytest.mark.parametrize("law", LAWS)
def test_a_run_is_that_of_its_seed(law: str) -> None:
    """The machine is drawn by law and seed; stagectl's gains hold it, and noise alone differs between runs."""
    setup = load_stage(CONFIG / "ball-screw.yaml")
    laid_out = plan(setup, Sine(0.001, 5.0, 1.0, 0.5), setup.controller.feedforward)
    axis = Axis(machine(law, 2), 2)
    first, again, other = (axis.run(setup, laid_out, number) for number in (0, 0, 1))
    assert first.tobytes() == again.tobytes() != other.tobytes()
    assert abs(first["error"]).max() < 1e-2


def test_beyond_the_current_limit_the_machines_controller_does_as_ours() -> None:
    """What leaves it is limited, and its integrator waits: with the same plant both come back to the same rest."""
    setup = load_stage(CONFIG / "ball-screw.yaml")
    hard = plan(setup, Sine(0.001, 8.0, 1.0, 0.5), setup.controller.feedforward)
    limit = setup.controller.law.current_limit
    foreign, ours = Axis(machine("Maxwell", 2), 2).run(setup, hard, 0), simulate(setup, hard, setup.controller.law)
    for rows in (foreign, ours):
        assert abs(rows["command"]).max() > limit == abs(rows["current"]).max()
        assert abs(rows["error"][-100:]).max() < 1e-3
    assert abs(foreign["error"]).max() == pytest.approx(abs(ours["error"]).max(), rel=0.3)
