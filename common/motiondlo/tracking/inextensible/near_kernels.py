"""Which DLOs have fresh events near them: what lets a DLO at rest cost next to nothing.

The sensor is cut into tiles; every tile carries a bit per DLO (ids modulo 32) whose neighbourhood it touches.
"""

from __future__ import annotations

import numba
import numpy as np

TILE_SHIFT = 4
"""Tiles are 16 px wide."""
MASK_BITS = 32


@numba.njit(cache=True, nogil=True)
def mark_tiles(points, reach_px, bit, width, height, tiles):  # type: ignore[no-untyped-def]
    """Set ``bit`` in every tile within ``reach_px`` of points (S, 2). tiles: (rows, columns) uint32."""
    flag = np.uint32(1 << bit)
    for i in range(points.shape[0]):
        x0 = max(0, int(points[i, 0] - reach_px))
        x1 = min(width - 1, int(points[i, 0] + reach_px))
        y0 = max(0, int(points[i, 1] - reach_px))
        y1 = min(height - 1, int(points[i, 1] + reach_px))
        if x1 < x0 or y1 < y0:
            continue
        for r in range(y0 >> TILE_SHIFT, (y1 >> TILE_SHIFT) + 1):
            for c in range(x0 >> TILE_SHIFT, (x1 >> TILE_SHIFT) + 1):
                tiles[r, c] |= flag


@numba.njit(cache=True, nogil=True)
def count_near(hits, tiles, counts):  # type: ignore[no-untyped-def]
    """Count events per bit of their tile. hits: (rows, columns) int32 events a tile; counts: (32,) int64, added to."""
    rows, columns = tiles.shape
    for r in range(rows):
        for c in range(columns):
            n = hits[r, c]
            if n == 0:
                continue
            flags = tiles[r, c]
            bit = 0
            while flags:
                if flags & np.uint32(1):
                    counts[bit] += n
                flags >>= np.uint32(1)
                bit += 1
