"""Regions of the sensor that are not to be looked at: rectangles and polygons in event px."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.events.types import SensorGeometry

MOST_REGIONS = 64
MOST_NUMBERS = 400


def wrong_region(corners: Sequence[float]) -> str:
    """What is wrong with a region's numbers; empty when nothing is.

    Four numbers are a rectangle (x0, y0, x1, y1), six and more the corners of a polygon (x, y, x, y, ...).
    """
    if len(corners) < 4 or len(corners) % 2 or len(corners) > MOST_NUMBERS:
        return f"four numbers (x0, y0, x1, y1), or an even number of 6 to {MOST_NUMBERS} (x, y of each corner)"
    if not np.isfinite(np.asarray(corners, np.float64)).all() or np.abs(corners).max() > 1e5:
        return "numbers in event px"
    if len(corners) == 4 and (corners[2] <= corners[0] or corners[3] <= corners[1]):
        return "a rectangle with x0 < x1 and y0 < y1"
    return ""


def region_mask(regions: Mapping[str, Sequence[float]], geometry: SensorGeometry) -> npt.NDArray[np.uint8]:
    """(H, W) uint8, 1 at the pixels whose centre lies in a region. Raises ValueError naming a wrong region."""
    mask = np.zeros((geometry.height_px, geometry.width_px), np.uint8)
    for name, corners in regions.items():
        wrong = wrong_region(corners)
        if wrong:
            raise ValueError(f"region {name!r} should be {wrong}")
        points = np.asarray(corners, np.float64).reshape(-1, 2)
        if len(points) == 2:
            (x0, y0), (x1, y1) = points
            points = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
        # cv2 wants integers, with a fixed number of binary places.
        cv2.fillPoly(mask, [np.rint(points * 16.0).astype(np.int32)], 1, shift=4)
    return mask


def covers_nothing(corners: Sequence[float], geometry: SensorGeometry) -> bool:
    """Whether a region (sound, see :func:`wrong_region`) touches no pixel of the sensor."""
    return not region_mask({"": corners}, geometry).any()
