"""From the ring to what a viewer gets: every peak, in the right place, in the right unit."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from stagectl.recording.triggering import Settings, Trigger
from stagectl.service.axis_controller import AxisController, ServiceError
from stagectl.web.channels import Channel, channels, chosen, level
from stagectl.web.limits import EDGES
from stagectl.web.live import DETAIL, HEAD, STRIP, ScopeView, Strip, Window, rows_a_bucket
from stagectl.web.status_feed import Lateness
from tests.web.conftest import Write

LEAD = 12e-3 / (2.0 * np.pi)  # m/rad


def message(raw: bytes) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Head, lowest, highest."""
    numbers = np.frombuffer(raw)
    count, buckets = int(numbers[1]), int(numbers[2])
    values = numbers[HEAD:].reshape(-1, count, buckets)
    return numbers[:HEAD], values[0], values[-1]


def window(axis: AxisController, *names: str, span: float = 1.0, points: int = 100) -> Window:
    return Window(tuple(chosen(channels(axis.setup), list(names))), span, points)


def test_a_strip_joins_without_a_gap_and_shows_every_peak(axis: AxisController, write: Write) -> None:
    """Whatever the pieces in which rows come: buckets follow each other, and one row in 20 is in its bucket."""
    strip = Strip(axis.ring, axis.setup.dt, window(axis, "error", "current"))
    assert strip.size == 20
    source, parts = np.random.default_rng(3), []
    for piece in source.integers(1, 90, 60):
        write(int(piece), error=lambda k: float(k % 331 == 7))
        if (raw := strip.look(5)) is not None:
            parts.append(message(raw))
    heads = [head for head, _, _ in parts]
    assert all(head[0] == STRIP and head[7] == 5 and head[3] == 20 for head in heads)
    starts = [round(head[4] / axis.setup.dt) - 1 for head in heads]
    ends = [start + 20 * int(head[2]) for start, head in zip(starts, heads, strict=True)]
    assert starts[0] == 0
    assert starts[1:] == ends[:-1]
    assert axis.ring.written - ends[-1] < 20
    highest = np.concatenate([high for _, _, high in parts], axis=1)
    expected = [any(k % 331 == 7 for k in range(20 * n, 20 * n + 20)) for n in range(highest.shape[1])]
    assert np.array_equal(highest[0] > 0.0, expected)
    assert highest[0].max() == pytest.approx(LEAD)  # the error in m of travel
    assert np.concatenate([low for _, low, _ in parts], axis=1)[1].min() == pytest.approx(-1.0, abs=1e-3)  # A as A


def test_a_viewer_that_fell_behind_begins_with_a_whole_bucket(axis: AxisController, write: Write) -> None:
    strip = Strip(axis.ring, axis.setup.dt, window(axis, "current", points=300))
    assert strip.size == 7
    write(axis.ring.capacity + 100)
    raw = strip.look(0)
    assert raw is not None
    head, low, _ = message(raw)
    first = round(head[4] / axis.setup.dt) - 1
    assert first % 7 == 0
    assert 100 <= first < 107
    assert low[0, 0] == pytest.approx(min(np.sin(np.arange(first, first + 7) / 50.0)), abs=1e-12)


@pytest.mark.parametrize(
    ("span", "points", "rows"), [(10.0, 600, 34), (0.5, 1000, 1), (1.0, 1000, 2), (1.001, 1000, 3)]
)
def test_a_span_has_no_more_points_than_asked_for(span: float, points: int, rows: int) -> None:
    assert rows_a_bucket(span, points, 5e-4) == rows
    assert span / 5e-4 / rows <= points


def test_the_scope_is_looked_at_closer_without_losing_anything(axis: AxisController, write: Write) -> None:
    settings = Settings(2000, 500, Trigger(channels(axis.setup)["error"].column, 0.5), "normal")
    sight = ScopeView(axis.ring, axis.setup.dt, window(axis, "error", points=100), settings)
    write(4000, error=lambda k: float(k == 1200) + 2.0 * (k == 1705))
    raw = sight.look(3)
    assert raw is not None
    head, low, high = message(raw)
    assert (head[2], head[3]) == (100.0, 20.0)
    assert head[6] == pytest.approx(1201 * 5e-4)  # the trigger
    assert head[4] == pytest.approx((1200 - 500 + 1) * 5e-4)
    assert high.max() == pytest.approx(2.0 * LEAD)
    assert low.max() == 0.0
    closer = sight.closer(0.25, 0.255, 1000, 4)  # around row 1705, in full
    assert closer is not None
    head, low, high = message(closer)
    assert (head[0], head[3], head[7]) == (DETAIL, 1.0, 4.0)
    assert np.array_equal(low, high)
    place = round((head[4] - head[6]) / 5e-4) + int(np.argmax(high[0]))
    assert place == 1705 - 1200


def test_channels_have_the_unit_of_travel(axis: AxisController) -> None:
    known = channels(axis.setup)
    assert known["measured"][2:4] == ("m", pytest.approx(LEAD))
    assert known["velocity"][2:4] == ("m/s", pytest.approx(LEAD))
    assert known["current"][2:4] == ("A", 1.0)
    assert known["state"].unit == ""
    assert {"time", "true_position"}.isdisjoint(known)
    with pytest.raises(ServiceError, match=r"channel nothing"):
        chosen(known, ["nothing"])
    with pytest.raises(ServiceError, match="17 channels"):
        chosen(known, [*known][:17])


@pytest.mark.parametrize(("text", "value"), [("1 um", 1e-6 / LEAD), ("2 mm", 2e-3 / LEAD), ("1e-6 m", 1e-6 / LEAD)])
def test_a_level_is_read_in_travel(axis: AxisController, text: str, value: float) -> None:
    assert level(channels(axis.setup)["error"], text) == pytest.approx(value)


@pytest.mark.parametrize("text", ["1 A", "wide", "", "1 furlong", "1", "nan m", "inf m", "1e400 m"])
def test_a_level_that_is_none(text: str) -> None:
    with pytest.raises(ServiceError, match=r"trigger level .*must be a number in m"):
        level(Channel("error", 9, "m", 1.0, ""), text)


def test_lateness_of_the_last_minute(axis: AxisController, write: Write) -> None:
    late = Lateness(axis.ring, axis.setup.dt)
    write(1000)
    write(10, lateness=lambda _: 3e-3)
    histogram = late.histogram()
    assert sum(histogram["counts"]) == histogram["rows"] == 1010
    assert histogram["counts"][EDGES.index(2e-5)] == 1000  # 15 us: between 10 and 20
    assert histogram["counts"][EDGES.index(5e-3)] == 10
    assert histogram["largest"] == 3e-3
    for _ in range(7):  # 70 s
        write(20_000)
        histogram = late.histogram()
    assert histogram["largest"] == 15e-6
    assert 120_000 <= histogram["rows"] <= 140_000
