"""An event camera that looks at rendered images."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.events.types import EVENT_DTYPE, EventArray
from motiondlo.simulation.raster_kernels import TILE
from motiondlo.simulation.scene import SensorParams
from motiondlo.simulation.sensor_kernels import advance_tiles, settle

FloatImage = npt.NDArray[np.float32]
Tiles = npt.NDArray[np.uint8]

DARK = 0.012
"""Linear light that every pixel sees."""
_SLICE_US = 120.0
# Tiles are watched on for this long after they were drawn last: photoreceptors and dead times run on.
_WATCH_US = 4000.0
# The rows' readout is interleaved.
_ROW_STRIDE = 19


class EventSensor:
    """Pixels with their mismatches; give it images in time order."""

    def __init__(self, params: SensorParams, image: FloatImage, gain: FloatImage, rng: np.random.Generator) -> None:
        h, w = gain.shape
        self._params = params
        self._on = np.maximum(params.threshold_on + rng.normal(0, params.mismatch, (h, w)), 0.05).astype(np.float32)
        self._off = np.maximum(params.threshold_off + rng.normal(0, params.mismatch, (h, w)), 0.05).astype(np.float32)
        dead = params.refractory_us * (1.0 + params.refractory_mismatch * rng.normal(0, 1, (h, w)))
        self._dead_us = np.maximum(dead, 0.2 * params.refractory_us).astype(np.float32)
        self._jitter = (params.jitter * rng.normal(0, 1, (h, w))).astype(np.float32)
        self._state = np.array([rng.integers(1, 2**62)], np.uint64)
        self._log, self._output, self._memory = (np.zeros((h, w), np.float32) for _ in range(3))
        self._ready_us = np.full((h, w), -1.0)
        settle(image, gain, DARK, self._log, self._output, self._memory)
        tiles = (-(-h // TILE), -(-w // TILE))
        self._seen_us, self._watch_until_us = np.zeros(tiles), np.full(tiles, -1.0)
        self._out = (np.empty(2 * h * w), *(np.empty(2 * h * w, np.int32) for _ in range(3)))

    def advance(self, image: FloatImage, gain: FloatImage, drawn: Tiles, t_us: float) -> EventArray:
        """Events (N,), not in order, up to ``t_us``. drawn: tiles whose light has changed since the last call."""
        self._watch_until_us[drawn > 0] = t_us + _WATCH_US
        active = (self._watch_until_us >= t_us).astype(np.uint8)
        # A tile that was at rest has seen its old light until just now.
        idle = (drawn > 0) & (self._seen_us < self._last_us)
        self._seen_us[idle] = self._last_us
        self._last_us = t_us
        n = advance_tiles(
            image, gain, DARK, active, self._seen_us, t_us, self._params.tau_us, _SLICE_US, self._log, self._output,
            self._memory, self._ready_us, self._on, self._off, self._dead_us, self._jitter, self._params.jitter,
            self._state, *self._out,
        )  # fmt: skip
        t, y, x, p = (column[:n] for column in self._out)
        events = np.zeros(n, EVENT_DTYPE)
        events["t"] = row_time(t, y, self._params.row_period_us)
        events["x"], events["y"], events["p"] = x, y, p
        return events

    _last_us = 0.0


def row_time(t_us: npt.NDArray[np.float64], y: npt.NDArray[np.int32], period_us: int) -> npt.NDArray[np.int64]:
    """When a row is read out next: every row has its own phase in the period. (N,), (N,) -> (N,)."""
    phase = (_ROW_STRIDE * y.astype(np.int64)) % period_us
    return np.asarray((np.ceil((t_us - phase) / period_us) * period_us).astype(np.int64) + phase)


def background_activity(
    params: SensorParams, shape: tuple[int, int], duration_us: int, rng: np.random.Generator
) -> EventArray:
    """Noise events of all pixels and hot pixels (N,), not in order."""
    h, w = shape
    quiet = rng.poisson(params.noise_hz * h * w * duration_us * 1e-6)
    rates = params.hot_hz * rng.uniform(0.4, 1.6, params.hot_pixels)
    hot = rng.poisson(rates * duration_us * 1e-6)
    x = np.concatenate([rng.integers(0, w, quiet), np.repeat(rng.integers(0, w, params.hot_pixels), hot)])
    y = np.concatenate([rng.integers(0, h, quiet), np.repeat(rng.integers(0, h, params.hot_pixels), hot)])
    events = np.zeros(len(x), EVENT_DTYPE)
    events["t"] = row_time(rng.uniform(0, duration_us, len(x)), y.astype(np.int32), params.row_period_us)
    events["x"], events["y"] = x, y
    events["p"] = rng.random(len(x)) < params.noise_on_share
    return events
