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
def file_events(packed: Int64Array, width: int, height: int, rings: Int64Array, heads: Int64Array, columns: int) -> int:
    """File events; returns how many lay outside the sensor.

    packed: (N, 2), see :func:`motiondlo.events.joining.event_words`.
    """
    mask = rings.shape[1] - 1
    outside = 0
    for i in range(len(packed)):
        place = packed[i, 1]
        x = place & 0xFFFF
        y = (place >> 16) & 0xFFFF
        if x < width and y < height:
            p = (place >> 32) & 1
            # Unsigned, so that no index is tested for being negative.
            tile = np.uintp((y >> TILE_SHIFT) * columns + (x >> TILE_SHIFT))
            head = heads[tile]
            rings[tile, np.uintp(head & mask)] = (packed[i, 0] << TIME_SHIFT) | (y << Y_SHIFT) | (x << X_SHIFT) | p
            heads[tile] = head + 1
        else:
            outside += 1
    return outside


@numba.njit(cache=True, nogil=True)
def note_times(rings, heads, columns, last_us, since_us, x0, y0, x1, y1):  # type: ignore[no-untyped-def]
    """Note the time of the last event per pixel, of events after since_us, in the tiles from (x0, y0) to (x1, y1) px.

    last_us: (2, H, W) int64, per polarity.
    """
    size = rings.shape[1]
    rows = heads.shape[0] // columns
    floor = np.int64(since_us) << TIME_SHIFT
    for r in range(max(int(y0) >> TILE_SHIFT, 0), min(int(y1) >> TILE_SHIFT, rows - 1) + 1):
        for c in range(max(int(x0) >> TILE_SHIFT, 0), min(int(x1) >> TILE_SHIFT, columns - 1) + 1):
            tile = r * columns + c
            head = heads[tile]
            for k in range(head - 1, max(head - size, 0) - 1, -1):
                word = rings[tile, k & (size - 1)]
                if word < floor:
                    break
                x = (word >> X_SHIFT) & COORDINATE_MASK
                y = (word >> Y_SHIFT) & Y_MASK
                last_us[word & 1, y, x] = max(last_us[word & 1, y, x], word >> TIME_SHIFT)


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
