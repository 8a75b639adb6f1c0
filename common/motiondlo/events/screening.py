"""What of the events is to be believed: regions left out, flashes, flicker, hot pixels, and the background elsewhere.

Everything is found from the events per tile and batch, and from what the buckets hold anyway: a batch costs a pass over
the tiles, its events nothing beyond being counted; only where something is left out, filing tests each event.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from motiondlo.events.bucket_kernels import file_events
from motiondlo.events.buckets import EventBuckets
from motiondlo.events.joining import event_words
from motiondlo.events.screening_flicker import FlickerFinder
from motiondlo.events.screening_hot import HotPixelFinder
from motiondlo.events.screening_kernels import (
    HOT,
    TILE_PX2,
    count_tiles,
    file_screened,
    free_median,
    learn_tiles,
    share_above,
    write_background,
)
from motiondlo.events.screening_params import ScreeningParams
from motiondlo.events.screening_regions import region_mask
from motiondlo.events.types import EventArray, EventBatch

_BUSY_COUNT = 2
_LEARNED_AFTER_MS = 300.0
_FLASH_OVER_BACKGROUND = 4.0
_NOTHING = np.zeros((0, 0), np.uint8)


class EventScreening:
    """Between a tracker's batches and its buckets."""

    def __init__(self, params: ScreeningParams, buckets: EventBuckets) -> None:
        self.params = params
        self.buckets = buckets
        self.geometry = buckets.geometry
        shape = (len(buckets.heads) // buckets.columns, buckets.columns)
        self.counts: npt.NDArray[np.int32] = np.zeros(shape, np.int32)
        """(R, C) events of the batch per tile, without masked ones."""
        self.masked: npt.NDArray[np.uint8] = _NOTHING
        """(H, W) uint8, not 0 where events are left out (bit 0 a region, bit 1 a hot pixel); (0, 0) for nowhere."""
        self.flash = False
        """The batch belongs to a flash: none of its events are to be filed."""
        self.totals: dict[str, int] = {"flashes": 0, "flash_batches": 0, "masked_events": 0, "flicker_events": 0}
        self._both = np.zeros(shape, np.int64)
        self._ups = np.zeros(shape, np.int32)
        self._busy = np.zeros(shape, np.float32)
        self._rate = np.zeros(shape, np.float32)
        self._learned_ms = 0.0
        self._learned = 0
        self._overall = 0.0
        self._flash_since_us = -1
        self._regions: dict[str, tuple[float, ...]] = {}
        self._flicker = FlickerFinder(params, shape, self.geometry) if params.flicker else None
        self._hot = HotPixelFinder(params, self.counts.size) if params.hot_pixels else None

    # regions

    @property
    def regions(self) -> dict[str, tuple[float, ...]]:
        """The regions that are left out, by name: x0, y0, x1, y1 of a rectangle or x, y of a polygon's corners."""
        return dict(self._regions)

    def set_regions(self, regions: Mapping[str, Sequence[float]]) -> None:
        """Leave these regions out, and no others. Raises ValueError for a wrong one."""
        mask = region_mask(regions, self.geometry)
        self._regions = {name: tuple(float(value) for value in corners) for name, corners in regions.items()}
        if len(self.masked):
            self.masked = np.where(self.masked & HOT, np.uint8(HOT), np.uint8(0)) | mask
        else:
            self.masked = mask.copy()  # 1 is REGION; hot pixels are added to it
        self._drop_empty_mask()
        self.buckets.region = mask if mask.any() else _NOTHING

    def _drop_empty_mask(self) -> None:
        if len(self.masked) and not self.masked.any():
            self.masked = _NOTHING

    # batches

    def look(self, batch: EventBatch, tiles: npt.NDArray[np.uint32], moving_bits: int) -> None:
        """Count a batch's events per tile, and judge them before they are filed.

        tiles: (R, C) a bit for every DLO that touches a tile; moving_bits: those of the DLOs that move.
        """
        span_us = max(batch.t1_us - batch.t0_us, 1)
        span_ms = span_us * 1e-3
        count_tiles(
            event_words(batch.events), self.masked, self.geometry.width_px, self.geometry.height_px, self._both,
            self.counts, self._ups,
        )  # fmt: skip
        if self.params.flashes:
            self._judge_flash(batch, span_ms)
        if self.flash:
            return
        if self.params.background:
            now = free_median(self.counts, tiles) / (TILE_PX2 * span_ms)
            self._overall += (1.0 - math.exp(-span_ms / self.params.background_ms)) * (now - self._overall)
            # What was there a moment ago and is there no more is no background: it falls at once.
            self._overall = min(self._overall, now)
        if self.params.learned_regions:
            self._learned_ms += span_ms
            share = min(span_ms / min(self._learned_ms, self.params.learned_ms), 1.0)
            learn_tiles(self.counts, tiles, np.uint32(moving_bits), share, span_ms, _BUSY_COUNT, self._busy, self._rate)
        if self.params.background or self.params.learned_regions:
            sure = self._learned_ms >= _LEARNED_AFTER_MS
            least = self.params.learned_share if sure else 2.0
            self._learned = int(
                write_background(
                    self._overall,
                    self._busy,
                    self._rate,
                    least,
                    self.params.learned_most_hz_px * 1e-3,
                    self.buckets.background,
                )
            )
        if self._flicker is not None:
            self._flicker.look(batch.t1_us, span_us, self.counts, self._ups)
        if self._hot is not None:
            mask = (
                self.masked
                if len(self.masked)
                else np.zeros((self.geometry.height_px, self.geometry.width_px), np.uint8)
            )
            busy = (tiles & np.uint32(moving_bits)).reshape(-1) != 0
            if self._hot.look(batch.t1_us, self.buckets.rings, self.buckets.heads, busy, mask):
                self.masked = mask
                self._drop_empty_mask()

    def _judge_flash(self, batch: EventBatch, span_ms: float) -> None:
        p = self.params
        least = max(p.flash_events, _FLASH_OVER_BACKGROUND * self._overall * TILE_PX2 * span_ms)
        fires = (
            len(batch.events) >= p.flash_share * least * self.counts.size
            and share_above(self.counts, least) >= p.flash_share
        )
        if fires and self._flash_since_us < 0:
            self._flash_since_us = batch.t0_us
            self.totals["flashes"] += 1
        elif not fires:
            self._flash_since_us = -1
        self.flash = fires and batch.t1_us - self._flash_since_us <= 1000.0 * p.flash_ms
        self.totals["flash_batches"] += self.flash

    def file(self, events: EventArray) -> None:
        """File those of the events (N,) of the batch last looked at that are not left out."""
        if self.flash or not len(events):
            return
        b = self.buckets
        words = event_words(events)
        width, height = self.geometry.width_px, self.geometry.height_px
        flicker = self._flicker
        if not len(self.masked) and (flicker is None or flicker.hz == 0.0):
            b.outside += file_events(words, width, height, b.rings, b.heads, b.columns)
            return
        outside, hidden, suppressed = file_screened(
            words, width, height, b.rings, b.heads, b.columns, self.masked,
            flicker.tiles if flicker is not None else _NOTHING,
            flicker.bursts if flicker is not None else np.zeros((0, 0, 0), np.int64),
            flicker.period_us if flicker is not None else 1.0, self.params.flicker_tolerance,
        )  # fmt: skip
        b.outside += outside
        self.totals["masked_events"] += int(hidden)
        self.totals["flicker_events"] += int(suppressed)

    def clear(self) -> None:
        """Time went back: forget what depends on it; masks and learned regions stay."""
        self.buckets.clear()
        self._flash_since_us = -1
        self.flash = False
        if self._flicker is not None:
            self._flicker.clear()

    def report(self) -> dict[str, int | float]:
        """What is going on, for health: counts, the lamps' frequency, the background's rate a pixel."""
        flicker = self._flicker
        return {
            **self.totals,
            "masked_regions": len(self._regions),
            "hot_pixels": self._hot.count if self._hot is not None else 0,
            "learned_tiles": self._learned,
            "flicker_hz": flicker.hz if flicker is not None else 0.0,
            "flicker_tiles": int(flicker.tiles.sum()) if flicker is not None else 0,
            "background_hz_px": round(1000.0 * self._overall, 3),
        }
