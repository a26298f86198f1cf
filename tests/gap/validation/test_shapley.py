from __future__ import annotations

import pytest

from stagectl.gap.validation.shapley import shapley


def test_shares_sum_to_what_all_take_and_a_joint_gain_is_halved() -> None:
    worth = {"": 10.0, "a": 4.0, "b": 7.0, "ab": 2.0}
    shares = shapley(["a", "b"], lambda members: worth["".join(sorted(members))])
    assert shares == pytest.approx({"a": 5.5, "b": 2.5})


def test_independent_players_take_what_they_take_alone() -> None:
    gains = {"a": 1.0, "b": 2.0, "c": 4.0}
    calls = []

    def remaining(members: frozenset[str]) -> float:
        calls.append(members)
        return 7.0 - sum(gains[name] for name in members)

    assert shapley(list(gains), remaining) == pytest.approx(gains)
    assert len(calls) == len(set(calls)) == 8  # each subset once
