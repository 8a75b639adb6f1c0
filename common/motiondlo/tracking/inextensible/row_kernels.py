"""Rows of measurements of the filter, written into preallocated arrays (see :mod:`filter_kernels` for the legend)."""

from __future__ import annotations

import numba
import numpy as np

from motiondlo.tracking.inextensible.filter_kernels import STRETCH
from motiondlo.tracking.inextensible.step_kernels import remember_rates


@numba.njit(cache=True, nogil=True, fastmath=True)
def station_rows(  # type: ignore[no-untyped-def]
    n, dt_ms, h_normal, h_stretch, vn, sn, offset, sigma, age, count, quality, window_ms, active, alive,
    sigma_floor, sigma_age, age_share, quality_min, events_min, rest_sigma, rest_velocity,
    h, z, w, robust, good, covered, nis,
):  # fmt: skip
    """Write the rows of all stations; returns (rows, stations seen, stations that could be seen).

    A station with a matched profile binds its normal coordinate at the mean age of its events; one that is visible and
    silent binds its normal rate to zero. Out, (m,): good and covered uint8, nis squared innovation over its variance.
    """
    m = h_normal.shape[0]
    size = h.shape[1]
    rows = 0
    seen = 0
    could = 0
    # Where nothing was seen before, a handful of stray events is no match: ask for a share of what others have.
    total = 0.0
    matched = 0
    for i in range(m):
        if active[i] and sigma[i] > 0.0 and alive[i] > 0.5:
            total += count[i]
            matched += 1
    new_min = max(events_min, 0.3 * total / max(matched, 1))
    for i in range(m):
        good[i] = 0
        covered[i] = 0
        nis[i] = 0.0
        if not active[i]:
            continue
        could += 1
        fewest = events_min if alive[i] > 0.3 else new_min
        if sigma[i] > 0.0 and count[i] >= fewest and quality[i] > quality_min:
            r = sigma_floor**2 + 4.0 * sigma[i] ** 2 + (sigma_age * age[i] ** 2) ** 2
            r *= max(1.0, window_ms[i] / dt_ms)
            for k in range(size):
                h[rows, k] = 0.0
            for k in range(n):
                h[rows, k] = h_normal[i, k]
                h[rows, n + k] = -age[i] * age_share * h_normal[i, k]
            h[rows, 2 * n + STRETCH] = h_stretch[i]
            z[rows] = offset[i]
            w[rows] = 1.0 / r
            robust[rows] = 1
            good[i] = 1
            nis[i] = offset[i] ** 2 / (r + sn[i] ** 2)
            rows += 1
            seen += 1
    for i in range(m):
        if not active[i] or good[i] or count[i] >= events_min // 2:
            continue
        # Silent between two parts that move: covered, not at rest.
        a = i - 1
        while a >= 0 and not good[a]:
            a -= 1
        b = i + 1
        while b < m and not good[b]:
            b += 1
        moves = a >= 0 and b < m
        if moves:
            moves = abs(vn[a]) > rest_velocity or abs(offset[a]) > 1.0
            moves = moves and (abs(vn[b]) > rest_velocity or abs(offset[b]) > 1.0)
        if moves:
            covered[i] = 1
        elif abs(vn[i]) < rest_velocity and alive[i] > 0.5:
            for k in range(size):
                h[rows, k] = 0.0
            for k in range(n):
                h[rows, n + k] = h_normal[i, k]
            z[rows] = -vn[i]
            w[rows] = dt_ms / rest_sigma**2
            robust[rows] = 0
            rows += 1
    return rows, seen, could


@numba.njit(cache=True, nogil=True, fastmath=True)
def end_row(  # type: ignore[no-untyped-def]
    row, jacobian, angle_row, axis_x, axis_y, turn, place_share, rate_share, constant, constant_slope, h
):
    """Write row ``row`` of h (R, N): what an end says of its place along an axis, or of its angle.

    jacobian: (2, n) of its place, angle_row: (K,) of its angle; ``turn`` is the share of the angle, (axis_x, axis_y)
    that of the place; place_share, rate_share: how the measurement depends on the pose and on its rates. ``constant``:
    which constant of the state it depends on as well, with ``constant_slope``; -1 for none.
    """
    n = jacobian.shape[1]
    for k in range(n):
        value = axis_x * jacobian[0, k] + axis_y * jacobian[1, k]
        if k >= 2:
            value += turn * angle_row[k - 2]
        h[row, k] = place_share * value
        h[row, n + k] = rate_share * value
    for k in range(2 * n, h.shape[1]):
        h[row, k] = 0.0
    if constant >= 0:
        h[row, 2 * n + constant] = constant_slope


@numba.njit(cache=True, nogil=True, fastmath=True)
def remember_bend(n, x, share, alive, memory):  # type: ignore[no-untyped-def]
    """Let the remembered bend follow the estimate, where the DLO is seen: what is covered keeps the bend it had."""
    m = alive.shape[0]
    for k in range(3, n - 1):
        seen = alive[min(m - 1, int((k - 2) / (n - 3) * (m - 1) + 0.5))]
        memory[k] += share * seen * (x[k - 1] - 2.0 * x[k] + x[k + 1] - memory[k])


@numba.njit(cache=True, nogil=True, fastmath=True)
def update_support(  # type: ignore[no-untyped-def]
    dt_ms, active, good, covered, count, vn, events_min, alive, support, absent_ms, seen_ms, vn_past, past
):
    """Follow what is known of every station; all (m,). Returns how many rates are remembered now.

    alive 0..1: it is known to be in view; support 0..1: it was seen lately, or rests where it was seen; absent_ms: how
    long it should have been seen, moving in view, and was not; seen_ms: how long it was measured. vn_past: (4, m) the
    last normal rates, ``past`` of them filled, to which vn is appended.
    """
    total = 0.0
    seen = 0
    for i in range(alive.shape[0]):
        if good[i]:
            total += count[i]
            seen += 1
    fewest = max(events_min, 0.3 * total / max(seen, 1))
    for i in range(alive.shape[0]):
        if not active[i]:
            alive[i] *= np.exp(-dt_ms / 5.0)
            support[i] *= np.exp(-dt_ms / 5.0)
            absent_ms[i] = 0.0
        elif good[i]:
            alive[i] = min(1.0, alive[i] + 0.1 * dt_ms)
            support[i] = min(1.0, support[i] + 0.2 * dt_ms)
            absent_ms[i] = max(0.0, absent_ms[i] - 3.0 * dt_ms)
        elif covered[i] or abs(vn[i]) > 0.7:
            if count[i] < fewest:
                alive[i] = max(0.0, alive[i] - 0.1 * dt_ms)
                absent_ms[i] += dt_ms
            support[i] = max(0.0, support[i] - 0.05 * dt_ms)
        if good[i]:
            seen_ms[i] += dt_ms
    return remember_rates(vn, vn_past, past)


@numba.njit(cache=True, nogil=True, fastmath=True)
def find_end(  # type: ignore[no-untyped-def]
    direction, limit_ms, margin_px, width, height, p, s_px, good, absent_ms, out
):
    """Where a DLO of unknown extent ends in the image. direction: 1 towards larger s, -1 towards smaller.

    An end is found when beyond the outermost station seen at least two stations lie well inside the image and have been
    absent for ``limit_ms``. out: [s of the outermost station seen, s of the next]. Returns 1 if found, else 0.
    """
    m = p.shape[0]
    i = 0 if direction > 0 else m - 1
    while 0 <= i < m and not good[i]:
        i += direction
    # From the part that is surely there outwards: the first pair of stations that should be seen and are not, with
    # nothing but such stations (or the image border) behind it.
    while 0 <= i + 2 * direction < m:
        k = i + direction
        if absent_ms[k] >= limit_ms and absent_ms[k + direction] >= limit_ms:
            break
        i = k
    else:
        return 0
    out[0] = s_px[i]
    out[1] = s_px[i + direction]
    k = i + direction
    absent = 0
    present = 0
    while 0 <= k < m:
        inside = margin_px < p[k, 0] < width - margin_px and margin_px < p[k, 1] < height - margin_px
        if not inside:
            break
        if absent_ms[k] >= 0.5 * limit_ms:
            absent += 1
        else:
            present += 1
        k += direction
    return 1 if absent >= 2 and absent > 3 * present else 0
