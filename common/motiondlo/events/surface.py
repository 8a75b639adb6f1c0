"""The polarity-separated time-stamp surface (paper, "Event Branch": time surfaces)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.events.joining import event_words
from motiondlo.events.surface_kernels import write_surface
from motiondlo.events.types import EventArray, SensorGeometry

NEVER_US = -(1 << 60)
"""Time stamp of a pixel that has not fired."""


class TimeSurface:
    """Time of the last event per pixel and polarity.

    ``last_us``: (2, H, W) int64, polarity 0 (off) and 1 (on); NEVER_US where a pixel has not fired.
    """

    def __init__(self, geometry: SensorGeometry) -> None:
        self.geometry = geometry
        shape = (geometry.height_px, geometry.width_px)
        self.last_us: npt.NDArray[np.int64] = np.full((2, *shape), NEVER_US, np.int64)
        self.outside = 0
        """Events outside the sensor so far."""

    def update(self, events: EventArray) -> None:
        """Take events (N,) in time order."""
        if len(events):
            self.outside += write_surface(event_words(events), self.last_us)

    def clear(self) -> None:
        """Forget all events."""
        self.last_us.fill(NEVER_US)
