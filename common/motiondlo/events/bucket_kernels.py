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
LARGEST_PX = 1 << 10
"""Sensors up to this height and twice this width fit a word."""


@numba.njit(cache=True, nogil=True)
def file_events(
    packed: Int64Array, last_us: Int64Array, rings: Int64Array, heads: Int64Array, columns: int
) -> int:
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
