"""The time-stamp surface, compared with a plain version."""

from __future__ import annotations

import numpy as np
from tests.common.events.encoding import make_events, random_events

from motiondlo.events.surface import NEVER_US, TimeSurface
from motiondlo.events.types import EventArray, SensorGeometry

SENSOR = SensorGeometry(64, 48)


def small(n: int, seed: int = 0, mean_step_us: float = 20.0) -> EventArray:
    return random_events(n, seed, mean_step_us, SENSOR.width_px, SENSOR.height_px)


def test_holds_the_last_time_per_pixel_and_polarity() -> None:
    events = small(20_000)
    surface = TimeSurface(SENSOR)
    assert (surface.last_us == NEVER_US).all()
    surface.update(events)
    expected = np.full((2, 48, 64), NEVER_US)
    for t, x, y, p in events.tolist():
        expected[p, y, x] = t
    np.testing.assert_array_equal(surface.last_us, expected)
    surface.clear()
    assert (surface.last_us == NEVER_US).all()


def test_events_outside_the_sensor_are_counted_and_touch_nothing() -> None:
    surface = TimeSurface(SENSOR)
    surface.update(make_events([(5, 64, 0, 1), (6, 0, 48, 0), (7, 65535, 65535, 1)]))
    assert surface.outside == 3
    assert (surface.last_us == NEVER_US).all()
