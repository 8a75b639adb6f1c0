"""Distances between many polylines at once, compiled.

Legend: R rows (one polyline pair each), P points a row, C nodes of the curve a row. A "place" of a curve is a segment
index and a fraction 0..1 within it.
"""

from __future__ import annotations

import numba
import numpy as np

_TINY_PX2 = 1e-18


@numba.njit(cache=True, nogil=True)
def nearest_places(  # type: ignore[no-untyped-def]
    points, curves, distance, normal_distance, segment, fraction, nearest_node
):
    """Nearest place of each row's curve for each of the row's points.

    points: (R, P, 2), curves: (R, C, 2) float64, C >= 2. Filled, all (R, P): ``distance`` to the curve,
    ``normal_distance`` to the line through the nearest segment, ``segment``, ``fraction`` of the nearest place, and
    ``nearest_node`` of the curve.
    """
    rows, count = points.shape[0], points.shape[1]
    last = curves.shape[1] - 1
    for r in range(rows):
        for p in range(count):
            x, y = points[r, p, 0], points[r, p, 1]
            best2, best_node2 = np.inf, np.inf
            best_k, best_u, best_cross, best_node = 0, 0.0, 0.0, 0
            for k in range(last):
                ax, ay = curves[r, k, 0], curves[r, k, 1]
                dx, dy = curves[r, k + 1, 0] - ax, curves[r, k + 1, 1] - ay
                rx, ry = x - ax, y - ay
                node2 = rx * rx + ry * ry
                if node2 < best_node2:
                    best_node2, best_node = node2, k
                length2 = max(dx * dx + dy * dy, _TINY_PX2)
                u = min(max((rx * dx + ry * dy) / length2, 0.0), 1.0)
                gx, gy = rx - u * dx, ry - u * dy
                gap2 = gx * gx + gy * gy
                if gap2 < best2:
                    best2, best_k, best_u = gap2, k, u
                    best_cross = abs(dx * ry - dy * rx) / np.sqrt(length2)
            rx, ry = x - curves[r, last, 0], y - curves[r, last, 1]
            if rx * rx + ry * ry < best_node2:
                best_node = last
            distance[r, p] = np.sqrt(best2)
            normal_distance[r, p] = best_cross
            segment[r, p] = best_k
            fraction[r, p] = best_u
            nearest_node[r, p] = best_node


@numba.njit(cache=True, nogil=True)
def _walk(curve, first, last, s_from, s_to, out, s):  # type: ignore[no-untyped-def]
    """Fill ``out`` (M, 2) from arc length ``s_from`` to ``s_to`` of curve[first..last]; ``s`` (N,) is scratch."""
    s[first] = 0.0
    for k in range(first, last):
        s[k + 1] = s[k] + np.hypot(curve[k + 1, 0] - curve[k, 0], curve[k + 1, 1] - curve[k, 1])
    k = first
    count = out.shape[0]
    for i in range(count):
        target = s_from + (s_to - s_from) * i / (count - 1)
        while k < last - 1 and s[k + 1] < target:
            k += 1
        length = s[k + 1] - s[k]
        u = min(max((target - s[k]) / length, 0.0), 1.0) if length > 0.0 else 0.0
        out[i, 0] = curve[k, 0] + u * (curve[k + 1, 0] - curve[k, 0])
        out[i, 1] = curve[k, 1] + u * (curve[k + 1, 1] - curve[k, 1])


@numba.njit(cache=True, nogil=True)
def _length(curve, first, last):  # type: ignore[no-untyped-def]
    total = 0.0
    for k in range(first, last):
        total += np.hypot(curve[k + 1, 0] - curve[k, 0], curve[k + 1, 1] - curve[k, 1])
    return total


@numba.njit(cache=True, nogil=True)
def paired_distance(estimate, truth, first, last, cut_first_s, cut_last_s, out):  # type: ignore[no-untyped-def]
    """Mean distance of M equidistant points along the estimate and along the true extent (paired error).

    estimate: (R, M, 2), truth: (R, N, 2); ``first``, ``last`` (R,): the extent's nodes (last <= first: NaN);
    ``cut_first_s``, ``cut_last_s`` (R,): arc lengths of the estimate at which it is cut, NaN where it is not.
    ``out`` (R,) is filled.
    """
    rows, count = estimate.shape[0], estimate.shape[1]
    a = np.empty((count, 2))
    b = np.empty((count, 2))
    s_estimate = np.empty(count)
    s_truth = np.empty(truth.shape[1])
    for r in range(rows):
        if last[r] <= first[r]:
            out[r] = np.nan
            continue
        s0 = 0.0 if np.isnan(cut_first_s[r]) else cut_first_s[r]
        s1 = _length(estimate[r], 0, count - 1) if np.isnan(cut_last_s[r]) else cut_last_s[r]
        # A cut removes what is outside; what remains keeps the direction of the estimate.
        _walk(estimate[r], 0, count - 1, min(s0, s1), max(s0, s1), a, s_estimate)
        _walk(truth[r], first[r], last[r], 0.0, _length(truth[r], first[r], last[r]), b, s_truth)
        total = 0.0
        for i in range(count):
            total += np.hypot(a[i, 0] - b[i, 0], a[i, 1] - b[i, 1])
        out[r] = total / count


@numba.njit(cache=True, nogil=True)
def paired_slip(estimate, truth, first, last, cut_first_s, cut_last_s, sigma, out):  # type: ignore[no-untyped-def]
    """Mean of (difference along the curve / sigma) squared over the pairs of :func:`paired_distance`.

    sigma: (R, M) along the curve at the estimate's equidistant nodes; other arguments as there. NaN where a row has no
    extent, or some sigma is not a positive number.
    """
    rows, count = estimate.shape[0], estimate.shape[1]
    a = np.empty((count, 2))
    b = np.empty((count, 2))
    s_estimate = np.empty(count)
    s_truth = np.empty(truth.shape[1])
    for r in range(rows):
        out[r] = np.nan
        length = _length(estimate[r], 0, count - 1)
        if last[r] <= first[r] or length <= 0.0:
            continue
        s0 = 0.0 if np.isnan(cut_first_s[r]) else cut_first_s[r]
        s1 = length if np.isnan(cut_last_s[r]) else cut_last_s[r]
        low, high = min(s0, s1), max(s0, s1)
        _walk(estimate[r], 0, count - 1, low, high, a, s_estimate)
        _walk(truth[r], first[r], last[r], 0.0, _length(truth[r], first[r], last[r]), b, s_truth)
        total = 0.0
        for i in range(count):
            before, after = max(i - 1, 0), min(i + 1, count - 1)
            tx, ty = b[after, 0] - b[before, 0], b[after, 1] - b[before, 1]
            norm = max(np.hypot(tx, ty), 1e-9)
            along = ((a[i, 0] - b[i, 0]) * tx + (a[i, 1] - b[i, 1]) * ty) / norm
            at = (low + (high - low) * i / (count - 1)) / length * (count - 1)
            k = min(max(int(at), 0), count - 2)
            u = min(max(at - k, 0.0), 1.0)
            sd = sigma[r, k] + u * (sigma[r, k + 1] - sigma[r, k])
            total += (along / sd) ** 2 if sd > 0.0 else np.nan
        out[r] = total / count


@numba.njit(cache=True, nogil=True)
def shifted_normal_distance(points, used, t_us, times_us, truth, shifts_us, segment, out):  # type: ignore[no-untyped-def]
    """Mean normal distance of the points to the truth shifted in time, for each shift.

    points: (R, P, 2), used: (R, P) bool, t_us: (R,), times_us: (T,), truth: (T, N, 2), shifts_us: (S,) growing in
    magnitude by small steps from about 0; segment: (R, P) nearest segments at shift 0, overwritten: each shift searches
    near the previous one's, which keeps to the same strand at self-crossings. ``out`` (S,): mean over the rows of the
    mean over their used points.
    """
    last_time = len(times_us) - 2
    last_segment = truth.shape[1] - 2
    for i in range(len(shifts_us)):
        total = 0.0
        rows_used = 0
        for r in range(points.shape[0]):
            t = t_us[r] + shifts_us[i]
            j = min(max(np.searchsorted(times_us, t) - 1, 0), last_time)
            w = min(max((t - times_us[j]) / (times_us[j + 1] - times_us[j]), 0.0), 1.0)
            now, after = truth[j], truth[j + 1]
            row_total = 0.0
            row_count = 0
            for p in range(points.shape[1]):
                if not used[r, p]:
                    continue
                x, y = points[r, p, 0], points[r, p, 1]
                best2, best_k, cross = np.inf, segment[r, p], 0.0
                centre = -1
                while centre != best_k:
                    centre = best_k
                    for k in range(max(centre - 2, 0), min(centre + 2, last_segment) + 1):
                        ax = now[k, 0] + w * (after[k, 0] - now[k, 0])
                        ay = now[k, 1] + w * (after[k, 1] - now[k, 1])
                        dx = now[k + 1, 0] + w * (after[k + 1, 0] - now[k + 1, 0]) - ax
                        dy = now[k + 1, 1] + w * (after[k + 1, 1] - now[k + 1, 1]) - ay
                        rx, ry = x - ax, y - ay
                        length2 = max(dx * dx + dy * dy, _TINY_PX2)
                        u = min(max((rx * dx + ry * dy) / length2, 0.0), 1.0)
                        gap2 = (rx - u * dx) ** 2 + (ry - u * dy) ** 2
                        if gap2 < best2:
                            best2, best_k = gap2, k
                            cross = abs(dx * ry - dy * rx) / np.sqrt(length2)
                segment[r, p] = best_k
                row_total += cross
                row_count += 1
            if row_count:
                total += row_total / row_count
                rows_used += 1
        out[i] = total / rows_used if rows_used else np.nan
