"""The time-stamp surface, its noise filter and its hot-pixel mask, compared with plain versions."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from tests.common.events.encoding import make_events, random_events

from motiondlo.events.surface import NEVER_US, SurfaceParams, TimeSurface
from motiondlo.events.types import EventArray, SensorGeometry

SENSOR = SensorGeometry(64, 48)


def small(n: int, seed: int = 0, mean_step_us: float = 20.0) -> EventArray:
    return random_events(n, seed, mean_step_us, SENSOR.width_px, SENSOR.height_px)


def plain_supported(events: EventArray, window_us: int) -> list[bool]:
    """Whether one of the 8 neighbours fired within the window before, whatever became of that event."""
    seen: dict[tuple[int, int], int] = {}
    supported = []
    for t, x, y, _ in events.tolist():
        around = [(x + dx, y + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy]
        supported.append(any(t - seen[place] <= window_us for place in around if place in seen))
        seen[x, y] = t
    return supported


def with_hot_pixel(seconds: float, rate_hz: float = 400.0) -> EventArray:
    """Sparse noise and the HOT_PIXEL (10, 20)."""
    n = int(seconds * 2000)
    noise = small(n, mean_step_us=500.0)
    hot = make_events((int(i * 1e6 / rate_hz), 10, 20, i % 2) for i in range(int(seconds * rate_hz)))
    events = np.zeros(len(noise) + len(hot), noise.dtype)
    events[: len(noise)], events[len(noise) :] = noise, hot
    return events[np.argsort(events["t"], kind="stable")]


def in_batches(events: EventArray, period_us: int = 1000) -> list[EventArray]:
    edges = np.arange(0, int(events["t"][-1]) + period_us, period_us)
    return np.split(events, np.searchsorted(events["t"], edges[1:]))


def test_holds_the_last_time_per_pixel_and_polarity() -> None:
    events = small(20_000)
    surface = TimeSurface(SENSOR)
    assert (surface.last_us == NEVER_US).all()
    assert surface.update(events) is events
    expected = np.full((2, 48, 64), NEVER_US)
    for t, x, y, p in events.tolist():
        expected[p, y, x] = t
    np.testing.assert_array_equal(surface.last_us, expected)
    surface.clear()
    assert (surface.last_us == NEVER_US).all()


def test_events_outside_the_sensor_are_counted_and_touch_nothing() -> None:
    for params in (SurfaceParams(), SurfaceParams(noise_filter=True)):
        surface = TimeSurface(SENSOR, params)
        surface.update(make_events([(5, 64, 0, 1), (6, 0, 48, 0), (7, 65535, 65535, 1)]))
        assert surface.outside == 3
        assert (surface.last_us == NEVER_US).all()


def test_noise_filter_keeps_what_a_neighbour_supports() -> None:
    events = small(3000, mean_step_us=30.0)
    surface = TimeSurface(SENSOR, SurfaceParams(noise_filter=True, noise_window_us=2000))
    kept = np.concatenate([surface.update(part) for part in in_batches(events)])
    expected = events[plain_supported(events, 2000)]
    assert 0.05 < len(expected) / len(events) < 0.95
    np.testing.assert_array_equal(kept, expected)
    only_kept = TimeSurface(SENSOR)
    only_kept.update(expected)
    np.testing.assert_array_equal(surface.last_us, only_kept.last_us)


def test_noise_filter_at_the_borders() -> None:
    corners = [(0, 0, 0, 1), (10, 1, 1, 1), (20, 63, 47, 1), (30, 62, 46, 0), (40, 63, 0, 1), (50, 63, 1, 1)]
    surface = TimeSurface(SENSOR, SurfaceParams(noise_filter=True))
    assert surface.update(make_events(corners))["t"].tolist() == [10, 30, 50]


def test_HOT_PIXEL_is_learned_at_rest_and_masked() -> None:
    surface = TimeSurface(SENSOR, SurfaceParams(hot_pixel_mask=True))
    for part in in_batches(with_hot_pixel(1.0)):
        kept = surface.update(part)
    assert np.argwhere(surface.hot).tolist() == [[20, 10]]
    assert not ((kept["x"] == 10) & (kept["y"] == 20)).any()


def test_HOT_PIXEL_is_not_learned_while_something_moves() -> None:
    surface = TimeSurface(SENSOR, SurfaceParams(hot_pixel_mask=True))
    for part in in_batches(with_hot_pixel(1.0)):
        surface.update(part, resting=False)
    assert surface.hot_pixels == 0


def test_a_pixel_that_calms_down_is_freed() -> None:
    surface = TimeSurface(SENSOR, SurfaceParams(hot_pixel_mask=True))
    for part in in_batches(with_hot_pixel(0.6)):
        surface.update(part)
    assert surface.hot_pixels == 1
    calm = small(4000, mean_step_us=500.0)
    calm["t"] += 600_000
    for part in in_batches(calm):
        surface.update(part)
    assert surface.hot_pixels == 0


def test_an_active_region_is_not_called_hot() -> None:
    """A flickering patch: its pixels fire as often as a hot one, and so do their neighbours."""
    rows = [(t + i, 20 + i % 8, 20 + i // 8, 1) for t in range(0, 1_000_000, 5000) for i in range(64)]
    surface = TimeSurface(SENSOR, SurfaceParams(hot_pixel_mask=True))
    for part in in_batches(make_events(rows)):
        surface.update(part)
    assert surface.hot_pixels == 0


def test_the_mask_is_bounded() -> None:
    rows = [(t + i, 4 * i, 3 * i, 1) for t in range(0, 1_000_000, 2500) for i in range(15)]
    for limit, expected in ((20, 15), (10, 0)):
        surface = TimeSurface(SENSOR, SurfaceParams(hot_pixel_mask=True, hot_limit=limit))
        for part in in_batches(make_events(rows)):
            surface.update(part)
        assert surface.hot_pixels == expected


def test_parameters_are_checked() -> None:
    with pytest.raises(ValidationError):
        SurfaceParams(noise_window_us=0)
    with pytest.raises(ValidationError):
        SurfaceParams(unknown=1)  # type: ignore[call-arg]
