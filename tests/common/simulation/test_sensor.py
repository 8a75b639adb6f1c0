"""Pixels fire at thresholds, at the right time, not while dead; noise has its rate."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.events.types import EventArray
from motiondlo.simulation.raster_kernels import TILE
from motiondlo.simulation.scene import SensorParams
from motiondlo.simulation.sensor import DARK, EventSensor, background_activity, row_time

SIDE = 2 * TILE
IDEAL = SensorParams(
    threshold_on=0.4, threshold_off=0.3, mismatch=0.0, jitter=0.0, refractory_us=0.0, refractory_mismatch=0.0,
    row_period_us=1, tau_us=1.0,
)  # fmt: skip
GAIN = np.ones((SIDE, SIDE), np.float32)
ALL_TILES = np.ones((2, 2), np.uint8)


def light(log_level: float) -> np.ndarray:  # type: ignore[type-arg]
    return np.full((SIDE, SIDE, 1), np.exp(log_level) - DARK, np.float32)


def events_of_ramp(params: SensorParams, levels: np.ndarray, step_us: float = 100.0) -> EventArray:  # type: ignore[type-arg]
    """Events of the pixel (5, 7) while all pixels go through the log levels."""
    sensor = EventSensor(params, light(float(levels[0])), GAIN, np.random.default_rng(1))
    pieces = [
        sensor.advance(light(float(level)), GAIN, ALL_TILES, step_us * (i + 1)) for i, level in enumerate(levels[1:])
    ]
    events = np.concatenate(pieces)
    return events[(events["x"] == 5) & (events["y"] == 7)]


def test_a_ramp_fires_at_every_threshold() -> None:
    levels = np.linspace(-2.0, -0.5, 101)
    events = events_of_ramp(IDEAL, levels)
    assert (events["p"] == 1).all()
    np.testing.assert_allclose(events["t"], 10000 * np.array([0.4, 0.8, 1.2]) / 1.5, atol=4)


def test_falling_light_has_its_own_threshold() -> None:
    events = events_of_ramp(IDEAL, np.linspace(-0.5, -1.6, 101))
    assert (events["p"] == 0).all()
    np.testing.assert_allclose(events["t"], 10000 * np.array([0.3, 0.6, 0.9]) / 1.1, atol=4)


def test_a_dead_pixel_forgets_what_happens_meanwhile() -> None:
    params = IDEAL.model_copy(update={"refractory_us": 2500.0})
    events = events_of_ramp(params, np.concatenate([np.linspace(-2.0, -0.5, 11), np.full(60, -0.5)]))
    assert len(events) == 1


def test_dark_pixels_are_slower() -> None:
    params = IDEAL.model_copy(update={"tau_us": 80.0})
    step = np.array([0.0] + [0.6] * 40)
    bright, dim = events_of_ramp(params, -0.6 + step), events_of_ramp(params, -3.2 + step)
    assert dim["t"][0] > bright["t"][0] + 100


def test_a_pixel_at_rest_is_silent() -> None:
    assert not len(events_of_ramp(IDEAL, np.full(50, -1.0)))


def test_mismatch_spreads_the_times() -> None:
    params = IDEAL.model_copy(update={"mismatch": 0.03})
    sensor = EventSensor(params, light(-2.0), GAIN, np.random.default_rng(1))
    events = np.concatenate([sensor.advance(light(-2.0 + 0.006 * i), GAIN, ALL_TILES, 100.0 * i) for i in range(1, 91)])
    # 0.54 in all: one event each, whatever the mismatch.
    assert len(events) == SIDE * SIDE
    assert np.std(events["t"]) * 0.00006 == pytest.approx(0.03, rel=0.15)


def test_rows_are_read_out_in_their_own_phase() -> None:
    t = row_time(np.array([100.0, 111.9, 124.0, 100.0]), np.array([0, 0, 0, 1], np.int32), 24)
    assert t.tolist() == [120, 120, 144, 115]


def test_background_activity_has_its_rate_and_hot_pixels() -> None:
    params = SensorParams(noise_hz=2.0, hot_pixels=3, hot_hz=500.0)
    events = background_activity(params, (60, 80), 1_000_000, np.random.default_rng(4))
    counts = np.bincount(events["y"].astype(np.int64) * 80 + events["x"], minlength=4800)
    assert (counts > 100).sum() == 3
    assert counts[counts < 100].mean() == pytest.approx(2.0, rel=0.05)
    assert events["p"].mean() == pytest.approx(params.noise_on_share, abs=0.03)
