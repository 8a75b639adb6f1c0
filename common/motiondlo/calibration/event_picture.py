"""Brightness from events: enough of it to find a board's corners while it moves or blinks."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.calibration.event_picture_kernels import leak_and_add
from motiondlo.events.types import EventArray, SensorGeometry

Grey = npt.NDArray[np.uint8]

_SMOOTH_PX = 1.0
_CLIPPED_PERCENT = 2.0


class EventPicture:
    """Sums polarities with a leak: a moving or blinking pattern shows as in a photograph, what rests fades."""

    def __init__(self, geometry: SensorGeometry, tau_ms: float = 100.0) -> None:
        shape = (geometry.height_px, geometry.width_px)
        self._level = np.zeros(shape, np.float32)
        self._last_us = np.zeros(shape, np.int64)
        self._tau_us = tau_ms * 1000.0

    def add(self, events: EventArray) -> None:
        """Take (N,) events in time order."""
        leak_and_add(events["x"], events["y"], events["p"], events["t"], self._tau_us, self._level, self._last_us)

    def at(self, t_us: int) -> Grey:
        """(H, W) uint8 picture at ``t_us``, light where it became lighter; contrast stretched to its own extremes."""
        level = self._level * np.exp(-np.maximum(t_us - self._last_us, 0) / self._tau_us).astype(np.float32)
        level = cv2.GaussianBlur(level, (0, 0), _SMOOTH_PX)
        low, high = np.percentile(level, [_CLIPPED_PERCENT, 100.0 - _CLIPPED_PERCENT])
        if high - low < 1e-6:
            return np.zeros(level.shape, np.uint8)
        return np.asarray(np.clip((level - low) / (high - low) * 255.0, 0, 255), dtype=np.uint8)
