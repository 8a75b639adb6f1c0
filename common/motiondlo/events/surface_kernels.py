"""Kernels of the time-stamp surface: write, screen, and judge hot pixels.

Legend: ``packed`` (N, 2) int64 is an event array seen as words: time, and ``x | y << 16 | polarity << 32``; the bits
above are padding of unknown content. H, W: sensor height and width.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Int64Array = npt.NDArray[np.int64]
Uint8Array = npt.NDArray[np.uint8]
Uint16Array = npt.NDArray[np.uint16]

_NUMBA = {"cache": True, "nogil": True}
_MAX_COUNT = 65535


@numba.njit(**_NUMBA)
def write_surface(packed: Int64Array, last_us: Int64Array) -> int:
    """Write every event's time into ``last_us`` (2, H, W); returns how many lay outside the sensor."""
    height, width = last_us.shape[1], last_us.shape[2]
    outside = 0
    for i in range(len(packed)):
        place = packed[i, 1]
        x = place & 0xFFFF
        y = (place >> 16) & 0xFFFF
        if x < width and y < height:
            last_us[(place >> 32) & 1, y, x] = packed[i, 0]
        else:
            outside += 1
    return outside


@numba.njit(**_NUMBA)
def screen_and_write(
    packed: Int64Array,
    last_us: Int64Array,
    hot: Uint8Array,
    counts: Uint16Array,
    seen_us: Int64Array,
    support_window_us: int,
    kept: Int64Array,
) -> tuple[int, int]:
    """Write the events that pass the hot-pixel mask and the noise filter, and copy them to ``kept``.

    hot, counts: (H, W), or (0, 0) to switch the mask off. seen_us: (H, W) time of the latest event of any polarity,
    passed or not, or (0, 0) to switch the noise filter off. kept: (N, 2).
    Returns (events kept, events outside the sensor).
    """
    height, width = last_us.shape[1], last_us.shape[2]
    masking = len(hot) > 0
    filtering = len(seen_us) > 0
    n = 0
    outside = 0
    for i in range(len(packed)):
        t_us = packed[i, 0]
        place = packed[i, 1]
        x = place & 0xFFFF
        y = (place >> 16) & 0xFFFF
        if x >= width or y >= height:
            outside += 1
            continue
        if masking:
            if counts[y, x] < _MAX_COUNT:
                counts[y, x] += 1
            if hot[y, x]:
                continue
        if filtering:
            since_us = t_us - support_window_us
            y0, y1 = max(y - 1, 0), min(y + 2, height)
            x0, x1 = max(x - 1, 0), min(x + 2, width)
            supported = False
            for v in range(y0, y1):
                for u in range(x0, x1):
                    if seen_us[v, u] >= since_us and (v != y or u != x):
                        supported = True
            seen_us[y, x] = t_us
            if not supported:
                continue
        last_us[(place >> 32) & 1, y, x] = t_us
        kept[n, 0] = t_us
        kept[n, 1] = place
        n += 1
    return n, outside


@numba.njit(**_NUMBA)
def find_hot(counts: Uint16Array, least: int, ratio: float, found: Int64Array) -> int:
    """Pixels that fired at least ``least`` times and ``ratio`` times as often as 1 + the mean of their 8 neighbours.

    counts: (H, W). found: (limit,) flat indices out. Returns how many there are, also beyond the limit.
    """
    height, width = counts.shape
    n = 0
    for y in range(height):
        for x in range(width):
            count = np.int64(counts[y, x])
            if count < least:
                continue
            total = -count
            around = -1
            for v in range(max(y - 1, 0), min(y + 2, height)):
                for u in range(max(x - 1, 0), min(x + 2, width)):
                    total += np.int64(counts[v, u])
                    around += 1
            if count * around > ratio * (around + total):
                if n < len(found):
                    found[n] = y * width + x
                n += 1
    return n
