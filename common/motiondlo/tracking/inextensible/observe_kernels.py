"""Normal offsets of stations from the time surface: motion-compensated events against signed edge profiles.

Legend: at a station with point ``p``, tangent ``t``, left normal ``n``: ``d`` signed offset along ``n``; ``V`` normal
velocity in px/ms; ``W`` window in ms; ``age`` of an event in ms at the update's instant. An event moved with the curve
to now lies at ``d + V * (age + latency) - kappa / 2 * tau^2``. Its gradient sign is that of d luminance / d d which
explains its polarity: row 0 positive, row 1 negative. Profiles have bins of half a pixel.
"""

from __future__ import annotations

import numba
import numpy as np

from motiondlo.events.bucket_kernels import tile_at
from motiondlo.tracking.inextensible.collect_kernels import collect_station
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
LEAST_EXPECTED = 8.0
"""So many events of a half must be expected before their absence says anything."""
SILENT_SHARE = 0.25
BACKGROUND_SIGMAS = 2.0
"""What is counted above the background is so many standard deviations of it."""


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
    total = scores[:width]
    total[:] = 0.0
    start = np.empty(last + 4, np.int64)
    weight = np.empty(last + 4, np.float32)
    for g in range(2):
        row = reversed_llr[1 - g if flip else g]
        n = 0
        for i in range(last + 1):
            start[n] = last - i
            weight[n] = histogram[g, i]
            n += histogram[g, i] > 0.0
        start[n : n + 3] = 0
        weight[n : n + 3] = 0.0
        # Four bins at a time: what was added is not read back for every one of them.
        for k in range(0, n, 4):
            first, second, third, fourth = start[k], start[k + 1], start[k + 2], start[k + 3]
            a, b, c, d = row[first:], row[second:], row[third:], row[fourth:]
            wa, wb, wc, wd = weight[k], weight[k + 1], weight[k + 2], weight[k + 3]
            for s in range(width):
                total[s] += wa * a[s] + wb * b[s] + wc * c[s] + wd * d[s]


@numba.njit(cache=True, nogil=True, fastmath=True)
def is_one_sided(histogram, at, profile):  # type: ignore[no-untyped-def]
    """Whether a half of the profile has far fewer events than the other one lets expect.

    histogram: (2, L); profile: (2, nT), which begins at bin ``at`` of the histogram.
    """
    bins = profile.shape[1]
    seen = np.zeros(2)
    mass = np.zeros(2)
    for g in range(2):
        for b in range(bins):
            half = 0 if 2 * b < bins else 1
            seen[half] += histogram[g, at + b]
            mass[half] += profile[g, b]
    expected = (seen[0] + seen[1]) / max(mass[0] + mass[1], 1e-6)
    for half in range(2):
        if expected * mass[half] > LEAST_EXPECTED and seen[half] < SILENT_SHARE * expected * mass[half]:
            return True
    return False


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
        longer = min(window_max_ms[i], max(1.25 * last_ms + 0.25, window_min_ms))
        # Where there are plenty, no further back than what will be used; all of what is as old as the window.
        plenty = candidates == 0 and density[i] * half * window_min_ms > 2.0 * n_target
        longest = min(longer, window_min_ms + 0.002) if plenty else longer
        beside = background[tile_at(points[i, 0], points[i, 1], heads, columns)]
        if shared:
            share_buf[:] = 1.0
            shared = False
        n = 0
        n_near = 0
        worth = 1
        per_ms = 0.0
        for _ in range(3):
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
            if longest < longer:
                longest = longer
            else:
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
            inside = age_buf[k] <= w
            share = float(share_buf[k]) if inside else 0.0
            d_buf[used] = d_buf[k]
            sign_buf[used] = sign_buf[k]
            share_buf[used] = share_buf[k]
            weight += share
            age_sum += share * float(age_buf[k])
            used += inside
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
        unsure_way = abs(vn[i]) < max(v_ambiguous, 2.0 * sv[i])
        if unsure_way:
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
        # A line that passes over a DLO at rest, a shadow's rim, looks like one of its edges: the other one is silent.
        if unsure_way and is_one_sided(binned, at, profile[i]):
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
