"""Nearest places of many curves for many points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motiondlo.offline.metrics_kernels import nearest_places

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Places:
    """For each row and point, all (R, P)."""

    distance: FloatArray
    normal_distance: FloatArray
    """To the line through the nearest segment: without the part along the curve that a distance past an end has."""
    segment: npt.NDArray[np.int64]
    fraction: FloatArray
    nearest_node: npt.NDArray[np.int64]


def places_on(curves: FloatArray, points: FloatArray) -> Places:
    """Nearest places on each row's polyline. curves: (R, C, 2) with C >= 2, points: (R, P, 2), same unit."""
    shape = points.shape[:2]
    found = Places(
        np.empty(shape), np.empty(shape), np.empty(shape, np.int64), np.empty(shape), np.empty(shape, np.int64)
    )
    nearest_places(
        np.ascontiguousarray(points, np.float64),
        np.ascontiguousarray(curves, np.float64),
        found.distance,
        found.normal_distance,
        found.segment,
        found.fraction,
        found.nearest_node,
    )
    return found
