"""Events about a predicted curve, moved on to the update's instant, matched with the profile each station should show.

A station's events lie on short lines along its normal; each is moved by normal velocity times age. An event says the
sign of the brightness gradient at its place: ON while moving towards +n means brightness falls along n. ``table``
(S, 2, J) holds the log-likelihood ratio of an event with a positive (0) or negative (1) gradient at offset bin j
against a uniform background, in bins of 0.5 px, offset 0 in the middle.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

F8 = npt.NDArray[np.float64]
F4 = npt.NDArray[np.float32]
I8 = npt.NDArray[np.int64]
B1 = npt.NDArray[np.bool_]

MAX_EVENTS = 4096
AGE_BINS = 32


@numba.njit(cache=True, nogil=True, fastmath=True)
def match_profiles(
    last: npt.NDArray[Any],
    t_us: int,
    latency_ms: float,
    geometry: F8,
    sigma_v: F8,
    accel: F8,
    band: F8,
    active: B1,
    table: F4,
    lines: int,
    line_px: float,
    window_px: float,
    window_min: float,
    window_max: float,
    window_accel: float,
    target: int,
    least: int,
    flip_below: float,
    hist: F4,
    out: F8,
    score: F4,
    ev_bin: I8,
    ev_age: F8,
    ev_sign: I8,
) -> None:
    """Best offset of every active station.

    last: (2, H, W) time of the newest event per polarity, us. geometry (S, 10) as of ``filter_kernels.place``;
    sigma_v, accel, band (S,): standard deviation of the normal velocity px/ms, normal acceleration px/ms^2, half width
    of the search px. hist (S, 2, B) gets the events' histogram about the prediction. score, ev_*: scratch.
    out (S, 8): offset px, its standard deviation (0: nothing found), mean log-likelihood ratio, events found,
    mean age ms, window ms, lead over the second best offset (nats), events within half a band of the middle.
    """
    H = last.shape[1]
    Wd = last.shape[2]
    J = table.shape[2]
    half_table = (J - 1) // 2
    B = hist.shape[2]
    half_hist = (B - 1) // 2
    ages = np.zeros(AGE_BINS, np.int64)
    for s in range(geometry.shape[0]):
        for k in range(8):
            out[s, k] = 0.0
        out[s, 3] = -1.0
        if not active[s]:
            continue
        px = geometry[s, 0]
        py = geometry[s, 1]
        tx = geometry[s, 2]
        ty = geometry[s, 3]
        nx = -ty
        ny = tx
        V = geometry[s, 6]
        curve = 0.5 * geometry[s, 8]
        limit = math.sqrt(window_accel / max(abs(accel[s]), 1e-3))
        window = window_px / max(abs(V) + 0.5 * sigma_v[s], 1e-3)
        window = min(max(min(window, limit), window_min), window_max)
        reach = min(half_table * 0.5 + band[s], half_hist * 0.5 - 1.0)
        low = -reach + min(0.0, -V * (window + latency_ms))
        high = reach + max(0.0, -V * (window + latency_ms))
        oldest = t_us - window * 1e3
        n = 0
        for a in range(AGE_BINS):
            ages[a] = 0
        for q in range(-lines, lines + 1):
            along = q * line_px
            bx = px + along * tx + curve * along * along * nx
            by = py + along * ty + curve * along * along * ny
            d = low
            while d <= high:
                xi = int(bx + d * nx + 0.5)
                yi = int(by + d * ny + 0.5)
                if xi >= 0 and yi >= 0 and xi < Wd and yi < H:
                    for p in range(2):
                        t = last[p, yi, xi]
                        if t > oldest and n < MAX_EVENTS:
                            age = (t_us - t) * 1e-3
                            dd = (xi - bx) * nx + (yi - by) * ny + V * (age + latency_ms)
                            b = math.floor(dd * 2.0 + 0.5) + half_hist
                            if b >= 0 and b < B and abs(dd) <= reach:
                                ev_bin[n] = b
                                ev_age[n] = age
                                ev_sign[n] = 0 if (p == 1) != (V >= 0.0) else 1
                                n += 1
                                ages[min(AGE_BINS - 1, int(age / window * AGE_BINS))] += 1
                d += 1.0
        out[s, 3] = n
        out[s, 5] = window
        if n < least:
            continue
        # Of more events than needed the newest are taken: the shorter the window, the less the velocity's error counts.
        if n > target:
            kept = 0
            for a in range(AGE_BINS):
                kept += ages[a]
                edge = window * (a + 1) / AGE_BINS
                if kept >= target and edge >= window_min:
                    window = edge
                    break
        for g in range(2):
            for b in range(B):
                hist[s, g, b] = 0.0
        used = 0
        total_age = 0.0
        near = 0
        for i in range(n):
            if ev_age[i] <= window:
                hist[s, ev_sign[i], ev_bin[i]] += 1.0
                total_age += ev_age[i]
                used += 1
                if abs(ev_bin[i] - half_hist) <= half_table:
                    near += 1
        out[s, 5] = window
        out[s, 3] = used
        out[s, 7] = near
        if near < least:
            continue
        K = int(band[s] * 2.0)
        M = 2 * K + 1
        best = -1e30
        best_k = 0
        best_f = 0
        flips = 2 if abs(V) < flip_below else 1
        for f in range(flips):
            for m in range(M):
                score[f, m] = 0.0
            for g in range(2):
                row = table[s, g if f == 0 else 1 - g]
                for b in range(B):
                    c = hist[s, g, b]
                    if c > 0.0:
                        # score[m] is for an offset of m - K bins: the event then lies at table bin b - (m - K).
                        o = b - half_hist + half_table + K
                        m0 = max(0, o - (J - 1))
                        m1 = min(M - 1, o)
                        floor = row[0]
                        for m in range(0, m0):
                            score[f, m] += c * floor
                        for m in range(m0, m1 + 1):
                            score[f, m] += c * row[o - m]
                        for m in range(m1 + 1, M):
                            score[f, m] += c * floor
            for m in range(M):
                r = (m - K) / max(K, 1)
                v = score[f, m] - 2.0 * r * r
                score[f, m] = v
                if v > best:
                    best = v
                    best_k = m
                    best_f = f
        if best <= 0.0 or best_k < 2 or best_k > M - 3:
            continue
        second = -1e30
        for m in range(M):
            if abs(m - best_k) > 8 and score[best_f, m] > second:
                second = score[best_f, m]
        e0 = score[best_f, best_k - 2]
        e1 = score[best_f, best_k]
        e2 = score[best_f, best_k + 2]
        bend = e0 - 2.0 * e1 + e2
        if bend >= -0.2:
            continue
        out[s, 0] = (best_k - K) * 0.5 + 0.5 * (e0 - e2) / bend
        out[s, 1] = math.sqrt(-1.0 / bend)
        out[s, 2] = best / near
        out[s, 4] = total_age / used
        out[s, 6] = best - max(second, 0.0)


@numba.njit(cache=True, nogil=True, fastmath=True)
def learn_profiles(
    hist: F4, shift: F8, learn: B1, rate: float, density: F4, anchor: F4, anchor_share: float, floor: float, table: F4
) -> None:
    """Blend the events' histogram, seen from the corrected curve, into each station's density; renew its table.

    shift (S,) px: how far the correction moved the station along its normal. density, anchor (S, 2, J): learned, and of
    the first frame; each sums to one over both signs.
    """
    J = table.shape[2]
    half_table = (J - 1) // 2
    half_hist = (hist.shape[2] - 1) // 2
    for s in range(table.shape[0]):
        if not learn[s]:
            continue
        move = math.floor(shift[s] * 2.0 + 0.5)
        total = 0.0
        for g in range(2):
            for j in range(J):
                b = j - half_table + half_hist + move
                if b >= 0 and b < hist.shape[2]:
                    total += hist[s, g, b]
        if total < 12.0:
            continue
        a = rate * min(1.0, total / 60.0)
        for g in range(2):
            for j in range(J):
                b = j - half_table + half_hist + move
                v = 0.0
                # A triangle of 1.5 px: the events' own spread is about that.
                for k in range(-2, 3):
                    if b + k >= 0 and b + k < hist.shape[2]:
                        v += hist[s, g, b + k] * (3 - abs(k))
                density[s, g, j] += a * (v / (9.0 * total) - density[s, g, j])
                mixed = (1.0 - anchor_share) * density[s, g, j] + anchor_share * anchor[s, g, j]
                table[s, g, j] = math.log((mixed + floor) / (2.0 * floor))


@numba.njit(cache=True, nogil=True, fastmath=True)
def activity(last: npt.NDArray[Any], t_us: int, since_us: int, geometry: F8, reach: float, active: B1) -> int:
    """Events newer than ``since_us`` on one line across each active station: the cheap look at a resting DLO."""
    H = last.shape[1]
    Wd = last.shape[2]
    n = 0
    for s in range(geometry.shape[0]):
        if not active[s]:
            continue
        d = -reach
        while d <= reach:
            xi = int(geometry[s, 0] - d * geometry[s, 3] + 0.5)
            yi = int(geometry[s, 1] + d * geometry[s, 2] + 0.5)
            if xi >= 0 and yi >= 0 and xi < Wd and yi < H:
                if last[0, yi, xi] > since_us:
                    n += 1
                if last[1, yi, xi] > since_us:
                    n += 1
            d += 1.0
    return n
