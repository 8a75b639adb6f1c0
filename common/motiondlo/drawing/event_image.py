"""Events of a short time as a picture."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.events.types import EventArray, SensorGeometry

Image = npt.NDArray[np.uint8]

_GROUND = (26, 24, 22)
_ON = (205, 205, 205)
_OFF = (190, 128, 72)


def event_image(events: EventArray, geometry: SensorGeometry) -> Image:
    """Picture of (N,) events in time order: light where the newest was ON, blue where it was OFF.

    Neutral on purpose, so that the colours of the DLOs stand out. Returns (H, W, 3) uint8 BGR.
    """
    image = np.empty((geometry.height_px, geometry.width_px, 3), np.uint8)
    image[:] = _GROUND
    inside = (events["x"] < geometry.width_px) & (events["y"] < geometry.height_px)
    x, y, on = events["x"][inside], events["y"][inside], events["p"][inside] > 0
    # With repeated pixels the last assignment, the newest event, wins.
    image[y, x] = np.where(on[:, None], np.array(_ON, np.uint8), np.array(_OFF, np.uint8))
    return image
