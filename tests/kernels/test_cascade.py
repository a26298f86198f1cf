"""The P-PI cascade: its terms by hand, its transfer function against its time response, and an open loop."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stagectl import design
from stagectl.kernels import cascade, feedback, law, observer

P = cascade.Cascade(position=10.0, velocity=2.0, integral=0.5, retained=0.25, share=0.5, span=1, dt=0.1)


def test_one_period_by_hand() -> None:
    x = cascade.State(error=1.0, integral=0.25, filtered=4.0, last=0.5, before=0.4)
    terms, after = cascade.step(P, x, (0.3, 2.0), 0.7)
    # wanted = 10 * 0.3 + 0.5 * 2 - 0.2 / 0.1 = 2; P 4; I 0.25 + 0.5 * 3 = 1.75; filtered 0.25 * 4 + 0.75 * 5.75
    assert terms.proportional == pytest.approx(4.0)
    assert terms.integral == pytest.approx(1.75)
    assert sum(terms) == pytest.approx(5.3125)
    assert after == pytest.approx((2.0, 1.75, 5.3125, 0.7, 0.5))


def test_the_first_period_knows_no_velocity() -> None:
    terms, after = cascade.step(P, cascade.AT_REST, (0.0, 0.0), 3.0)
    assert terms == (0.0, 0.0, 0.0)
    assert (after.last, after.before) == (3.0, 3.0)


def test_a_span_of_two_is_the_mean_of_two_positions_differenced() -> None:
    """The EMPS benchmark's velocity: ((q2 + q1)/2 - (q1 + q0)/2) / Ts."""
    p = cascade.Cascade(0.0, 1.0, 0.0, 0.0, 0.0, 2, 0.1)
    x, positions = cascade.AT_REST, [0.0, 0.3, 0.35, 0.1]
    outputs = []
    for position in positions:
        terms, x = cascade.step(p, x, (0.0, 0.0), position)
        outputs.append(-sum(terms))
    assert outputs == pytest.approx([0.0, 1.5, 1.75, -1.0])


@pytest.mark.parametrize("span", [1, 2])
def test_the_transfer_function_is_that_of_the_kernel(span: int) -> None:
    """Response to an impulse of the position, against the inverse of the transfer function that the margins use."""
    p = cascade.Cascade(160.0, 3.0, 0.05, 0.3, 1.0, span, 5e-4)
    x, outputs = law.AT_REST.cascade._replace(last=0.0, before=0.0), []
    for k in range(64):
        position = 1.0 if k == 0 else 0.0
        terms, x = cascade.step(p, x, (-position, 0.0), position)
        outputs.append(-sum(terms))
    in_w = design.compensator(p, 5e-4)
    numerator, denominator = (np.poly1d(one)(np.poly1d([1.0, -1.0])).coeffs for one in in_w)  # w = z - 1
    expected = np.zeros(64)
    impulse = np.zeros(64)
    impulse[: len(numerator)] = numerator
    for k in range(64):
        past = sum(denominator[j] * expected[k - j] for j in range(1, len(denominator)) if k >= j)
        expected[k] = (impulse[k] - past) / denominator[0]
    np.testing.assert_allclose(outputs, expected, rtol=1e-9, atol=1e-6)


LAW = law.Law(feedback.ABSENT, 5.0, P, True)


def test_the_law_runs_the_cascade_and_adds_what_is_known() -> None:
    r = law.Setpoint(0.0, 1.0, 0.1, 0.2, velocity=2.0, learned=0.3, injection=0.4)
    x = law.AT_REST._replace(cascade=cascade.State(1.0, 0.25, 4.0, 0.5, 0.4))
    output, _ = law.step(LAW, x, r, 0.7)
    terms, _ = cascade.step(P, x.cascade, (0.3, 2.0), 0.7)
    assert output.command == pytest.approx(sum(terms) + 1.0)
    assert output.current == 5.0


@pytest.mark.parametrize(("wanted", "held"), [(2.0, True), (-2.0, False)])
def test_the_cascade_does_not_integrate_into_the_limit(wanted: float, held: bool) -> None:
    x = law.AT_REST._replace(cascade=cascade.State(0.0, 40.0, 40.0, 0.0, 0.0))
    output, after = law.step(LAW, x, law.Setpoint(0.0, 0.1 * wanted, 0.0, 0.0), 0.0)
    assert output.current == 5.0
    assert (after.cascade.integral == 40.0) is held
    assert after.cascade.last == 0.0 and after.cascade.filtered == pytest.approx(output.command)


@pytest.mark.parametrize("cascaded", [True, False])
def test_an_open_loop_gives_what_is_known_and_forgets(cascaded: bool) -> None:
    p = law.Law(feedback.Pid(2.0, 0.5, 3.0, 0.25), 5.0, P, cascaded)
    x = law.State(feedback.State(1.0, 2.0, 3.0), cascade.State(1.0, 2.0, 3.0, 4.0, 5.0), observer.AT_REST)
    output, after = law.step(p, x, law.Setpoint(9.0, 9.0, 0.5, 0.25, 7.0, 0.125, 1.0, 0.0), 3.0)
    assert output == law.Output(0.0, 0.0, 0.0, 0.0, 0.0, 1.875, 1.875)
    assert after.feedback == feedback.AT_REST
    assert math.isnan(after.cascade.last) and after.cascade[:3] == (0.0, 0.0, 0.0)
    limited, _ = law.step(p, x, law.Setpoint(0.0, 0.0, 0.0, 0.0, injection=-9.0, closed=0.0), 3.0)
    assert (limited.command, limited.current) == (-9.0, -5.0)
