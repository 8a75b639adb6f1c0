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


@numba.njit(cache=True, nogil=True)
def pair_strength(saturated: FloatArray, half: float, out: FloatArray) -> None:
    """Strength of the pairs of edges ``half`` columns to both sides of candidates around the middle column.

    saturated: (K, V) float64, 0..1. out: (K, 2 R + 1) float64 receives, for candidates -R to R, the mean of both edges
    (bilinear) plus the weaker one, less a little for the way from the middle: ties go to the curve that came in.
    """
    rows, columns = saturated.shape
    reach = (out.shape[1] - 1) // 2
    middle = columns // 2
    for c in range(2 * reach + 1):
        at_left = middle + (c - reach) - half
        at_right = middle + (c - reach) + half
        low_left = min(max(int(np.floor(at_left)), 0), columns - 2)
        low_right = min(max(int(np.floor(at_right)), 0), columns - 2)
        part_left = min(max(at_left - low_left, 0.0), 1.0)
        part_right = min(max(at_right - low_right, 0.0), 1.0)
        price = 0.02 * abs(c - reach) / max(reach, 1)
        for k in range(rows):
            left = saturated[k, low_left] * (1.0 - part_left) + saturated[k, low_left + 1] * part_left
            right = saturated[k, low_right] * (1.0 - part_right) + saturated[k, low_right + 1] * part_right
            out[k, c] = 0.5 * (left + right) + min(left, right) - price
