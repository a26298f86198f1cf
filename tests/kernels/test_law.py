"""The limit, and what the integrator does while the command is beyond it."""

from __future__ import annotations

import pytest

from stagectl.kernels import feedback, law

PID = feedback.Pid(proportional=2.0, integral=0.5, derivative=3.0, decay=0.25)
P = law.Law(PID, current_limit=10.0)


def remembering(error: float, integral: float, derivative: float) -> law.State:
    """A law whose PID has this memory."""
    return law.AT_REST._replace(feedback=feedback.State(error, integral, derivative))


NOTHING = law.Setpoint(0.0, 0.0, 0.0, 0.0)


def test_the_command_is_the_sum_of_all_terms() -> None:
    output, state = law.step(P, remembering(0.5, 0.25, 1.0), law.Setpoint(9.0, 1.25, 0.125, 0.0625), 0.25)
    # e = 1.25 - 0.25; P 2 e; I 0.25 + 0.5 (1 + 0.5); D 0.25 * 1 + 3 (1 - 0.5)
    assert output == law.Output(1.0, 2.0, 1.0, 1.75, 0.0, 2.0 + 1.0 + 1.75 + 0.125 + 0.0625, 4.9375)
    assert state.feedback == feedback.State(1.0, 1.0, 1.75)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("error", [6.0, 0.0, -1.0])
def test_the_integrator_goes_on_unless_it_would_go_further_into_the_limit(sign: float, error: float) -> None:
    """Anti-windup by conditional integration: beyond the limit only an error against the command is integrated."""
    before = remembering(sign * 4.0, sign * 40.0, 0.0)
    output, after = law.step(P, before, NOTHING._replace(target=sign * error), 0.0)
    assert output.current == sign * 10.0
    assert output.command * sign > 10.0
    assert output.integral == sign * (40.0 + 0.5 * (error + 4.0))  # in this period it acts all the same
    assert after.feedback.integral == (sign * 40.0 if error > 0.0 else output.integral)
    assert (after.feedback.error, after.feedback.derivative) == (sign * error, output.derivative)


def test_at_the_limit_it_integrates() -> None:
    output, after = law.step(P, remembering(1.0, 7.0, 0.0), NOTHING._replace(target=1.0), 0.0)
    assert output.command == output.current == 10.0
    assert after.feedback.integral == 8.0


BAND = P._replace(standstill_band=0.5)


@pytest.mark.parametrize(("error", "acted"), [(0.0, 0.0), (0.5, 0.0), (-0.5, 0.0), (0.75, 0.25), (-1.5, -1.0)])
def test_at_standstill_the_feedback_sees_what_exceeds_the_band(error: float, acted: float) -> None:
    """The recorded error is the whole one; a moving reference, or an injected current, ends the band."""
    output, state = law.step(BAND, remembering(0.0, 7.0, 0.0), NOTHING._replace(target=error), 0.0)
    assert output.error == error
    assert (state.feedback.error, output.integral) == (acted, 7.0 + 0.5 * acted)
    for setpoint in (NOTHING._replace(target=error, velocity=1.0), NOTHING._replace(target=error, injection=0.1)):
        assert law.step(BAND, law.AT_REST, setpoint, 0.0)[0] == law.step(P, law.AT_REST, setpoint, 0.0)[0]


def test_beginning_and_end_of_a_standstill_change_the_error_by_the_band_at_most() -> None:
    """No jump of the current beyond that of an encoder that moves on by the band."""
    for error in (-2.0, -0.5, -0.1, 0.3, 0.5, 4.0):
        moving = NOTHING._replace(target=error, velocity=1.0)
        _, before = law.step(BAND, remembering(error, 3.0, 0.0), moving, 0.0)
        jumped, _ = law.step(BAND, before, moving._replace(velocity=0.0), 0.0)
        going, _ = law.step(BAND, before, moving, 0.0)
        largest = BAND.standstill_band * (PID.proportional + PID.integral + PID.derivative)
        assert abs(jumped.command - going.command) <= largest + 1e-12
