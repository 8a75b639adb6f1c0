"""Dynamic programming over the offsets of a DLO's centre, row by row along it."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@numba.njit(cache=True, nogil=True)
def best_path(strength: FloatArray, step_cost: float, out: npt.NDArray[np.int64]) -> None:
    """Path of greatest total strength that moves by at most one column a row.

    strength: (K, C) float64. step_cost: price of a move. out: (K,) int64 receives the column of each row. Staying is
    preferred in ties, then the lower column.
    """
    rows, count = strength.shape
    total = strength[0].copy()
    fresh = np.empty(count)
    back = np.zeros((rows, count), np.int8)
    for k in range(1, rows):
        for c in range(count):
            best = total[c]
            step = 0
            if c > 0 and total[c - 1] - step_cost > best:
                best = total[c - 1] - step_cost
                step = -1
            if c + 1 < count and total[c + 1] - step_cost > best:
                best = total[c + 1] - step_cost
                step = 1
            fresh[c] = best + strength[k, c]
            back[k, c] = step
        total, fresh = fresh, total
    at = 0
    for c in range(1, count):
        if total[c] > total[at]:
            at = c
    for k in range(rows - 1, -1, -1):
        out[k] = at
        at += back[k, at]
