"""Kernels of the event buckets: file new events under their tile, newest last.

Legend: a word holds one event: ``t_us << 22 | y << 12 | x << 1 | polarity``. Tiles are 16 px wide and high; tile
``(y >> 4) * columns + (x >> 4)`` has a ring of the last ``capacity`` (a power of two) words in ``rings`` (tiles,
capacity), and ``heads`` (tiles,) counts what was ever filed in it.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Int64Array = npt.NDArray[np.int64]

TILE_SHIFT = 4
TIME_SHIFT = 22
Y_SHIFT = 12
X_SHIFT = 1
COORDINATE_MASK = 0x7FF
Y_MASK = 0x3FF
LARGEST_PX = 1 << 10
"""Sensors up to this height and twice this width fit a word."""


@numba.njit(cache=True, nogil=True)
def file_events(packed: Int64Array, last_us: Int64Array, rings: Int64Array, heads: Int64Array, columns: int) -> int:
    """File events and note their times per pixel; returns how many lay outside the sensor.

    packed: (N, 2) (see :func:`motiondlo.events.joining.event_words`); last_us: (2, H, W) newest time per polarity.
    """
    height, width = last_us.shape[1], last_us.shape[2]
    mask = rings.shape[1] - 1
    outside = 0
    for i in range(len(packed)):
        place = packed[i, 1]
        x = place & 0xFFFF
        y = (place >> 16) & 0xFFFF
        if x < width and y < height:
            p = (place >> 32) & 1
            t = packed[i, 0]
            last_us[p, y, x] = t
            tile = (y >> TILE_SHIFT) * columns + (x >> TILE_SHIFT)
            head = heads[tile]
            rings[tile, head & mask] = (t << TIME_SHIFT) | (y << Y_SHIFT) | (x << X_SHIFT) | p
            heads[tile] = head + 1
        else:
            outside += 1
    return outside


@numba.njit(cache=True, nogil=True)
def tile_at(x, y, heads, columns):  # type: ignore[no-untyped-def]
    """The tile at a place in px; the nearest one for a place outside the sensor."""
    r = min(max(int(y), 0) >> TILE_SHIFT, heads.shape[0] // columns - 1)
    c = min(max(int(x), 0) >> TILE_SHIFT, columns - 1)
    return r * columns + c


@numba.njit(cache=True, nogil=True, fastmath=True)
def tiles_around(ox, oy, ex, ey, lo_a, hi_a, lo_b, hi_b, heads, columns):  # type: ignore[no-untyped-def]
    """Which tiles a turned rectangle touches: [lo_a, hi_a] along (ex, ey) from (ox, oy), [lo_b, hi_b] to its left.

    Returns the first and last row, the first and last column, the rectangle's centre, and how far from it, along and
    across, the centre of a tile may lie that touches it.
    """
    mid_a, mid_b = 0.5 * (lo_a + hi_a), 0.5 * (lo_b + hi_b)
    half_a, half_b = 0.5 * (hi_a - lo_a), 0.5 * (hi_b - lo_b)
    cx = ox + mid_a * ex - mid_b * ey
    cy = oy + mid_a * ey + mid_b * ex
    margin_x = half_a * abs(ex) + half_b * abs(ey)
    margin_y = half_a * abs(ey) + half_b * abs(ex)
    rows = heads.shape[0] // columns
    r0 = max(0, int(np.floor(cy - margin_y)) >> TILE_SHIFT)
    r1 = min(rows - 1, int(np.floor(cy + margin_y + 1.0)) >> TILE_SHIFT)
    c0 = max(0, int(np.floor(cx - margin_x)) >> TILE_SHIFT)
    c1 = min(columns - 1, int(np.floor(cx + margin_x + 1.0)) >> TILE_SHIFT)
    beside = 0.5 * (1 << TILE_SHIFT) * (abs(ex) + abs(ey))
    return r0, r1, c0, c1, cx, cy, half_a + beside, half_b + beside
