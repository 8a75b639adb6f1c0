"""The kernel of the time-stamp surface.

Legend: ``packed`` (N, 2) int64 is an event array seen as words: time, and ``x | y << 16 | polarity << 32``; the bits
above are padding of unknown content. H, W: sensor height and width.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Int64Array = npt.NDArray[np.int64]

_NUMBA = {"cache": True, "nogil": True}


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
