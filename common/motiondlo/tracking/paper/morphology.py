"""Morphological refinement of the event mask, scaled by the DLO's diameter (paper, "Event Branch: Dynamic DLO").

"... the closing and opening structuring elements and the number of closing iterations are scaled proportionally to
d_seg, so that gap-bridging and noise removal match the physical thickness of the DLO." The elements are disks; n
closings with one disk are one closing with a disk of n times its radius, and a disk of any size costs one distance
transform.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.tracking.paper.params import PaperParams

Mask = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class MorphologyScale:
    """Radii of the two disks, in cells."""

    close_cells: float
    open_cells: float


def morphology_scale(params: PaperParams, diameter_px: float, cell_px: int) -> MorphologyScale:
    """Closing kernel 1.5 d applied max(2, d / 25 px) times, opening kernel 0.3 d (paper)."""
    if not params.diameter_scaled_morphology:
        return MorphologyScale(params.fixed_close_px / 2.0 / cell_px, params.fixed_open_px / 2.0 / cell_px)
    times = max(2, round(diameter_px / params.close_iteration_px))
    close_px = times * params.close_diameters * diameter_px / 2.0
    return MorphologyScale(close_px / cell_px, params.open_diameters * diameter_px / 2.0 / cell_px)


def dilate(mask: Mask, radius: float) -> Mask:
    """Cells within ``radius`` of the mask. (h, w) uint8 0/1 -> the same."""
    if radius < 1.0 or not mask.any():
        return mask.copy()
    distance = cv2.distanceTransform(1 - mask, cv2.DIST_L2, 3)
    return np.asarray(distance <= radius, dtype=np.uint8)


def erode(mask: Mask, radius: float) -> Mask:
    """Cells further than ``radius`` from the background; the image's border is no background."""
    if radius < 1.0 or mask.all():
        return mask.copy()
    distance = cv2.distanceTransform(mask, cv2.DIST_L2, 3)
    return np.asarray(distance > radius, dtype=np.uint8)


def close_mask(mask: Mask, radius: float) -> Mask:
    """Binary closing with a disk; its extent near the border is right only where ``mask`` has a margin there."""
    return erode(dilate(mask, radius), radius)


def open_mask(mask: Mask, radius: float) -> Mask:
    """Binary opening with a disk."""
    return dilate(erode(mask, radius), radius)


def drop_small_parts(mask: Mask, smallest_cells: float) -> Mask:
    """Remove 8-connected parts of fewer than ``smallest_cells`` cells, whatever their shape."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if count <= 1:
        return mask
    keep = stats[:, cv2.CC_STAT_AREA] >= smallest_cells
    keep[0] = False
    return np.asarray(keep[labels], dtype=np.uint8)
