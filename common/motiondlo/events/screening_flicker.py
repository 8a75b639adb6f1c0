"""Lamps that flicker: where the signed event rate alternates with one period, at twice the mains' frequency."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.events.screening_kernels import find_periods, signed_blocks
from motiondlo.events.screening_params import ScreeningParams
from motiondlo.events.types import SensorGeometry

BLOCK_TILES = 4
_SAMPLES = 64
_FEWEST = 40
_SPAN_US = 130_000
_EVERY_US = 32_000
_HOLD_US = 300_000
_STEP_HZ = 2.5
_LONGEST_BATCH_US = 3500
"""Longer batches cannot tell the frequencies apart."""


class FlickerFinder:
    """``tiles`` (R, C) uint8: 1 where a lamp flickers; ``hz`` and ``period_us``: how fast, 0 where none does."""

    def __init__(self, params: ScreeningParams, shape: tuple[int, int], geometry: SensorGeometry) -> None:
        self.params = params
        self.geometry = geometry
        self.tiles: npt.NDArray[np.uint8] = np.zeros(shape, np.uint8)
        self.hz = 0.0
        self.bursts: npt.NDArray[np.int64] = np.zeros((0, 0, 0), np.int64)
        """(2, H, W) see :func:`motiondlo.events.screening_kernels.file_screened`; only while there is flicker."""
        blocks = (-(-shape[0] // BLOCK_TILES), -(-shape[1] // BLOCK_TILES))
        self._signed = np.zeros((_SAMPLES, *blocks), np.float32)
        self._total = np.zeros((_SAMPLES, *blocks), np.float32)
        self._times = np.zeros(_SAMPLES, np.int64)
        self._filled = 0
        self._found = np.zeros(blocks)
        self._until_us = np.zeros(blocks, np.int64)
        low, high = sorted((params.flicker_lowest_hz, params.flicker_highest_hz))
        self._frequencies = np.arange(low, high + 0.5 * _STEP_HZ, _STEP_HZ)
        self._next_us = 0

    @property
    def period_us(self) -> float:
        """Of the lamps; 1 where none flickers."""
        return 1e6 / self.hz if self.hz > 0.0 else 1.0

    def clear(self) -> None:
        """Forget what the rates were: time went back."""
        self._filled = 0
        self._next_us = 0
        self._until_us[:] = 0
        self._settle(0)

    def look(self, t_us: int, span_us: int, counts: npt.NDArray[np.int32], ups: npt.NDArray[np.int32]) -> None:
        """Take a batch's events per tile, all and those of polarity 1, (R, C) each."""
        if span_us > _LONGEST_BATCH_US:
            self._filled = 0
            return
        k = self._filled % _SAMPLES
        signed_blocks(counts, ups, BLOCK_TILES, self._signed[k], self._total[k])
        self._times[k] = t_us - span_us // 2
        self._filled += 1
        if t_us < self._next_us or self._filled < _FEWEST:
            return
        self._next_us = t_us + _EVERY_US
        order = np.arange(max(self._filled - _SAMPLES, 0), self._filled) % _SAMPLES
        order = order[self._times[order] > t_us - _SPAN_US]
        find_periods(
            self._times[order], self._signed[order], self._total[order], self._frequencies,
            float(self.params.flicker_events), self.params.flicker_power, self._found,
        )  # fmt: skip
        if self._found.any() or self.hz > 0.0:
            self._until_us[self._found > 0.0] = t_us + _HOLD_US
            self._settle(t_us)

    def _settle(self, t_us: int) -> None:
        fresh = self._found > 0.0
        active = self._until_us > t_us
        if fresh.any():
            self.hz = float(np.median(self._found[fresh]))
        if not active.any():
            self.hz = 0.0
            self.tiles[:] = 0
            self.bursts = np.zeros((0, 0, 0), np.int64)
            return
        if not len(self.bursts):
            self.bursts = np.zeros((2, self.geometry.height_px, self.geometry.width_px), np.int64)
        rows, columns = self.tiles.shape
        wide = np.repeat(np.repeat(active, BLOCK_TILES, axis=0), BLOCK_TILES, axis=1)
        self.tiles[:] = wide[:rows, :columns]
