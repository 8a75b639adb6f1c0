"""Kernels that read the time surfaces inside the region of interest, on a coarse grid of cells."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt


@numba.njit(cache=True, nogil=True)
def newest_age_of_cells(
    last_us: npt.NDArray[np.int64],
    inside: npt.NDArray[np.uint8],
    x0_px: int,
    y0_px: int,
    cell_px: int,
    now_us: int,
    oldest_age_us: int,
    age_us: npt.NDArray[np.int32],
    age_counts: npt.NDArray[np.int64],
) -> int:
    """Age of the newest event of each cell, both polarities collapsed (the maximum of the two recentness values).

    last_us: (2, H, W). inside: (h, w), 0 where a cell is not of interest. Cell (0, 0) starts at pixel (x0_px, y0_px).
    age_us: (h, w) int32, written: ``oldest_age_us`` where nothing fired since. age_counts: (bins,), written: histogram
    of the ages below ``oldest_age_us``. Returns the number of cells counted there.
    """
    polarities, height, width = last_us.shape
    rows, columns = inside.shape
    bins = age_counts.shape[0]
    for b in range(bins):
        age_counts[b] = 0
    active = 0
    for r in range(rows):
        y_start = y0_px + r * cell_px
        y_end = min(y_start + cell_px, height)
        for c in range(columns):
            age_us[r, c] = oldest_age_us
            if inside[r, c] == 0:
                continue
            x_start = x0_px + c * cell_px
            x_end = min(x_start + cell_px, width)
            newest = now_us - oldest_age_us
            for q in range(polarities):
                for y in range(y_start, y_end):
                    for x in range(x_start, x_end):
                        newest = max(newest, last_us[q, y, x])
            age = max(now_us - newest, 0)
            if age < oldest_age_us:
                age_us[r, c] = age
                age_counts[age * bins // oldest_age_us] += 1
                active += 1
    return active
