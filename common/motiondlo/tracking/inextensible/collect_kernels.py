"""The events of a station, found in the buckets and moved with the curve to the instant of the update.

The legend of symbols is in :mod:`motiondlo.tracking.inextensible.observe_kernels`.
"""

from __future__ import annotations

import numba
import numpy as np

from motiondlo.events.bucket_kernels import (
    COORDINATE_MASK,
    TIME_SHIFT,
    X_SHIFT,
    Y_MASK,
    Y_SHIFT,
    tiles_around,
)

BLOCK = 16
"""Events that are judged together; a ring holds a multiple of it."""


@numba.njit(cache=True, nogil=True, fastmath=True)
def collect_station(  # type: ignore[no-untyped-def]
    rings, heads, columns, t_us, px, py, theta, kappa, vn, vt, omega, window_ms, reach_px, half_px, latency_ms,
    d_out, age_out, sign_out, word_out,
):  # fmt: skip
    """Collect the events of one station, moved to now. Returns their number (at most the outputs' length).

    rings, heads, columns: the event buckets. reach_px: largest |d| after motion; half_px: half the station's length
    along t after motion, so that an event belongs to one station only.
    d_out, age_out: (cap,) float32; sign_out: (cap,) uint8 row of the gradient sign; word_out: (cap,) int64 the event.
    """
    tx, ty = np.cos(theta), np.sin(theta)
    nx, ny = -ty, tx
    oldest = window_ms + latency_ms
    slack = abs(omega) * half_px * oldest + 0.5 * abs(kappa) * half_px * half_px
    travel_n, travel_t = vn * oldest, vt * window_ms
    lo_n = -reach_px - max(travel_n, 0.0) - slack
    hi_n = reach_px - min(travel_n, 0.0) + slack
    lo_t = -half_px - max(travel_t, 0.0)
    hi_t = half_px - min(travel_t, 0.0)
    r0, r1, c0, c1, cx, cy, far_t, far_n = tiles_around(px, py, tx, ty, lo_t, hi_t, lo_n, hi_n, heads, columns)
    size = rings.shape[1]
    floor = np.int64(t_us - window_ms * 1000.0 + 1.0) << TIME_SHIFT
    half_kappa = 0.5 * kappa
    capacity = d_out.shape[0]
    inside = np.empty(BLOCK, np.uint8)
    count = 0
    for r in range(r0, r1 + 1):
        for c in range(c0, c1 + 1):
            ux = 16.0 * c + 7.5 - cx
            uy = 16.0 * r + 7.5 - cy
            if abs(ux * nx + uy * ny) > far_n or abs(ux * tx + uy * ty) > far_t:
                continue
            tile = r * columns + c
            newest = heads[tile] - 1
            oldest_kept = max(newest + 1 - size, 0)
            # The newest first, block by block: a block is judged as a whole, without a branch for each of its events.
            while newest >= oldest_kept and rings[tile, newest & (size - 1)] >= floor and count < capacity:
                lowest = max(newest & ~(BLOCK - 1), oldest_kept)
                first = newest & (size - 1) & ~(BLOCK - 1)
                block = rings[tile, first : first + BLOCK]
                for j in range(BLOCK):
                    word = block[j]
                    age = np.int32(t_us - (word >> TIME_SHIFT)) * 1e-3
                    rx = np.int32((word >> X_SHIFT) & COORDINATE_MASK) - px
                    ry = np.int32((word >> Y_SHIFT) & Y_MASK) - py
                    tau = rx * tx + ry * ty + vt * age
                    e = rx * nx + ry * ny + (vn + omega * tau) * (age + latency_ms) - half_kappa * tau * tau
                    inside[j] = (abs(tau) <= half_px) & (abs(e) <= reach_px) & (word >= floor)
                for k in range(newest, lowest - 1, -1):
                    j = k & (BLOCK - 1)
                    word_out[count] = block[j]
                    count += inside[j]
                    if count == capacity:
                        break
                newest = lowest - 1
    flip = 0 if vn >= 0.0 else 1
    for k in range(count):
        word = word_out[k]
        age = np.int32(t_us - (word >> TIME_SHIFT)) * 1e-3
        rx = np.int32((word >> X_SHIFT) & COORDINATE_MASK) - px
        ry = np.int32((word >> Y_SHIFT) & Y_MASK) - py
        tau = rx * tx + ry * ty + vt * age
        d_out[k] = rx * nx + ry * ny + (vn + omega * tau) * (age + latency_ms) - half_kappa * tau * tau
        age_out[k] = age
        sign_out[k] = (word & 1) ^ flip
    return count
