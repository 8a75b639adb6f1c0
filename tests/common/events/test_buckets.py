"""Event buckets keep the newest events of every tile."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.events.bucket_kernels import (
    COORDINATE_MASK,
    TIME_SHIFT,
    X_SHIFT,
    Y_MASK,
    Y_SHIFT,
    note_times,
    tiles_around,
)
from motiondlo.events.buckets import CAPACITY, EventBuckets
from motiondlo.events.surface import NEVER_US
from motiondlo.events.types import EVENT_DTYPE, SensorGeometry


def some_events(count: int, width_px: int, height_px: int) -> np.ndarray:
    rng = np.random.default_rng(1)
    events = np.zeros(count, EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, 5_000_000_000, count))
    events["x"], events["y"] = rng.integers(0, width_px, count), rng.integers(0, height_px, count)
    events["p"] = rng.integers(0, 2, count)
    return events


def test_every_event_is_filed_whole_under_its_tile() -> None:
    buckets = EventBuckets(SensorGeometry(1280, 720))
    events = some_events(5000, 1280, 720)
    buckets.update(events)
    found = set()
    for tile, head in enumerate(buckets.heads):
        for word in buckets.rings[tile, :head]:
            x, y = (int(word) >> X_SHIFT) & COORDINATE_MASK, (int(word) >> Y_SHIFT) & Y_MASK
            assert tile == (y // 16) * buckets.columns + x // 16
            found.add((int(word) >> TIME_SHIFT, x, y, int(word) & 1))
    assert found == {(int(e["t"]), int(e["x"]), int(e["y"]), int(e["p"])) for e in events}


def test_a_full_tile_keeps_the_newest() -> None:
    buckets = EventBuckets(SensorGeometry(32, 32))
    events = some_events(3 * CAPACITY, 16, 16)
    buckets.update(events[: CAPACITY + 7])
    buckets.update(events[CAPACITY + 7 :])
    assert buckets.heads.tolist() == [3 * CAPACITY, 0, 0, 0]
    np.testing.assert_array_equal(np.sort(buckets.rings[0] >> TIME_SHIFT), events["t"][-CAPACITY:])


def test_events_outside_are_counted_and_clear_forgets() -> None:
    buckets = EventBuckets(SensorGeometry(40, 30))
    events = some_events(10, 40, 30)
    events["x"][3], events["y"][5] = 40, 30
    buckets.update(events)
    assert buckets.outside == 2
    assert buckets.heads.sum() == 8
    buckets.clear()
    assert buckets.heads.sum() == 0
    assert (buckets.last_us == NEVER_US).all()


def test_times_per_pixel_are_noted_where_they_are_asked_for() -> None:
    buckets = EventBuckets(SensorGeometry(64, 48))
    events = some_events(2000, 64, 48)
    buckets.update(events)
    since_us = int(events["t"][1200])
    note_times(
        buckets.rings, buckets.heads, buckets.columns, buckets.last_us, since_us, 17.0, -5.0, 40.0, 20.0
    )  # fmt: skip
    expected = np.full_like(buckets.last_us, NEVER_US)
    near = (events["x"] // 16 >= 1) & (events["x"] // 16 <= 2) & (events["y"] // 16 <= 1) & (events["t"] >= since_us)
    for event in events[near]:
        expected[event["p"], event["y"], event["x"]] = event["t"]
    np.testing.assert_array_equal(buckets.last_us, expected)


def test_a_sensor_that_does_not_fit_a_word_is_refused() -> None:
    with pytest.raises(ValueError, match="too large"):
        EventBuckets(SensorGeometry(4096, 2048))


@pytest.mark.parametrize("angle_rad", [0.0, 0.5, 1.9, -2.8])
def test_no_tile_of_a_turned_rectangle_is_missed(angle_rad: float) -> None:
    columns, heads = 20, np.zeros(20 * 15, np.int64)
    ex, ey = np.cos(angle_rad), np.sin(angle_rad)
    r0, r1, c0, c1, cx, cy, far_a, far_b = tiles_around(150.0, 110.0, ex, ey, -60.0, 30.0, -15.0, 40.0, heads, columns)
    y, x = np.mgrid[0:240, 0:320]
    a, b = (x - 150.0) * ex + (y - 110.0) * ey, -(x - 150.0) * ey + (y - 110.0) * ex
    inside = (a >= -60.0) & (a <= 30.0) & (b >= -15.0) & (b <= 40.0)
    for row, column in set(zip(y[inside] // 16, x[inside] // 16, strict=True)):
        assert r0 <= row <= r1
        assert c0 <= column <= c1
        ux, uy = 16.0 * column + 7.5 - cx, 16.0 * row + 7.5 - cy
        assert abs(ux * ex + uy * ey) <= far_a
        assert abs(-ux * ey + uy * ex) <= far_b
