"""What could hide a part of a DLO: other DLOs that were found, grippers, plates."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.frames.masks import Mask

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Cover:
    """A mask at working size that is asked with image px."""

    mask: Mask
    """(h, w) uint8 0/1."""
    scale: float
    """Image px per working px."""

    def at(self, places: FloatArray) -> npt.NDArray[np.bool_]:
        """Whether each place is covered; outside the image nothing is. (..., 2) image px -> (...) bool."""
        at = np.round((places + 0.5) / self.scale - 0.5).astype(np.int64)
        height, width = self.mask.shape
        inside = (at >= 0).all(axis=-1) & (at[..., 0] < width) & (at[..., 1] < height)
        rows, columns = np.clip(at[..., 1], 0, height - 1), np.clip(at[..., 0], 0, width - 1)
        return np.asarray((self.mask[rows, columns] > 0) & inside, dtype=np.bool_)


Band = tuple[FloatArray, float]
"""Centreline (K, 2) and width of a measured piece, image px."""


def cover_of(shape: tuple[int, int], scale: float, bands: list[Band], obstacles: Mask | None = None) -> Cover:
    """Measured pieces and obstacles, (h, w) = ``shape`` at working size."""
    mask = np.zeros(shape, np.uint8) if obstacles is None else obstacles.copy()
    for centre, width in bands:
        points = np.round((centre + 0.5) / scale - 0.5).astype(np.int32)
        cv2.polylines(mask, [points.reshape(-1, 1, 2)], False, 1, max(1, round(width / scale)))
    return Cover(mask, scale)
