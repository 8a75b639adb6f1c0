"""Region of interest around the predicted curve, on a grid of cells.

The paper restricts the work to where the DLO is expected (its correspondence "trust region" is relative to the curve);
the shape of the region is our choice: a tube around the predicted curve, wider at speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.events.types import SensorGeometry
from motiondlo.tracking.paper.params import PaperParams

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Region:
    """Cells of the sensor that are looked at. Cell (row r, column c) covers ``cell_px`` squared pixels."""

    inside: npt.NDArray[np.uint8]
    """(h, w) 0 outside the region; inside, 1 + the number of the curve's segment that the cell is near."""
    x0_px: int
    y0_px: int
    cell_px: int

    def to_pixels(self, cells: FloatArray) -> FloatArray:
        """(N, 2) cell coordinates (column, row) -> event px: the centre of the cell's pixels."""
        return np.asarray(cells * self.cell_px + self._origin_px, dtype=np.float64)

    def to_cells(self, points: FloatArray) -> FloatArray:
        """(N, 2) event px -> (column, row) cell coordinates, not rounded."""
        return np.asarray((points - self._origin_px) / self.cell_px, dtype=np.float64)

    @property
    def _origin_px(self) -> FloatArray:
        """(2,) centre of cell (0, 0)."""
        return np.array([self.x0_px, self.y0_px], np.float64) + (self.cell_px - 1) / 2.0


def cell_size_px(params: PaperParams, diameter_px: float) -> int:
    """Edge of a mask cell: fine enough that a DLO stays about a dozen cells wide."""
    return params.mask_cell_px or int(np.clip(round(diameter_px / 12.0), 1, 4))


def whole_sensor(geometry: SensorGeometry, cell_px: int) -> Region:
    """Every cell of the sensor."""
    shape = (-(-geometry.height_px // cell_px), -(-geometry.width_px // cell_px))
    return Region(np.ones(shape, np.uint8), 0, 0, cell_px)


def tube_around(curve: FloatArray, half_width_px: float, geometry: SensorGeometry, cell_px: int) -> Region | None:
    """Cells within about ``half_width_px`` of a polyline, beyond its ends too; None where that misses the sensor.

    curve: (M, 2) event px, finite.
    """
    low = np.floor(curve.min(axis=0) - half_width_px)
    high = np.ceil(curve.max(axis=0) + half_width_px)
    x0, y0 = (int(v) for v in np.clip(low, 0, [geometry.width_px, geometry.height_px]))
    x1, y1 = (int(v) for v in np.clip(high + 1, 0, [geometry.width_px, geometry.height_px]))
    if x1 <= x0 or y1 <= y0:
        return None
    region = Region(np.zeros((-(-(y1 - y0) // cell_px), -(-(x1 - x0) // cell_px)), np.uint8), x0, y0, cell_px)
    # OpenCV takes 16-bit coordinates safely; what lies further out than that cannot touch the sensor.
    cells = np.clip(np.round(region.to_cells(curve)), -16_000, 16_000).astype(np.int32)
    thickness = max(round(2.0 * half_width_px / cell_px), 1)
    for k in range(len(cells) - 1):
        ends = (int(cells[k, 0]), int(cells[k, 1])), (int(cells[k + 1, 0]), int(cells[k + 1, 1]))
        cv2.line(region.inside, *ends, (min(k + 1, 255),), thickness)
    return region if region.inside.any() else None
