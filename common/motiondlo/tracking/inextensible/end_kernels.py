"""The ends of a DLO on the time surface: the rigid patch of what holds it, and the event profile of a free tip.

Legend: patch frame: ``a`` along the outward direction ``e`` at the end (away from the DLO), ``b`` across; a template is
the density of events in that frame, its ``log_template`` the log-likelihood ratio against a uniform density.
Tip profile: rate of events along the outward tangent, one bin a pixel, the tip at the middle.
"""

from __future__ import annotations

import numba
import numpy as np

from motiondlo.events.bucket_kernels import COORDINATE_MASK, TIME_SHIFT, X_SHIFT, Y_MASK, Y_SHIFT, tiles_around
from motiondlo.tracking.inextensible.rival_kernels import intensity_of, rows_around

END_NEAR = 48
"""Stations of other DLOs that are considered for one end."""

LEAST_TIP_GAIN, SURE_TIP_GAIN = 0.04, 12.0
"""Of log-likelihood, per event and in all."""


@numba.njit(cache=True, nogil=True, fastmath=True)
def shortest_window(ages, target, window_min_ms, window_ms):  # type: ignore[no-untyped-def]
    """The shortest window that holds ``target`` events. ages: (64,) counts per quarter of a ms."""
    total = 0
    for k in range(64):
        total += ages[k]
        w = 0.25 * (k + 1)
        if w >= window_ms:
            return window_ms
        if total >= target and w >= window_min_ms:
            return w
    return window_ms


@numba.njit(cache=True, nogil=True, fastmath=True)
def collect_patch(  # type: ignore[no-untyped-def]
    rings, heads, columns, t_us, ox, oy, ex, ey, vx, vy, omega, window_min_ms, window_ms, likely_ms, target,
    latency_ms, a_min, a_max, b_max, keep_out_px, a_out, b_out, age_out,
):  # fmt: skip
    """Events of the patch, moved to now, in its frame. Returns (count, mean age in ms, window in ms).

    rings, heads, columns: the event buckets. The window is the shortest up to ``window_ms`` that holds ``target``
    events; ``likely_ms`` is a guess of it that saves looking further back.
    (ox, oy): origin; (ex, ey): outward direction; (vx, vy) px/ms and omega rad/ms: the patch's motion. Within
    ``keep_out_px`` of the axis, events before the origin (a < 0) belong to the DLO and are left out.
    """
    capacity = a_out.shape[0]
    ages = np.zeros(64, np.int64)
    count = 0
    longest = min(window_ms, likely_ms)
    while True:
        oldest = longest + latency_ms
        slack = abs(omega) * (max(abs(a_min), abs(a_max)) + b_max) * oldest + 1.0
        v_a, v_b = (ex * vx + ey * vy) * oldest, (-ey * vx + ex * vy) * oldest
        lo_a, hi_a = a_min - max(v_a, 0.0) - slack, a_max - min(v_a, 0.0) + slack
        lo_b, hi_b = -b_max - max(v_b, 0.0) - slack, b_max - min(v_b, 0.0) + slack
        r0, r1, c0, c1, cx, cy, far_a, far_b = tiles_around(ox, oy, ex, ey, lo_a, hi_a, lo_b, hi_b, heads, columns)
        floor = np.int64(t_us - longest * 1000.0 + 1.0) << TIME_SHIFT
        size = rings.shape[1]
        count = 0
        ages[:] = 0
        for r in range(r0, r1 + 1):
            for c in range(c0, c1 + 1):
                ux, uy = 16.0 * c + 7.5 - cx, 16.0 * r + 7.5 - cy
                if abs(ux * ex + uy * ey) > far_a or abs(-ux * ey + uy * ex) > far_b or count == capacity:
                    continue
                tile = r * columns + c
                head = heads[tile]
                for k in range(head - 1, max(head - size, 0) - 1, -1):
                    word = rings[tile, k & (size - 1)]
                    if word < floor:
                        break
                    age = (t_us - (word >> TIME_SHIFT)) * 1e-3
                    rx = ((word >> X_SHIFT) & COORDINATE_MASK) - ox
                    ry = ((word >> Y_SHIFT) & Y_MASK) - oy
                    dx = rx + (vx - omega * ry) * (age + latency_ms)
                    dy = ry + (vy + omega * rx) * (age + latency_ms)
                    a = ex * dx + ey * dy
                    b = -ey * dx + ex * dy
                    # Written whether it lies inside or not: a branch would be predicted wrongly every other time.
                    a_out[count] = a
                    b_out[count] = b
                    age_out[count] = age
                    inside = (a >= a_min) & (a < a_max) & (abs(b) < b_max) & ((a >= 0.0) | (abs(b) >= keep_out_px))
                    ages[min(int(age * 4.0), 63)] += inside
                    count += inside
                    if count == capacity:
                        break
        if count >= target or longest >= window_ms:
            break
        longest = window_ms
    window = shortest_window(ages, target, window_min_ms, longest)
    kept = 0
    age_sum = 0.0
    for i in range(count):
        recent = age_out[i] <= window
        a_out[kept] = a_out[i]
        b_out[kept] = b_out[i]
        age_sum += age_out[i] if recent else 0.0
        kept += recent
    return kept, age_sum / max(kept, 1), window


@numba.njit(cache=True, nogil=True, fastmath=True)
def patch_score(log_template, a, b, count, step, a_min, b_max, da, db, phi):  # type: ignore[no-untyped-def]
    """Mean log-likelihood ratio an event when the patch sits at (da, db, phi) relative to the prediction."""
    rows, columns = log_template.shape
    c, s = np.cos(phi), np.sin(phi)
    total = 0.0
    n = 0
    for i in range(0, count, step):
        ai = c * a[i] + s * b[i] - da - a_min
        bi = -s * a[i] + c * b[i] - db + b_max
        ia, ib = int(ai), int(bi)
        n += 1
        if 0 <= ia < rows and 0 <= ib < columns and ai >= 0.0 and bi >= 0.0:
            total += log_template[ia, ib]
    return total / max(n, 1)


@numba.njit(cache=True, nogil=True, fastmath=True)
def straight_score(padded, cells, count, shift):  # type: ignore[no-untyped-def]
    """:func:`patch_score` without turning: the mean of ``padded`` (flat) at cells (count,) less ``shift``."""
    total = 0.0
    for i in range(count):
        total += padded[cells[i] - shift]
    return total / max(count, 1)


@numba.njit(cache=True, nogil=True, fastmath=True)
def pad_template(log_template, margin):  # type: ignore[no-untyped-def]
    """The template, flat, with ``margin`` cells of zeros around it. Returns it and the length of its rows."""
    rows, columns = log_template.shape
    stride = columns + 2 * margin
    padded = np.zeros((rows + 2 * margin, stride), np.float32)
    padded[margin : margin + rows, margin : margin + columns] = log_template
    return padded.reshape(-1), stride


@numba.njit(cache=True, nogil=True, fastmath=True)
def match_patch(log_template, a, b, count, a_min, b_max, reach, events, out):  # type: ignore[no-untyped-def]
    """Where the patch is: coarse search over +-reach px, then fine, then the angle.

    out (7,): da, db, phi, score, and the curvatures (negative second differences) of the score in a, b, phi.
    """
    step = max(1, count // events)
    rows, columns = log_template.shape
    # Whole pixels of shift move whole cells: the cells of all events are found once.
    margin = 2 * (reach + 4)
    padded, stride = pad_template(log_template, margin)
    cells = np.empty(count, np.int64)
    used = 0
    for i in range(0, count, step):
        ia = min(max(int(np.floor(a[i] - a_min)) + margin // 2, 0), rows - 1 + margin)
        ib = min(max(int(np.floor(b[i] + b_max)) + margin // 2, 0), columns - 1 + margin)
        cells[used] = (ia + margin // 2) * stride + ib + margin // 2
        used += 1
    best, ba, bb = -1e9, 0, 0
    for i in range(-reach, reach + 1, 2):
        for j in range(-reach, reach + 1, 2):
            value = straight_score(padded, cells, used, i * stride + j)
            if value > best:
                best, ba, bb = value, i, j
    ca, cb = ba, bb
    for i in range(ca - 1, ca + 2):
        for j in range(cb - 1, cb + 2):
            value = straight_score(padded, cells, used, i * stride + j)
            if value > best:
                best, ba, bb = value, i, j
    phi_step = 0.015
    best_phi = 0.0
    for k in range(-2, 3):
        value = patch_score(log_template, a, b, count, step, a_min, b_max, ba, bb, k * phi_step)
        if value > best + 1e-9:
            best, best_phi = value, k * phi_step
    out[3] = best
    for axis in range(3):
        h = phi_step if axis == 2 else 2.0
        lo = patch_score(
            log_template, a, b, count, step, a_min, b_max,
            ba - (h if axis == 0 else 0.0), bb - (h if axis == 1 else 0.0), best_phi - (h if axis == 2 else 0.0),
        )  # fmt: skip
        hi = patch_score(
            log_template, a, b, count, step, a_min, b_max,
            ba + (h if axis == 0 else 0.0), bb + (h if axis == 1 else 0.0), best_phi + (h if axis == 2 else 0.0),
        )  # fmt: skip
        bend = lo - 2.0 * best + hi
        base = ba if axis == 0 else (bb if axis == 1 else best_phi)
        fine = 0.0
        if bend < -1e-6:
            fine = 0.5 * (lo - hi) / bend * h
            fine = min(max(fine, -h), h)
        out[axis] = base + fine
        out[4 + axis] = -bend / (h * h)


@numba.njit(cache=True, nogil=True, fastmath=True)
def learn_patch(template, log_template, a, b, count, a_min, b_max, rate, floor):  # type: ignore[no-untyped-def]
    """Move the template towards the events (in the frame of the corrected end). Both: (A, B) float32."""
    rows, columns = template.shape
    fresh = np.zeros((rows, columns), np.float32)
    weight = np.float32(1.0 / max(count, 1))
    for i in range(count):
        ia, ib = int(a[i] - a_min), int(b[i] + b_max)
        if 1 <= ia < rows - 1 and 1 <= ib < columns - 1:
            for j in range(-1, 2):
                for k in range(-1, 2):
                    fresh[ia + j, ib + k] += weight * np.float32((2 - abs(j)) * (2 - abs(k)) / 16.0)
    uniform = 1.0 / (rows * columns)
    for i in range(rows):
        for j in range(columns):
            template[i, j] += rate * (fresh[i, j] - template[i, j])
            log_template[i, j] = np.log((template[i, j] + floor * uniform) / (uniform * (1.0 + floor)))


@numba.njit(cache=True, nogil=True, fastmath=True)
def collect_tip(  # type: ignore[no-untyped-def]
    rings, heads, columns, t_us, px, py, ex, ey, vx, vy, window_ms, latency_ms, half_width_px, rivals, block, intensity,
    histogram,
):  # fmt: skip
    """Histogram of events along the outward tangent at a tip, moved to now. Returns (count, mean age in ms).

    What other DLOs explain better than a tip of ``intensity`` events/px^2/ms is left out; rivals, block: see
    :func:`motiondlo.tracking.inextensible.observe_kernels.observe_stations`.
    """
    near = np.empty(END_NEAR, np.int64)
    histogram[:] = 0.0
    reach = (histogram.shape[0] - 1) // 2
    oldest = window_ms + latency_ms
    v_a, v_b = (ex * vx + ey * vy) * oldest, (-ey * vx + ex * vy) * oldest
    r0, r1, c0, c1, cx, cy, far_a, far_b = tiles_around(
        px, py, ex, ey, -reach - 1.0 - max(v_a, 0.0), reach + 1.0 - min(v_a, 0.0), -half_width_px - max(v_b, 0.0),
        half_width_px - min(v_b, 0.0), heads, columns,
    )  # fmt: skip
    floor = np.int64(t_us - window_ms * 1000.0 + 1.0) << TIME_SHIFT
    size = rings.shape[1]
    reach_px = reach + half_width_px
    n_near = rows_around(rivals, block, px, py, vx, vy, window_ms, reach_px, near)
    count = 0
    ages = 0.0
    for r in range(r0, r1 + 1):
        for c in range(c0, c1 + 1):
            ux, uy = 16.0 * c + 7.5 - cx, 16.0 * r + 7.5 - cy
            if abs(ux * ex + uy * ey) > far_a or abs(-ux * ey + uy * ex) > far_b:
                continue
            tile = r * columns + c
            head = heads[tile]
            for k in range(head - 1, max(head - size, 0) - 1, -1):
                word = rings[tile, k & (size - 1)]
                if word < floor:
                    break
                age = (t_us - (word >> TIME_SHIFT)) * 1e-3
                dx = ((word >> X_SHIFT) & COORDINATE_MASK) + vx * (age + latency_ms) - px
                dy = ((word >> Y_SHIFT) & Y_MASK) + vy * (age + latency_ms) - py
                if abs(-ey * dx + ex * dy) <= half_width_px:
                    bin_ = int(np.floor(ex * dx + ey * dy + reach + 0.5))
                    if 0 <= bin_ < histogram.shape[0]:
                        if n_near > 0 and intensity_of(rivals, near, n_near, word, latency_ms) > intensity:
                            continue
                        histogram[bin_] += 1.0
                        count += 1
                        ages += age
    return count, ages / max(count, 1)


@numba.njit(cache=True, nogil=True, fastmath=True)
def match_tip(histogram, logs, norms, reach, out):  # type: ignore[no-untyped-def]
    """Maximum-likelihood shift of a tip among several profiles; none where a uniform rate explains nearly as much.

    histogram: (n,) events; logs: (P, n + 2 R) logarithms of the rates expected of each profile, the tip in the middle,
    norms: (P, 2 R + 1) logarithms of their sums over the histogram by shift, R >= reach. out (2,): shift px, sigma px
    (0: none).
    """
    n = histogram.shape[0]
    margin = (logs.shape[1] - n) // 2
    total = 0.0
    for i in range(n):
        total += histogram[i]
    best, best_shift, best_profile = -1e18, 0, 0
    scores = np.empty((logs.shape[0], 2 * reach + 1))
    for k in range(logs.shape[0]):
        for shift in range(-reach, reach + 1):
            value = 0.0
            for i in range(n):
                value += histogram[i] * logs[k, i - shift + margin]
            value -= total * norms[k, shift + margin]
            scores[k, shift + reach] = value
            if value > best:
                best, best_shift, best_profile = value, shift, k
    out[0] = best_shift
    out[1] = 0.0
    k = best_shift + reach
    if k < 2 or k > 2 * reach - 2 or best + total * np.log(n) < max(LEAST_TIP_GAIN * total, SURE_TIP_GAIN):
        return
    score = scores[best_profile]
    # Near its top only: further off the likelihood is no parabola.
    bend = score[k - 1] - 2.0 * score[k] + score[k + 1]
    if bend >= -0.1:
        return
    out[0] = best_shift + 0.5 * (score[k - 1] - score[k + 1]) / bend
    out[1] = np.sqrt(-1.0 / bend)
