"""Small pieces of an update between the large kernels: which stations, how long to look back, what an end does."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, fastmath=True)
def prepare_stations(  # type: ignore[no-untyped-def]
    dt_ms, p, s_px, vn, vn_past, past, sn, lo_px, hi_px, width, height,
    acceleration_px, travel_px, window_min_ms, window_max_ms, band_px, band_sigmas, band_max_px,
    active, accel, window, band,
):  # fmt: skip
    """Decide which stations are looked at, for how long and how far.

    p: (m, 2) places; vn_past: (4, m) normal rates of the last updates, ``past`` of them filled, the oldest first;
    (lo_px, hi_px): material extent. Out, (m,): active uint8, accel px/ms^2 along the normal, window ms, band px.
    """
    m = s_px.shape[0]
    raw = np.zeros(m)
    if past >= 4:
        for i in range(m):
            raw[i] = (vn[i] - vn_past[0, i]) / (4.0 * dt_ms)
    for i in range(m):
        a1, a2 = max(i - 1, 0), max(i - 2, 0)
        b1, b2 = min(i + 1, m - 1), min(i + 2, m - 1)
        accel[i] = 0.4 * raw[i] + 0.2 * (raw[a1] + raw[b1]) + 0.1 * (raw[a2] + raw[b2])
        longest = np.sqrt(acceleration_px / max(abs(accel[i]), 1e-3))
        longest = min(longest, travel_px / max(abs(vn[i]), 1e-3))
        window[i] = min(max(longest, 1.5 * window_min_ms), window_max_ms)
        band[i] = min(max(band_px + band_sigmas * sn[i], band_px), band_max_px)
        inside = -2.0 < p[i, 0] < width + 2.0 and -2.0 < p[i, 1] < height + 2.0
        active[i] = 1 if inside and lo_px < s_px[i] < hi_px else 0


@numba.njit(cache=True, nogil=True)
def leave_out(p, region, active):  # type: ignore[no-untyped-def]
    """Do not look at stations in a region. p: (m, 2) places; region: (H, W) uint8, not 0 there; active: (m,) uint8."""
    height, width = region.shape
    for i in range(p.shape[0]):
        if active[i]:
            x = min(max(int(p[i, 0] + 0.5), 0), width - 1)
            y = min(max(int(p[i, 1] + 0.5), 0), height - 1)
            if region[y, x]:
                active[i] = 0


@numba.njit(cache=True, nogil=True, fastmath=True)
def remember_rates(vn, vn_past, past):  # type: ignore[no-untyped-def]
    """Append vn (m,) to the last four in vn_past (4, m). Returns how many are filled."""
    if past < 4:
        vn_past[past] = vn
        return past + 1
    for k in range(3):
        vn_past[k] = vn_past[k + 1]
    vn_past[3] = vn
    return 4


@numba.njit(cache=True, nogil=True, fastmath=True)
def fast_speed(vn, vt):  # type: ignore[no-untyped-def]
    """90th percentile of the stations' speed."""
    m = vn.shape[0]
    speed = np.sort(np.sqrt(vn * vn + vt * vt))
    return speed[min(m - 1, int(0.9 * m))]


@numba.njit(cache=True, nogil=True, fastmath=True)
def fit_summary(good, nis, offset):  # type: ignore[no-untyped-def]
    """(stations seen, their median squared innovation, their root mean square offset px)."""
    m = good.shape[0]
    values = np.empty(m)
    count = 0
    square = 0.0
    for i in range(m):
        if good[i]:
            values[count] = nis[i]
            square += offset[i] ** 2
            count += 1
    if count == 0:
        return 0, 0.0, 0.0
    ordered = np.sort(values[:count])
    return count, ordered[count // 2], np.sqrt(square / count)


@numba.njit(cache=True, nogil=True, fastmath=True)
def largest_innovation(cov, h, z, w, first, rows):  # type: ignore[no-untyped-def]
    """Largest squared innovation over its variance among measurement rows ``first`` to ``rows``."""
    size = cov.shape[0]
    largest = 0.0
    for r in range(first, rows):
        variance = 1.0 / w[r]
        for i in range(size):
            if h[r, i] != 0.0:
                inner = 0.0
                for j in range(size):
                    inner += cov[i, j] * h[r, j]
                variance += h[r, i] * inner
        largest = max(largest, z[r] * z[r] / variance)
    return largest


@numba.njit(cache=True, nogil=True, fastmath=True)
def place_end(  # type: ignore[no-untyped-def]
    s_px, s_lo_px, ds_px, stride, points, theta, jacobian, basis, x, place, direction, velocity, jac, angle_row
):
    """An end at material coordinate ``s_px``, straight beyond the samples. Returns its turning rate in rad/ms.

    Out: place (2,), direction (2,) unit tangent, velocity (2,) px/ms, jac (2, n), angle_row (K,).
    """
    samples = points.shape[0]
    m, _, n = jacobian.shape
    u = (s_px - s_lo_px) / ds_px
    i = min(max(int(np.floor(u)), 0), samples - 2)
    f = u - i
    g = min(max(f, 0.0), 1.0)
    angle = theta[i] + g * (theta[i + 1] - theta[i])
    direction[0] = np.cos(angle)
    direction[1] = np.sin(angle)
    v = min(max(u / stride, 0.0), m - 1.0)
    a = min(int(v), m - 2)
    b = v - a
    for c in range(2):
        place[c] = points[i, c] + f * (points[i + 1, c] - points[i, c])
        velocity[c] = 0.0
        for k in range(n):
            value = (1.0 - b) * jacobian[a, c, k] + b * jacobian[a + 1, c, k]
            jac[c, k] = value
            velocity[c] += value * x[n + k]
    nearest = min(max(int(u + 0.5), 0), samples - 1)
    omega = 0.0
    for k in range(n - 2):
        angle_row[k] = basis[nearest, k]
        omega += basis[nearest, k] * x[n + 2 + k]
    return omega


@numba.njit(cache=True, nogil=True, fastmath=True)
def publish_nodes(  # type: ignore[no-untyped-def]
    lo_px, hi_px, s_lo_px, ds_px, stride, points, theta, jacobian, cov, x, support, visible_support, share, bias_px,
    bias_end_px, bias_end_reach_px, bias_tangent_px, width, height, nodes, velocity, covariance, visible,
):  # fmt: skip
    """Equidistant nodes from ``lo_px`` to ``hi_px`` with rates (px/s), covariance (xx, xy, yy) and visibility.

    share: of the filter's variance that is published; bias_px, bias_tangent_px: what all nodes may have in common,
    normal and along; bias_end_px: what the curve may be off across at its ends, where nothing beyond holds it, fading
    over bias_end_reach_px inwards.
    nodes, velocity: (M, 2), covariance: (M, 3), visible: (M,) uint8. Returns the largest speed in px/s.
    """
    count = nodes.shape[0]
    samples = points.shape[0]
    m, _, n = jacobian.shape
    station = np.empty((m, 5))
    row = np.empty((2, n))
    for i in range(m):
        for c in range(2):
            rate = 0.0
            for k in range(n):
                rate += jacobian[i, c, k] * x[n + k]
                inner = 0.0
                for j in range(n):
                    inner += cov[k, j] * jacobian[i, c, j]
                row[c, k] = inner
            station[i, c] = rate
        xx = 0.0
        xy = 0.0
        yy = 0.0
        for k in range(n):
            xx += row[0, k] * jacobian[i, 0, k]
            xy += row[0, k] * jacobian[i, 1, k]
            yy += row[1, k] * jacobian[i, 1, k]
        station[i, 2] = xx
        station[i, 3] = xy
        station[i, 4] = yy
    fastest = 0.0
    for q in range(count):
        s = lo_px + (hi_px - lo_px) * q / (count - 1)
        u = (s - s_lo_px) / ds_px
        i = min(max(int(np.floor(u)), 0), samples - 2)
        f = u - i
        for c in range(2):
            nodes[q, c] = points[i, c] + f * (points[i + 1, c] - points[i, c])
        v = min(max(u / stride, 0.0), m - 1.0)
        a = min(int(v), m - 2)
        b = v - a
        for c in range(2):
            velocity[q, c] = 1000.0 * ((1.0 - b) * station[a, c] + b * station[a + 1, c])
        for c in range(3):
            covariance[q, c] = share * ((1.0 - b) * station[a, 2 + c] + b * station[a + 1, 2 + c])
        g = min(max(f, 0.0), 1.0)
        angle = theta[i] + g * (theta[i + 1] - theta[i])
        tx, ty = np.cos(angle), np.sin(angle)
        inward = min(s - lo_px, hi_px - s)
        across = bias_px**2 + (bias_end_px * np.exp(-inward / bias_end_reach_px)) ** 2
        along = bias_tangent_px**2 - across
        covariance[q, 0] += across + along * tx * tx
        covariance[q, 1] += along * tx * ty
        covariance[q, 2] += across + along * ty * ty
        seen = (1.0 - b) * support[a] + b * support[a + 1] > visible_support
        inside = 0.0 <= nodes[q, 0] < width and 0.0 <= nodes[q, 1] < height
        visible[q] = 1 if seen and inside else 0
        fastest = max(fastest, velocity[q, 0] ** 2 + velocity[q, 1] ** 2)
    return np.sqrt(fastest)
