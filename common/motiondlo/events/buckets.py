"""Event buckets: the last events of every tile of the sensor, and the time of the last event per pixel.

Whoever looks for recent events in a small region reads the tiles that touch it, newest first, and stops at the first
event that is too old: the cost follows the events that are found, not the area that is looked at.

The time per pixel is noted only where and when somebody asks for it: a write to a place of its own for every event took
as long as all the rest of filing it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.events.bucket_kernels import LARGEST_PX, TILE_SHIFT, file_events, tile_at
from motiondlo.events.joining import event_words
from motiondlo.events.surface import NEVER_US
from motiondlo.events.types import EventArray, SensorGeometry

CAPACITY = 512


class EventBuckets:
    """``rings`` (tiles, CAPACITY) int64 words, ``heads`` (tiles,) int64; ``last_us`` (2, H, W) int64.

    The legend of words and tiles is in :mod:`motiondlo.events.bucket_kernels`; ``last_us`` is what
    :func:`motiondlo.events.bucket_kernels.note_times` made of it, where it was called.
    """

    def __init__(self, geometry: SensorGeometry) -> None:
        """Raise ValueError for a sensor that is too large for a word."""
        if geometry.height_px > LARGEST_PX or geometry.width_px > 2 * LARGEST_PX:
            raise ValueError(f"a sensor of {geometry.width_px}x{geometry.height_px} px is too large")
        self.geometry = geometry
        self.columns = ((geometry.width_px - 1) >> TILE_SHIFT) + 1
        rows = ((geometry.height_px - 1) >> TILE_SHIFT) + 1
        # Written once, so that no page is mapped while something moves.
        self.rings: npt.NDArray[np.int64] = np.full((rows * self.columns, CAPACITY), 0, np.int64)
        self.heads: npt.NDArray[np.int64] = np.zeros(rows * self.columns, np.int64)
        self.last_us: npt.NDArray[np.int64] = np.full((2, geometry.height_px, geometry.width_px), NEVER_US, np.int64)
        self.background: npt.NDArray[np.float32] = np.zeros(rows * self.columns, np.float32)
        """(tiles,) events/px/ms that are there whatever the DLOs do; whoever screens the events writes it."""
        self.region: npt.NDArray[np.uint8] = np.zeros((0, 0), np.uint8)
        """(H, W) not 0 where events are left out, so that silence says nothing there; (0, 0) for nowhere."""
        self.outside = 0
        """Events outside the sensor so far."""

    def background_at(self, x_px: float, y_px: float) -> float:
        """Events/px/ms that are there whatever the DLOs do, at a place on the sensor or at the nearest."""
        return float(self.background[tile_at(x_px, y_px, self.heads, self.columns)])

    def update(self, events: EventArray) -> None:
        """Take events (N,) in time order."""
        if len(events):
            self.outside += file_events(
                event_words(events),
                self.geometry.width_px,
                self.geometry.height_px,
                self.rings,
                self.heads,
                self.columns,
            )

    def clear(self) -> None:
        """Forget all events."""
        self.heads.fill(0)
        self.last_us.fill(NEVER_US)
