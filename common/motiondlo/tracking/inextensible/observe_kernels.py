"""Normal offsets of stations from the time surface: motion-compensated events against signed edge profiles.

Legend: at a station with point ``p``, tangent ``t``, left normal ``n``: ``d`` signed offset along ``n``; ``V`` normal
velocity in px/ms; ``W`` window in ms; ``age`` of an event in ms at the update's instant. An event moved with the curve
to now lies at ``d + V * (age + latency) - kappa / 2 * tau^2``. Its gradient sign is that of d luminance / d d which
explains its polarity: row 0 positive, row 1 negative. Profiles have bins of half a pixel.
"""

from __future__ import annotations

import numba
import numpy as np

BINS_PER_PX = 2
EVENT_CAPACITY = 1500


@numba.njit(cache=True, nogil=True, fastmath=True)
def collect_station(  # type: ignore[no-untyped-def]
    surface,
    t_us,
    px,
    py,
    theta,
    kappa,
    vn,
    vt,
    omega,
    window_ms,
    reach_px,
    half_px,
    latency_ms,
    d_out,
    age_out,
    sign_out,
):
    """Collect the events of one station, moved to now. Returns their number (at most the outputs' length).

    surface: (2, H, W) int64 us. reach_px: largest |d| after motion; half_px: half the station's length along t.
    d_out, age_out: (cap,) float32; sign_out: (cap,) uint8 row of the gradient sign.
    """
    height, width = surface.shape[1], surface.shape[2]
    tx, ty = np.cos(theta), np.sin(theta)
    nx, ny = -ty, tx
    travel = vn * (window_ms + latency_ms)
    lo = -reach_px - max(travel, 0.0)
    hi = reach_px - min(travel, 0.0)
    shift = -0.5 * vt * window_ms
    t_min = t_us - window_ms * 1000.0
    positive = vn >= 0.0
    count = 0
    steps_t = int(2.0 * half_px + 0.5)
    steps_n = int(hi - lo) + 1
    for a in range(steps_t):
        along = shift - half_px + a + 0.5
        bx = px + along * tx + 0.5
        by = py + along * ty + 0.5
        for b in range(steps_n):
            d = lo + b
            x = int(bx + d * nx)
            y = int(by + d * ny)
            if x < 0 or y < 0 or x >= width or y >= height:
                continue
            for p in range(2):
                ts = surface[p, y, x]
                if ts > t_min and count < d_out.shape[0]:
                    age = (t_us - ts) * 1e-3
                    rx, ry = x - px, y - py
                    tau = rx * tx + ry * ty + vt * age
                    e = rx * nx + ry * ny + (vn + omega * tau) * (age + latency_ms) - 0.5 * kappa * tau * tau
                    if abs(e) <= reach_px:
                        d_out[count] = e
                        age_out[count] = age
                        sign_out[count] = 1 if (p == 1) == positive else 0
                        count += 1
    return count


@numba.njit(cache=True, nogil=True, fastmath=True)
def score_shift(histogram, llr, shift, flip, pad):  # type: ignore[no-untyped-def]
    """Log-likelihood of a shift (bins) of a station's profile. histogram: (2, nb), llr: (2, nT), nb = nT + 2 pad."""
    total = np.float32(0.0)
    bins = llr.shape[1]
    for g in range(2):
        row = 1 - g if flip else g
        for j in range(bins):
            c = histogram[g, j + pad + shift]
            if c > 0:
                total += c * llr[row, j]
    return total


@numba.njit(cache=True, nogil=True, fastmath=True)
def observe_stations(  # type: ignore[no-untyped-def]
    surface,
    t_us,
    points,
    theta,
    kappa,
    vn,
    vt,
    omega,
    sv,
    window_max_ms,
    band_px,
    active,
    llr,
    half_px,
    latency_ms,
    window_min_ms,
    n_target,
    n_min,
    v_ambiguous,
    offset,
    sigma,
    age,
    count,
    quality,
    window_ms,
    contrast,
):
    """Offset of every active station along its normal, by maximum likelihood over shifts of its profile.

    llr: (m, 2, nT) float32 log-likelihood ratios against a uniform density. Out, all (m,): offset px, sigma px (0: no
    measurement), mean age ms, count of events in the window, quality (mean log-likelihood ratio an event), window ms,
    contrast (log-likelihood lead over the best other peak, per event).
    """
    m, _, bins = llr.shape
    band_max = 0.0
    for i in range(m):
        band_max = max(band_max, band_px[i])
    pad_max = int(band_max * BINS_PER_PX) + 2
    histogram = np.zeros((2, bins + 2 * pad_max), np.float32)
    scores = np.zeros(2 * pad_max + 1, np.float32)
    d_buf = np.empty(EVENT_CAPACITY, np.float32)
    age_buf = np.empty(EVENT_CAPACITY, np.float32)
    sign_buf = np.empty(EVENT_CAPACITY, np.uint8)
    ages = np.zeros(64, np.int64)
    for i in range(m):
        offset[i] = 0.0
        sigma[i] = 0.0
        age[i] = 0.0
        count[i] = 0
        quality[i] = 0.0
        contrast[i] = 0.0
        window_ms[i] = window_max_ms[i]
        if not active[i]:
            continue
        pad = int(band_px[i] * BINS_PER_PX) + 2
        reach = 0.5 * (bins - 1) / BINS_PER_PX + pad / BINS_PER_PX
        n = collect_station(
            surface, t_us, points[i, 0], points[i, 1], theta[i], kappa[i], vn[i], vt[i], omega[i], window_max_ms[i],
            reach - 0.5, half_px, latency_ms, d_buf, age_buf, sign_buf,
        )  # fmt: skip
        ages[:] = 0
        for k in range(n):
            ages[min(int(age_buf[k] * 4.0), 63)] += 1
        w = window_min_ms
        total = 0
        for k in range(64):
            total += ages[k]
            w = 0.25 * (k + 1)
            if (total >= n_target and w >= window_min_ms) or w >= window_max_ms[i]:
                break
        w = min(w, window_max_ms[i])
        window_ms[i] = w
        used = 0
        age_sum = 0.0
        nb = bins + 2 * pad
        for g in range(2):
            for b in range(nb):
                histogram[g, b] = 0.0
        middle = 0.5 * (nb - 1)
        for k in range(n):
            if age_buf[k] <= w:
                b = int(d_buf[k] * BINS_PER_PX + middle + 0.5)
                if 0 <= b < nb:
                    histogram[sign_buf[k], b] += 1.0
                    used += 1
                    age_sum += age_buf[k]
        count[i] = used
        if used < n_min:
            continue
        age[i] = age_sum / used
        reach_bins = pad - 2
        best = np.float32(-1e9)
        best_shift = 0
        best_flip = False
        flips = 2 if abs(vn[i]) < max(v_ambiguous, 2.0 * sv[i]) else 1
        soft = 1.0 / (band_px[i] * BINS_PER_PX)
        for f in range(flips):
            for s in range(-reach_bins, reach_bins + 1):
                value = score_shift(histogram, llr[i], s, f == 1, pad) - np.float32(2.0 * (s * soft) ** 2)
                if f == 0:
                    scores[s + reach_bins] = value
                if value > best:
                    best = value
                    best_shift = s
                    best_flip = f == 1
        if abs(best_shift) >= reach_bins or best <= 0.0:
            continue
        second = np.float32(0.0)
        for s in range(-reach_bins, reach_bins + 1):
            if abs(s - best_shift) > 6 and scores[s + reach_bins] > second:
                second = scores[s + reach_bins]
        left = score_shift(histogram, llr[i], best_shift - 2, best_flip, pad)
        centre = score_shift(histogram, llr[i], best_shift, best_flip, pad)
        right = score_shift(histogram, llr[i], best_shift + 2, best_flip, pad)
        bend = left - 2.0 * centre + right
        if bend >= -0.3:
            continue
        fine = (left - right) / bend
        fine = min(max(fine, -1.0), 1.0)
        offset[i] = (best_shift + fine) / BINS_PER_PX
        sigma[i] = np.sqrt(-1.0 / bend)
        quality[i] = centre / used
        contrast[i] = (best - second) / used


@numba.njit(cache=True, nogil=True, fastmath=True)
def learn_profiles(  # type: ignore[no-untyped-def]
    surface,
    t_us,
    points,
    theta,
    kappa,
    vn,
    vt,
    omega,
    window_ms,
    learn,
    half_px,
    latency_ms,
    rate,
    pull,
    floor,
    prior,
    profile,
    llr,
):
    """Move the profiles of the stations marked in ``learn`` towards their events at the corrected curve.

    prior, profile: (m, 2, nT) float32 densities (each sums to 1); llr is rewritten for the stations learned.
    """
    m, _, bins = profile.shape
    d_buf = np.empty(EVENT_CAPACITY, np.float32)
    age_buf = np.empty(EVENT_CAPACITY, np.float32)
    sign_buf = np.empty(EVENT_CAPACITY, np.uint8)
    fresh = np.empty((2, bins), np.float32)
    reach = 0.5 * (bins - 1) / BINS_PER_PX
    for i in range(m):
        if not learn[i]:
            continue
        n = collect_station(
            surface, t_us, points[i, 0], points[i, 1], theta[i], kappa[i], vn[i], vt[i], omega[i], window_ms[i],
            reach, half_px, latency_ms, d_buf, age_buf, sign_buf,
        )  # fmt: skip
        if n < 25:
            continue
        fresh[:, :] = 0.0
        weight = 1.0 / n
        for k in range(n):
            u = d_buf[k] * BINS_PER_PX + 0.5 * (bins - 1)
            b = int(u)
            f = u - b
            if 0 <= b < bins - 1:
                fresh[sign_buf[k], b] += weight * (1.0 - f)
                fresh[sign_buf[k], b + 1] += weight * f
        alpha = rate * min(1.0, n / 100.0)
        for g in range(2):
            for b in range(bins):
                lo, hi = max(b - 1, 0), min(b + 1, bins - 1)
                smooth = 0.25 * fresh[g, lo] + 0.5 * fresh[g, b] + 0.25 * fresh[g, hi]
                value = profile[i, g, b]
                profile[i, g, b] = value + alpha * (smooth - value) + pull * (prior[i, g, b] - value)
                llr[i, g, b] = np.log((profile[i, g, b] + floor) / (0.5 / bins + floor))
