"""Normal offsets of stations from the time surface: motion-compensated events against signed edge profiles.

Legend: at a station with point ``p``, tangent ``t``, left normal ``n``: ``d`` signed offset along ``n``; ``V`` normal
velocity in px/ms; ``W`` window in ms; ``age`` of an event in ms at the update's instant. An event moved with the curve
to now lies at ``d + V * (age + latency) - kappa / 2 * tau^2``. Its gradient sign is that of d luminance / d d which
explains its polarity: row 0 positive, row 1 negative. Profiles have bins of half a pixel.
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
    tile_at,
    tiles_around,
)
from motiondlo.tracking.inextensible.rival_kernels import (
    NEAR_CAPACITY,
    blocks_in_reach,
    rows_near,
    share_events,
    thin_out,
)

BINS_PER_PX = 2
EVENT_CAPACITY = 1500
ENOUGH = 3.0
BACKGROUND_SIGMAS = 2.0
"""What is counted above the background is so many standard deviations of it."""


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
    mask = size - 1
    floor = np.int64(t_us - window_ms * 1000.0 + 1.0) << TIME_SHIFT
    flip = 0 if vn >= 0.0 else 1
    half_kappa = 0.5 * kappa
    capacity = d_out.shape[0]
    count = 0
    for r in range(r0, r1 + 1):
        for c in range(c0, c1 + 1):
            ux = 16.0 * c + 7.5 - cx
            uy = 16.0 * r + 7.5 - cy
            if abs(ux * nx + uy * ny) > far_n or abs(ux * tx + uy * ty) > far_t:
                continue
            tile = r * columns + c
            head = heads[tile]
            for k in range(head - 1, max(head - size, 0) - 1, -1):
                word = rings[tile, k & mask]
                if word < floor:
                    break
                age = (t_us - (word >> TIME_SHIFT)) * 1e-3
                rx = ((word >> X_SHIFT) & COORDINATE_MASK) - px
                ry = ((word >> Y_SHIFT) & Y_MASK) - py
                tau = rx * tx + ry * ty + vt * age
                e = rx * nx + ry * ny + (vn + omega * tau) * (age + latency_ms) - half_kappa * tau * tau
                # Written whether it belongs here or not: a branch would be predicted wrongly every other time.
                d_out[count] = e
                age_out[count] = age
                sign_out[count] = (word & 1) ^ flip
                word_out[count] = word
                count += (abs(tau) <= half_px) & (abs(e) <= reach_px)
                if count == capacity:
                    return count
    return count


@numba.njit(cache=True, nogil=True, fastmath=True)
def bin_events(d, sign, share, count, histogram):  # type: ignore[no-untyped-def]
    """Sum shares of events at offsets d by sign and half pixel. histogram: (2, L) float32, its middle at d = 0."""
    histogram[:, :] = 0.0
    last = histogram.shape[1] - 1
    middle = 0.5 * last + 0.5
    for k in range(count):
        b = int(d[k] * BINS_PER_PX + middle)
        if 0 <= b <= last:
            histogram[sign[k], b] += share[k]


@numba.njit(cache=True, nogil=True, fastmath=True)
def score_shifts(histogram, reversed_llr, reach_bins, flip, scores):  # type: ignore[no-untyped-def]
    """Log-likelihood of shifts -reach_bins .. reach_bins (half pixels) of a profile, given binned events.

    histogram: (2, L); reversed_llr: (2, L + 2 reach_bins) padded with its value for no known edge, the last bin first,
    so that both are read forward; flip exchanges the signs; scores: (2 reach_bins + 1,).
    """
    width = 2 * reach_bins + 1
    last = histogram.shape[1] - 1
    scores[:width] = 0.0
    for g in range(2):
        row = 1 - g if flip else g
        for b in range(last + 1):
            weight = histogram[g, b]
            if weight > 0.0:
                for s in range(width):
                    scores[s] += weight * reversed_llr[row, last - b + s]


@numba.njit(cache=True, nogil=True, fastmath=True)
def observe_stations(  # type: ignore[no-untyped-def]
    rings,
    heads,
    columns,
    background,
    t_us,
    points,
    theta,
    kappa,
    vn,
    vt,
    omega,
    sn,
    sv,
    window_max_ms,
    band_px,
    active,
    rivals,
    block,
    profile,
    llr,
    outside,
    floor,
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
    density,
):
    """Offset of every active station along its normal, by maximum likelihood over shifts of its profile.

    llr: (m, 2, nT) float32 log-likelihood ratios against a uniform density; outside: the ratio beyond the profile;
    floor: what was added to either density. background: (tiles,) float32 events/px/ms that lie there in any case: they
    are not counted, and the ratios are those of the profile on top of them. Where they would hide everything a station
    becomes inactive. rivals: the stations of all DLOs, of which block number ``block`` is this one's own: an event
    counts by the share that they leave (:mod:`rival_kernels`); where they leave next to nothing of many a station
    becomes inactive. sn, sv: (m,) standard deviations of place and rate along the normal; profile: (m, 2, nT) float32.
    Out, all (m,): offset px, sigma px (0: no measurement), mean age ms, count of events in the window that are surely
    more than the background, quality (mean log-likelihood ratio an event), window ms.
    """
    m, _, bins = llr.shape
    band_max = 0.0
    for i in range(m):
        band_max = max(band_max, band_px[i])
    reach_max = int(band_max * BINS_PER_PX)
    histogram = np.empty((2, bins + 2 * reach_max), np.float32)
    padded = np.empty((2, bins + 4 * reach_max), np.float32)
    scores = np.zeros(2 * reach_max + 1, np.float32)
    flipped = np.zeros(2 * reach_max + 1, np.float32)
    d_buf = np.empty(EVENT_CAPACITY, np.float32)
    age_buf = np.empty(EVENT_CAPACITY, np.float32)
    sign_buf = np.empty(EVENT_CAPACITY, np.uint8)
    word_buf = np.empty(EVENT_CAPACITY, np.int64)
    share_buf = np.ones(EVENT_CAPACITY, np.float32)
    ages = np.zeros(64)
    near = np.empty(NEAR_CAPACITY, np.int64)
    shared = False
    mean_density = 0.0
    candidates = 0
    if rivals.rate.shape[0] > m:
        widest = 0.5 * (bins - 1) / BINS_PER_PX + band_max
        candidates = blocks_in_reach(rivals, block, points, active, 2.0 * widest + half_px, rivals.near)
        mean_density = density[active > 0].mean() if active.any() else 0.0
    for i in range(m):
        offset[i] = 0.0
        sigma[i] = 0.0
        age[i] = 0.0
        count[i] = 0
        quality[i] = 0.0
        last_ms = window_ms[i]
        window_ms[i] = window_max_ms[i]
        if not active[i]:
            continue
        reach_bins = int(band_px[i] * BINS_PER_PX)
        reach = 0.5 * (bins - 1) / BINS_PER_PX + band_px[i]
        # As far back and as wide as the last look says; all of it where that was too little.
        expected = density[i] * half_px * window_min_ms
        half = half_px * min(max(ENOUGH * n_target / max(expected, 1.0), 1.0 / 3.0), 1.0)
        longest = min(window_max_ms[i], max(1.25 * last_ms + 0.25, window_min_ms))
        beside = background[tile_at(points[i, 0], points[i, 1], heads, columns)]
        if shared:
            share_buf[:] = 1.0
            shared = False
        n = 0
        n_near = 0
        worth = 1
        per_ms = 0.0
        for _ in range(2):
            n = collect_station(
                rings, heads, columns, t_us, points[i, 0], points[i, 1], theta[i], kappa[i], vn[i], vt[i], omega[i],
                longest, reach, half, latency_ms, d_buf, age_buf, sign_buf, word_buf,
            )  # fmt: skip
            mine = float(n)
            if candidates > 0:
                n_near = rows_near(
                    rivals, rivals.near, candidates, points[i, 0], points[i, 1], theta[i], vn[i], vt[i], longest, half,
                    reach, near,
                )  # fmt: skip
            if n_near > 0:
                shared = True
                worth, n = thin_out(word_buf, d_buf, age_buf, sign_buf, n)
                mine = share_events(
                    rivals, near, n_near, t_us, latency_ms, profile[i], max(density[i], 0.5 * mean_density), sn[i],
                    abs(vn[i]) < max(v_ambiguous, 2.0 * sv[i]), word_buf, d_buf, sign_buf, n, worth, share_buf,
                )  # fmt: skip
            per_ms = 4.0 * beside * half * reach
            if mine - per_ms * longest >= n_target or (half == half_px and longest == window_max_ms[i]):
                break
            half = half_px
            longest = window_max_ms[i]
        ages[:] = 0
        for k in range(n):
            ages[min(int(age_buf[k] * 4.0), 63)] += share_buf[k]
        w = window_min_ms
        total = 0.0
        for k in range(64):
            total += ages[k]
            w = 0.25 * (k + 1)
            if (total - per_ms * w >= n_target and w >= window_min_ms) or w >= window_max_ms[i]:
                break
        w = min(w, window_max_ms[i])
        window_ms[i] = w
        used = 0
        weight = 0.0
        age_sum = 0.0
        for k in range(n):
            if age_buf[k] <= w:
                d_buf[used] = d_buf[k]
                sign_buf[used] = sign_buf[k]
                share_buf[used] = share_buf[k]
                weight += share_buf[k]
                age_sum += share_buf[k] * age_buf[k]
                used += 1
        unsure = BACKGROUND_SIGMAS * np.sqrt(per_ms * w)
        if unsure > n_target:
            active[i] = 0
            continue
        own = max(weight - per_ms * w, 0.0)
        count[i] = int(max(own - unsure, 0.0))
        density[i] = own / (half * w)
        if count[i] < n_min:
            if n_near > 0 and worth * used - weight > n_min:
                # What others leave is too little to tell whether it is silent.
                active[i] = 0
            continue
        age[i] = age_sum / weight
        hidden = np.float32(0.5 / BINS_PER_PX * 2.0 * half * beside * w / (max(own, 1.0) * (0.5 / bins + floor)))
        binned = histogram[:, : bins + 2 * reach_bins]
        bin_events(d_buf, sign_buf, share_buf, used, binned)
        pad = 2 * reach_bins
        for g in range(2):
            for b in range(pad):
                padded[g, b] = outside
                padded[g, pad + bins + b] = outside
            for b in range(bins):
                padded[g, pad + b] = llr[i, g, bins - 1 - b]
            if hidden > 0.0:
                for b in range(bins):
                    padded[g, pad + b] = np.log((np.exp(padded[g, pad + b]) + hidden) / (1.0 + hidden))
        score_shifts(binned, padded, reach_bins, False, scores)
        best = np.float32(-1e9)
        at = 0
        soft = np.float32(1.0 / (band_px[i] * BINS_PER_PX))
        for k in range(2 * reach_bins + 1):
            u = (k - reach_bins) * soft
            value = scores[k] - np.float32(2.0) * u * u
            if value > best:
                best = value
                at = k
        chosen = scores
        if abs(vn[i]) < max(v_ambiguous, 2.0 * sv[i]):
            score_shifts(binned, padded, reach_bins, True, flipped)
            for k in range(2 * reach_bins + 1):
                u = (k - reach_bins) * soft
                value = flipped[k] - np.float32(2.0) * u * u
                if value > best:
                    best = value
                    at = k
                    chosen = flipped
        if at < 2 or at > 2 * reach_bins - 2 or best <= 0.0:
            continue
        bend = chosen[at - 2] - np.float32(2.0) * chosen[at] + chosen[at + 2]
        if bend >= -0.3:
            continue
        fine = (chosen[at - 2] - chosen[at + 2]) / bend
        fine = min(max(fine, -1.0), 1.0)
        offset[i] = (at - reach_bins + fine) / BINS_PER_PX
        sigma[i] = np.sqrt(-1.0 / bend)
        quality[i] = chosen[at] / max(own, 1.0)


@numba.njit(cache=True, nogil=True, fastmath=True)
def learn_profiles(  # type: ignore[no-untyped-def]
    rings,
    heads,
    columns,
    background,
    t_us,
    points,
    theta,
    kappa,
    vn,
    vt,
    omega,
    sn,
    window_ms,
    good,
    rivals,
    block,
    density,
    turn,
    turns,
    v_min,
    half_px,
    latency_ms,
    rate,
    pull,
    floor,
    prior,
    profile,
    llr,
):
    """Move the profiles of stations that were seen in motion towards their events at the corrected curve.

    Every update takes every ``turns``-th station, starting with number ``turn``; rivals, block as in
    :func:`observe_stations`.
    prior, profile: (m, 2, nT) float32 densities (each sums to 1); llr is rewritten for the stations learned.
    """
    m, _, bins = profile.shape
    d_buf = np.empty(EVENT_CAPACITY, np.float32)
    age_buf = np.empty(EVENT_CAPACITY, np.float32)
    sign_buf = np.empty(EVENT_CAPACITY, np.uint8)
    word_buf = np.empty(EVENT_CAPACITY, np.int64)
    share_buf = np.ones(EVENT_CAPACITY, np.float32)
    fresh = np.empty((2, bins), np.float32)
    near = np.empty(NEAR_CAPACITY, np.int64)
    shared = False
    reach = 0.5 * (bins - 1) / BINS_PER_PX
    candidates = 0
    if rivals.rate.shape[0] > m:
        candidates = blocks_in_reach(rivals, block, points, good, 2.0 * reach + half_px, rivals.near)
    for i in range(m):
        if i % turns != turn or not good[i] or abs(vn[i]) < v_min:
            continue
        n = collect_station(
            rings, heads, columns, t_us, points[i, 0], points[i, 1], theta[i], kappa[i], vn[i], vt[i], omega[i],
            window_ms[i], reach, half_px, latency_ms, d_buf, age_buf, sign_buf, word_buf,
        )  # fmt: skip
        weight_all = float(n)
        if shared:
            share_buf[:] = 1.0
            shared = False
        if candidates > 0:
            n_near = rows_near(
                rivals, rivals.near, candidates, points[i, 0], points[i, 1], theta[i], vn[i], vt[i], window_ms[i],
                half_px, reach, near,
            )  # fmt: skip
            if n_near > 0:
                shared = True
                worth, n = thin_out(word_buf, d_buf, age_buf, sign_buf, n)
                weight_all = share_events(
                    rivals, near, n_near, t_us, latency_ms, profile[i], density[i], sn[i], False, word_buf, d_buf,
                    sign_buf, n, worth, share_buf,
                )  # fmt: skip
        beside = background[tile_at(points[i, 0], points[i, 1], heads, columns)] * window_ms[i]
        own = weight_all - 4.0 * beside * half_px * reach
        if own < 25.0:
            continue
        fresh[:, :] = 0.0
        weight = 1.0 / own
        uniform = weight * 0.5 / BINS_PER_PX * 2.0 * half_px * beside
        for k in range(n):
            u = d_buf[k] * BINS_PER_PX + 0.5 * (bins - 1)
            b = int(u)
            f = u - b
            if 0 <= b < bins - 1:
                fresh[sign_buf[k], b] += weight * share_buf[k] * (1.0 - f)
                fresh[sign_buf[k], b + 1] += weight * share_buf[k] * f
        alpha = rate * min(1.0, own / 100.0)
        for g in range(2):
            for b in range(bins):
                lo, hi = max(b - 1, 0), min(b + 1, bins - 1)
                smooth = 0.25 * fresh[g, lo] + 0.5 * fresh[g, b] + 0.25 * fresh[g, hi] - uniform
                value = profile[i, g, b]
                profile[i, g, b] = value + alpha * (smooth - value) + pull * (prior[i, g, b] - value)
                llr[i, g, b] = np.log((profile[i, g, b] + floor) / (0.5 / bins + floor))
