"""Joint association: how much of every event near one DLO is explained by the silhouettes of others.

Legend: every DLO lays out its stations as *blocks* of rows (:class:`motiondlo.tracking.inextensible.rivals.Rivals`):
place, motion, learned profile and events per px and ms lately, at the time of its newest estimate. The intensity of a
row at an event is its rate times its profile there: the event is moved with that row's own motion, so place, polarity
and velocity all count. An event belongs to a station by the share of its own intensity in the sum of both; the shares
of all DLOs add up to one at most, so that no event is used twice.
"""

from __future__ import annotations

import numba
import numpy as np

from motiondlo.events.bucket_kernels import COORDINATE_MASK, TIME_SHIFT, X_SHIFT, Y_MASK, Y_SHIFT

SHARED_EVENTS = 300
"""More events of a station are thinned out before they are shared."""
NEAR_CAPACITY = 24
"""Rows of others that are considered for one station."""
OWN_FLOOR = 0.3
"""What a station claims away from its edges, share of a uniform density."""
LEAST_RATE = 0.1
"""A station that makes few events claims them as if it made this share of its rival's."""
FURTHEST_DOUBT_PX = 4.0
_LEAST_DOUBT_PX = 0.5
_BINS_PER_PX = 2


@numba.njit(cache=True, nogil=True, fastmath=True)
def blocks_in_reach(r, block, points, active, reach_px, out):  # type: ignore[no-untyped-def]
    """Rows of all blocks but number ``block`` that lie within ``reach_px`` of the box around the active points (m, 2).

    out: (rows,) int64. Returns how many.
    """
    x0, x1, y0, y1 = 1e9, -1e9, 1e9, -1e9
    for i in range(points.shape[0]):
        if active[i]:
            x0, x1 = min(x0, points[i, 0]), max(x1, points[i, 0])
            y0, y1 = min(y0, points[i, 1]), max(y1, points[i, 1])
    x0, x1, y0, y1 = x0 - reach_px, x1 + reach_px, y0 - reach_px, y1 + reach_px
    count = 0
    for b in range(r.first.shape[0] - 1):
        if b == block:
            continue
        for j in range(r.first[b], r.first[b + 1]):
            if r.rate[j] > 0.0 and x0 < r.p[j, 0] < x1 and y0 < r.p[j, 1] < y1:
                out[count] = j
                count += 1
    return count


@numba.njit(cache=True, nogil=True, fastmath=True)
def rows_near(  # type: ignore[no-untyped-def]
    r, candidates, n_candidates, px, py, theta, vn, vt, window_ms, half_px, reach_px, near
):
    """Of the candidate rows those that may explain events of a station. Returns how many of ``near`` they are.

    The station's events lie within half_px along it and reach_px across. vn, vt: its motion, px/ms: in a window both
    move by different ways.
    """
    tx, ty = np.cos(theta), np.sin(theta)
    count = 0
    for c in range(n_candidates):
        j = candidates[c]
        co = abs(r.cos[j] * tx + r.sin[j] * ty)
        si = abs(r.sin[j] * tx - r.cos[j] * ty)
        wide, long = 0.5 * r.bins[j] / _BINS_PER_PX, r.half_px[j]
        vx, vy = r.cos[j] * r.vt[j] - r.sin[j] * r.vn[j], r.sin[j] * r.vt[j] + r.cos[j] * r.vn[j]
        dx, dy = r.p[j, 0] - px, r.p[j, 1] - py
        along = abs(dx * tx + dy * ty) - window_ms * abs(vx * tx + vy * ty - vt)
        across = abs(-dx * ty + dy * tx) - window_ms * abs(-vx * ty + vy * tx - vn)
        if along < half_px + long * co + wide * si and across < reach_px + long * si + wide * co:
            near[count] = j
            count += 1
            if count == near.shape[0]:
                break
    return count


@numba.njit(cache=True, nogil=True, fastmath=True)
def widen(row, bins, doubt_bins, margin, out):  # type: ignore[no-untyped-def]
    """out (bins + 2 margin,): the largest value of a profile's ``row`` (bins,) within ``doubt_bins`` of every bin.

    Bin b of the row is number ``margin`` + b of out; the row is 0 beyond its ends.
    """
    out[: bins + 2 * margin] = np.float32(0.0)
    for shift in range(-doubt_bins, doubt_bins + 1):
        first = max(-shift - margin, 0)
        last = min(bins + margin - shift, bins)
        part = out[margin + shift + first : margin + shift + last]
        values = row[first:last]
        for b in range(last - first):
            part[b] = max(part[b], values[b])


@numba.njit(cache=True, nogil=True, fastmath=True)
def rows_around(r, block, px, py, vx, vy, window_ms, reach_px, near):  # type: ignore[no-untyped-def]
    """Rows of other blocks than ``block`` that may explain events within reach_px of a place; returns how many.

    (vx, vy): motion of the place, px/ms; near: (capacity,) int64.
    """
    count = 0
    for b in range(r.first.shape[0] - 1):
        if b == block:
            continue
        for j in range(r.first[b], r.first[b + 1]):
            if r.rate[j] <= 0.0 or count == near.shape[0]:
                continue
            dvx = r.cos[j] * r.vt[j] - r.sin[j] * r.vn[j] - vx
            dvy = r.sin[j] * r.vt[j] + r.cos[j] * r.vn[j] - vy
            limit = reach_px + r.half_px[j] + 0.5 * r.bins[j] / _BINS_PER_PX + window_ms * (abs(dvx) + abs(dvy))
            dx, dy = r.p[j, 0] - px, r.p[j, 1] - py
            if dx * dx + dy * dy < limit * limit:
                near[count] = j
                count += 1
    return count


@numba.njit(cache=True, nogil=True, fastmath=True)
def intensity_of(r, near, n_near, word, latency_ms):  # type: ignore[no-untyped-def]
    """The largest intensity, events/px^2/ms, that a row of ``near`` (n_near,) has at an event (a bucket word)."""
    x = (word >> X_SHIFT) & COORDINATE_MASK
    y = (word >> Y_SHIFT) & Y_MASK
    t = word >> TIME_SHIFT
    on = (word & 1) == 1
    largest = 0.0
    for q in range(n_near):
        j = near[q]
        age = (r.t_us[j] - t) * 1e-3
        rx, ry = x - r.p[j, 0], y - r.p[j, 1]
        tau = rx * r.cos[j] + ry * r.sin[j] + r.vt[j] * age
        if abs(tau) > r.half_px[j]:
            continue
        e = -rx * r.sin[j] + ry * r.cos[j] - 0.5 * r.kappa[j] * tau * tau
        e += (r.vn[j] + r.omega[j] * tau) * (age + latency_ms)
        at = int(np.floor(e * _BINS_PER_PX + 0.5 * r.bins[j]))
        if at < 0 or at >= r.bins[j]:
            continue
        g = 1 if on == (r.vn[j] >= 0.0) else 0
        largest = max(largest, r.rate[j] * r.profile[j, g, at])
    return largest


@numba.njit(cache=True, nogil=True)
def thin_out(words, d, age, sign, count):  # type: ignore[no-untyped-def]
    """Keep every ``step``-th event, so that at most SHARED_EVENTS are left. Returns (step, how many are left)."""
    step = (count + SHARED_EVENTS - 1) // SHARED_EVENTS
    if step <= 1:
        return 1, count
    kept = 0
    for k in range(0, count, step):
        words[kept], d[kept], age[kept], sign[kept] = words[k], d[k], age[k], sign[k]
        kept += 1
    return step, kept


@numba.njit(cache=True, nogil=True, fastmath=True)
def share_events(  # type: ignore[no-untyped-def]
    r, near, n_near, t_us, latency_ms, profile, rate, doubt_px, both_signs, words, d, sign, count, worth, share
):
    """How much of every event belongs to a station that has rivals.

    near: (n_near,) rows of others; profile: (2, bins) the station's own, rate: its events per px and ms, doubt_px:
    standard deviation of its place, both_signs: its direction of motion is not known. words, d, sign: (count,) events
    (bucket words), their offsets and signs for the station; each stands for ``worth`` events. Out, (count,) float32:
    share 0..worth. Returns their sum.
    """
    bins = profile.shape[1]
    middle = 0.5 * bins
    doubt = int(min(max(doubt_px, _LEAST_DOUBT_PX), FURTHEST_DOUBT_PX) * _BINS_PER_PX)
    largest = 0.0
    for q in range(n_near):
        largest = max(largest, r.rate[near[q]])
    rate = max(rate, LEAST_RATE * largest)
    floor = OWN_FLOOR * 0.5 / bins
    wide = np.empty((2, bins + 2 * doubt), np.float32)
    for g in range(2):
        widen(profile[g], bins, doubt, doubt, wide[g])
    total = 0.0
    for k in range(count):
        others = intensity_of(r, near, n_near, words[k], latency_ms)
        if others > 0.0:
            at = int(np.floor(d[k] * _BINS_PER_PX + middle))
            own = np.float32(0.0)
            if -doubt <= at < bins + doubt:
                own = wide[sign[k], at + doubt]
                if both_signs:
                    own = max(own, wide[1 - sign[k], at + doubt])
            mine = rate * (own + floor)
            share[k] = worth * mine / (mine + others)
        else:
            share[k] = worth
        total += float(share[k])
    return total


@numba.njit(cache=True, nogil=True, fastmath=True)
def lay_out(  # type: ignore[no-untyped-def]
    r, first, t_us, p, th, kappa, vn, vt, omega, sn, density, active, moving, half_px, profile
):
    """Write the stations of one DLO, as they are now, from row ``first`` on. All (m,) or (m, 2); see :func:`look`."""
    for i in range(p.shape[0]):
        j = first + i
        r.t_us[j] = t_us
        r.p[j, 0], r.p[j, 1] = p[i, 0], p[i, 1]
        r.cos[j], r.sin[j] = np.cos(th[i]), np.sin(th[i])
        r.kappa[j], r.vn[j], r.vt[j], r.omega[j] = kappa[i], vn[i], vt[i], omega[i]
        r.rate[j] = density[i] if moving and active[i] else 0.0
        r.half_px[j] = half_px
        bins = profile.shape[2]
        r.bins[j] = bins
        if r.rate[j] > 0.0:
            doubt = int(min(max(sn[i], _LEAST_DOUBT_PX), FURTHEST_DOUBT_PX) * _BINS_PER_PX)
            for g in range(2):
                widen(profile[i, g], bins, doubt, 0, r.profile[j, g])
