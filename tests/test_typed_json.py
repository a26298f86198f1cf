"""Records to JSON and back by the types of their fields."""

from __future__ import annotations

import json
import math
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.typed_json import TypedJsonError, decoded, encoded


class Inner(NamedTuple):
    size: float
    name: str = "x"


class Outer(NamedTuple):
    inner: tuple[Inner, ...]
    pairs: tuple[tuple[str, float | str | tuple[float, ...]], ...]
    spans: tuple[tuple[float, float], ...]
    curve: NDArray[np.float64]
    least: float | None = None


OUTER = Outer((Inner(1.5),), (("a", 2.0), ("b", "word"), ("c", (1.0, 2.0))), ((0.0, 1.0),), np.array([1.0, math.nan]))
DATA = {
    "inner": [{"size": 1.5, "name": "x"}],
    "pairs": {"a": 2.0, "b": "word", "c": [1.0, 2.0]},
    "spans": [[0.0, 1.0]],
    "curve": [1.0, None],
    "least": None,
}


def test_a_record_comes_back_as_it_was() -> None:
    data = json.loads(json.dumps(encoded(OUTER, Outer), allow_nan=False))
    assert data == DATA
    restored = decoded(data, Outer)
    assert restored[:3] == OUTER[:3] and restored.least is None
    np.testing.assert_array_equal(restored.curve, OUTER.curve)


def test_null_is_nan_where_a_number_must_be() -> None:
    assert math.isnan(decoded({"size": None}, Inner).size)


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"inner": [{"size": "much"}]}, "inner[0].size"),
        ({"inner": [{}]}, "inner[0].size"),
        ({"inner": [{"size": 1.0, "colour": 2}]}, "inner[0].colour"),
        ({"spans": {"a": 1}}, "spans"),
        ({"inner": [{"size": True}]}, "inner[0].size"),
    ],
)
def test_what_does_not_fit_is_named_by_its_place(change: dict[str, object], place: str) -> None:
    with pytest.raises(TypedJsonError) as refused:
        decoded({**DATA, **change}, Outer)
    assert refused.value.place == place
