"""From RGB to event pixels through both lenses: undo one, apply the homography, apply the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.errors import CalibrationError
from motiondlo.geometry.homography import warp_points
from motiondlo.geometry.lens import LensModel

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class CameraMap:
    """A homography between ideal cameras, with the lenses that the real ones have."""

    event_from_rgb: FloatArray
    """(3, 3), from undistorted RGB to undistorted event pixels."""
    rgb_lens: LensModel | None = None
    event_lens: LensModel | None = None


def map_points(points_rgb: FloatArray, event_from_rgb: FloatArray | CameraMap) -> FloatArray:
    """RGB pixels to event pixels, both as the cameras have them. (N, 2) -> (N, 2) float64."""
    if not isinstance(event_from_rgb, CameraMap):
        return warp_points(points_rgb, event_from_rgb)
    rgb, event = event_from_rgb.rgb_lens, event_from_rgb.event_lens
    ideal = points_rgb if rgb is None else rgb.undistorted(points_rgb)
    mapped = warp_points(ideal, event_from_rgb.event_from_rgb)
    return mapped if event is None else event.distorted(mapped)


def map_points_back(points_event: FloatArray, event_from_rgb: FloatArray | CameraMap) -> FloatArray:
    """Event pixels to RGB pixels, both as the cameras have them. (N, 2) -> (N, 2) float64.

    Raises CalibrationError for a singular matrix.
    """
    if not isinstance(event_from_rgb, CameraMap):
        return warp_points(points_event, _inverse(event_from_rgb))
    rgb, event = event_from_rgb.rgb_lens, event_from_rgb.event_lens
    ideal = points_event if event is None else event.undistorted(points_event)
    mapped = warp_points(ideal, _inverse(event_from_rgb.event_from_rgb))
    return mapped if rgb is None else rgb.distorted(mapped)


def _inverse(matrix: FloatArray) -> FloatArray:
    try:
        return np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise CalibrationError("event_from_rgb: singular, it cannot be inverted.", "Calibrate it again.") from error
