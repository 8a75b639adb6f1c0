"""Refinement of the merged mask before thinning (paper, "Binary Mask Generation" and "Polyline fitting")."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.frames.classical import fill_holes
from motiondlo.frames.masks import Mask
from motiondlo.frames.params import CleaningParams


def clean_mask(mask: Mask, params: CleaningParams) -> Mask:
    """Closing, removal of small components, filling of small holes, light closing, final minimum area.

    mask: (h, w) uint8 0/1. Paper, "Binary Mask Generation"; radii and areas scale with the image.
    """
    height, width = mask.shape
    area = height * width
    result = close(mask, params.closing_radius * width)
    result = remove_small(result, 0.5 * params.min_area * area)
    result = fill_holes(result, params.max_hole_area * area)
    result = close(result, params.final_closing_radius * width)
    return remove_small(result, params.min_area * area)


def adaptive_closing(mask: Mask, params: CleaningParams) -> Mask:
    """Second closing before thinning (paper, "Polyline fitting").

    The full radius closes gaps inside a DLO; where two components lie within the closing's reach of one another (nearer
    than twice the radius), the reduced radius keeps them apart. Then small components are dropped.
    """
    height, width = mask.shape
    radius = params.adaptive_radius * width
    if smallest_component_gap(mask) < 2.0 * radius:
        radius = params.reduced_radius * width
    return remove_small(close(mask, radius), params.min_area * height * width)


def close(mask: Mask, radius_px: float) -> Mask:
    """Closing with a disk, as if the mask went on beyond the image: a DLO that leaves it keeps its width."""
    radius = round(radius_px)
    if radius < 1:
        return mask
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    padded = cv2.copyMakeBorder(mask, radius, radius, radius, radius, cv2.BORDER_REPLICATE)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disk)
    return np.asarray(closed[radius:-radius, radius:-radius], dtype=np.uint8)


def remove_small(mask: Mask, min_area_px: float) -> Mask:
    """Drop 8-connected components of fewer than ``min_area_px`` pixels."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    keep = np.zeros(count, np.uint8)
    keep[1:] = stats[1:, cv2.CC_STAT_AREA] >= min_area_px
    return np.asarray(keep[labels], dtype=np.uint8)


def smallest_component_gap(mask: Mask) -> float:
    """Smallest distance between two components, px; infinite with fewer than two.

    Every background pixel knows its nearest component; where two such regions meet, the gap is the sum of both
    distances.
    """
    count, labels = cv2.connectedComponents(mask, connectivity=8)
    if count < 3:
        return float("inf")
    distance, nearest = cv2.distanceTransformWithLabels(1 - mask, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    owner = np.zeros(int(nearest.max()) + 1, np.int32)
    owner[nearest[mask > 0]] = labels[mask > 0]
    regions: npt.NDArray[np.int32] = owner[nearest]
    gap = np.inf
    for a, b, da, db in (
        (regions[:, :-1], regions[:, 1:], distance[:, :-1], distance[:, 1:]),
        (regions[:-1], regions[1:], distance[:-1], distance[1:]),
    ):
        meets = a != b
        if meets.any():
            gap = min(gap, float((da[meets] + db[meets]).min()))
    return gap
