"""The polarity-separated time-stamp surface (paper, "Event Branch": time surfaces, spatio-temporal noise filter)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field

from motiondlo.events.joining import event_words
from motiondlo.events.surface_kernels import find_hot, screen_and_write, write_surface
from motiondlo.events.types import EVENT_DTYPE, EventArray, SensorGeometry

NEVER_US = -(1 << 60)
"""Time stamp of a pixel that has not fired."""


class SurfaceParams(BaseModel):
    """What is kept away from the surface; everything is off by default, because screening costs time."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")

    noise_filter: bool = Field(default=False, description="keep an event only if a neighbour fired shortly before")
    noise_window_us: int = Field(default=5000, ge=1, le=1_000_000, description="how shortly before, us")
    hot_pixel_mask: bool = Field(default=False, description="learn pixels that fire without cause, and ignore them")
    hot_window_us: int = Field(default=100_000, ge=1000, le=60_000_000, description="pixels are judged this often, us")
    hot_rate_hz: float = Field(default=80.0, gt=0, le=1e6, description="slower pixels are never called hot, Hz")
    hot_ratio: float = Field(default=8.0, gt=1, le=1000, description="how much faster than its 8 neighbours")
    hot_patience: int = Field(default=2, ge=1, le=100, description="judgements until a pixel is masked, or freed")
    hot_limit: int = Field(default=500, ge=0, le=100_000, description="pixels masked at most")


class TimeSurface:
    """Time of the last event per pixel and polarity.

    ``last_us``: (2, H, W) int64, polarity 0 (off) and 1 (on); NEVER_US where a pixel has not fired.
    ``hot``: (H, W) uint8, 1 where a pixel is masked.
    """

    def __init__(self, geometry: SensorGeometry, params: SurfaceParams | None = None) -> None:
        self.geometry = geometry
        self.params = params or SurfaceParams()
        shape = (geometry.height_px, geometry.width_px)
        self.last_us: npt.NDArray[np.int64] = np.full((2, *shape), NEVER_US, np.int64)
        self.hot: npt.NDArray[np.uint8] = np.zeros(shape if self.params.hot_pixel_mask else (0, 0), np.uint8)
        self.outside = 0
        """Events outside the sensor so far."""
        self._seen_us = np.full(shape if self.params.noise_filter else (0, 0), NEVER_US, np.int64)
        self._counts = np.zeros(self.hot.shape, np.uint16)
        self._score = np.zeros(self.hot.shape, np.int8)
        self._found = np.zeros(self.params.hot_limit, np.int64)
        self._window_start_us = NEVER_US
        self._window_rested = True

    @property
    def hot_pixels(self) -> int:
        """How many pixels are masked."""
        return int(np.count_nonzero(self.hot))

    def update(self, events: EventArray, resting: bool = True) -> EventArray:
        """Take events (N,) in time order; returns those that count: ``events`` itself when nothing screens them.

        resting: nothing is known to move. Hot pixels are learned only from stretches of rest.
        """
        if not len(events):
            return events
        packed = event_words(events)
        if not (self.params.noise_filter or self.params.hot_pixel_mask):
            self.outside += write_surface(packed, self.last_us)
            return events
        kept = np.empty_like(packed)
        n, outside = screen_and_write(
            packed, self.last_us, self.hot, self._counts, self._seen_us, self.params.noise_window_us, kept
        )
        self.outside += outside
        if self.params.hot_pixel_mask:
            self._window_rested &= resting
            self._judge_hot(int(events["t"][-1]))
        return kept[:n].view(EVENT_DTYPE)[:, 0]

    def clear(self) -> None:
        """Forget all events; hot pixels stay known."""
        self.last_us.fill(NEVER_US)
        self._seen_us.fill(NEVER_US)

    def _judge_hot(self, now_us: int) -> None:
        """At the end of a window: pixels gain or lose a point; at ``hot_patience`` they are masked, at 0 freed."""
        elapsed_us = now_us - self._window_start_us
        if 0 <= elapsed_us < self.params.hot_window_us:
            return
        if self._window_rested and elapsed_us < 2 * self.params.hot_window_us:
            least = max(int(self.params.hot_rate_hz * elapsed_us * 1e-6), 3)
            n = find_hot(self._counts, least, self.params.hot_ratio, self._found)
            # More than the limit at once is no set of defects: something moves, or the light changes.
            if n <= self.params.hot_limit:
                self._score[self._score > 0] -= 1
                rising = self._score.reshape(-1)
                rising[self._found[:n]] = np.minimum(rising[self._found[:n]] + 2, 2 * self.params.hot_patience)
                self._apply_scores()
        self._counts.fill(0)
        self._window_start_us = now_us
        self._window_rested = True

    def _apply_scores(self) -> None:
        self.hot[self._score == 0] = 0
        risen = np.flatnonzero((self._score >= self.params.hot_patience) & (self.hot == 0))
        self.hot.reshape(-1)[risen[: max(self.params.hot_limit - self.hot_pixels, 0)]] = 1
