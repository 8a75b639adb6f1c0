"""Spatio-temporal noise filter (paper, "Event Branch: Dynamic DLO").

"... suppresses noise by retaining only those events that are corroborated by spatially and temporally neighboring
events within a defined radius and time window, effectively discarding isolated, spurious activations." The paper leaves
the filter to the camera's software; this is the same rule for recorded events.
"""

from __future__ import annotations

import numpy as np

from motiondlo.events.types import EventArray, SensorGeometry
from motiondlo.tracking.paper.noise_kernels import keep_corroborated
from motiondlo.tracking.paper.params import PaperParams

NEVER_US = -(1 << 62)
"""Time stamp of a pixel that has not fired; far enough back for every window, far enough from the int64 limit."""


class NoiseFilter:
    """Keeps corroborated events; remembers one time stamp per pixel between batches."""

    def __init__(self, params: PaperParams, geometry: SensorGeometry) -> None:
        self._params = params
        self._last_us = np.full((geometry.height_px, geometry.width_px), NEVER_US, np.int64)
        self._keep = np.empty(0, np.uint8)

    def filter(self, events: EventArray) -> EventArray:
        """(N,) events in time order -> (K,) events kept, K <= N."""
        p = self._params
        n = len(events)
        if n > len(self._keep):
            self._keep = np.empty(max(n, 2 * len(self._keep)), np.uint8)
        keep = self._keep[:n]
        kept = keep_corroborated(
            events["t"],
            events["x"],
            events["y"],
            self._last_us,
            p.filter_radius_px,
            p.filter_window_us,
            p.hot_pixel_period_us,
            keep,
        )
        return events if kept == n else events[keep.view(np.bool_)]
