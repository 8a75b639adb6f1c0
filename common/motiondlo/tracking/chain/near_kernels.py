"""Which places of the sensor belong to which moving DLO: a grid of bits, so that bystanders ignore its events."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

F8 = npt.NDArray[np.float64]
U4 = npt.NDArray[np.uint32]
B1 = npt.NDArray[np.bool_]

TILE_SHIFT = 4
"""Tiles of 16 x 16 px."""


@numba.njit(cache=True, nogil=True)
def mark(grid: U4, points: F8, reach_px: float, bit: int) -> None:
    """Set ``bit`` in all tiles within ``reach_px`` of ``points`` (N, >= 2), event px. grid: (rows, columns)."""
    rows, columns = grid.shape
    value = np.uint32(1) << np.uint32(bit)
    for k in range(points.shape[0]):
        x0 = max(int(points[k, 0] - reach_px) >> TILE_SHIFT, 0)
        x1 = min(int(points[k, 0] + reach_px) >> TILE_SHIFT, columns - 1)
        y0 = max(int(points[k, 1] - reach_px) >> TILE_SHIFT, 0)
        y1 = min(int(points[k, 1] + reach_px) >> TILE_SHIFT, rows - 1)
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                grid[y, x] |= value


@numba.njit(cache=True, nogil=True)
def marked_by_others(grid: U4, points: F8, bit: int, out: B1) -> int:
    """Whether each of ``points`` (N, >= 2) lies in a tile with any other bit than ``bit``; returns how many do."""
    rows, columns = grid.shape
    own = np.uint32(1) << np.uint32(bit)
    n = 0
    for k in range(points.shape[0]):
        x = int(points[k, 0]) >> TILE_SHIFT
        y = int(points[k, 1]) >> TILE_SHIFT
        out[k] = False
        if x >= 0 and y >= 0 and x < columns and y < rows and (grid[y, x] & ~own) != 0:
            out[k] = True
            n += 1
    return n
