"""Rigid patches at the ends of a chain (gripper, free tip): events matched with the gradients of the first frame.

Patch coordinates: a px outwards along the end's tangent, d px along the left normal of the chain's direction; the
origin moves with the end. Gradients (A, D) are sampled every px from (a0, -dm). An event's expected sign follows from
dL/dt = -v . grad L, so that the table of log-likelihood ratios depends on the direction of motion.
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

MAX_EVENTS = 8192


@numba.njit(cache=True, nogil=True, fastmath=True)
def collect(
    last: npt.NDArray[Any],
    t_us: int,
    window_ms: float,
    latency_ms: float,
    origin: F8,
    outward: F8,
    normal: F8,
    velocity: F8,
    rotation: float,
    box: F8,
    ev_a: F8,
    ev_d: F8,
    ev_p: I8,
    ev_age: F8,
) -> int:
    """Events of the patch, moved on to ``t_us`` by the velocity (2,) px/ms and rotation rad/ms about the origin.

    box: a0, a1, dm. Returns how many were stored in ev_a, ev_d, ev_p, ev_age.
    """
    H = last.shape[1]
    Wd = last.shape[2]
    a0 = box[0]
    a1 = box[1]
    dm = box[2]
    # The patch's bounding box now, and where the motion took it from.
    x0 = 1e9
    x1 = -1e9
    y0 = 1e9
    y1 = -1e9
    for i in range(2):
        for j in range(2):
            a = a0 if i == 0 else a1
            d = -dm if j == 0 else dm
            x = origin[0] + a * outward[0] + d * normal[0]
            y = origin[1] + a * outward[1] + d * normal[1]
            x0 = min(x0, x)
            x1 = max(x1, x)
            y0 = min(y0, y)
            y1 = max(y1, y)
    span = window_ms + latency_ms
    x0 = min(x0, x0 - velocity[0] * span) - 2.0
    x1 = max(x1, x1 - velocity[0] * span) + 2.0
    y0 = min(y0, y0 - velocity[1] * span) - 2.0
    y1 = max(y1, y1 - velocity[1] * span) + 2.0
    oldest = t_us - window_ms * 1e3
    n = 0
    for y in range(max(0, int(y0)), min(H - 1, int(y1)) + 1):
        for x in range(max(0, int(x0)), min(Wd - 1, int(x1)) + 1):
            for p in range(2):
                t = last[p, y, x]
                if t > oldest:
                    age = (t_us - t) * 1e-3
                    span = age + latency_ms
                    rx = x - origin[0]
                    ry = y - origin[1]
                    dx = rx + (velocity[0] - rotation * ry) * span
                    dy = ry + (velocity[1] + rotation * rx) * span
                    a = dx * outward[0] + dy * outward[1]
                    d = dx * normal[0] + dy * normal[1]
                    if a >= a0 and a <= a1 and d >= -dm and d <= dm and n < MAX_EVENTS:
                        ev_a[n] = a
                        ev_d[n] = d
                        ev_p[n] = p
                        ev_age[n] = age
                        n += 1
    return n


@numba.njit(cache=True, nogil=True, fastmath=True)
def build_table(grad_a: F4, grad_d: F4, va: float, vd: float, pad: int, density: F4, table: F4) -> None:
    """Log-likelihood ratios for a direction of motion (va, vd).

    density: (2, A, D) scratch. table: (2, A + 2 pad, D + 2 pad), OFF first; the rim holds the floor.
    """
    A, D = grad_a.shape
    speed = math.sqrt(va * va + vd * vd) + 1e-9
    total = 0.0
    for i in range(A):
        for j in range(D):
            change = -(va * grad_a[i, j] + vd * grad_d[i, j]) / speed
            # Strong edges give hardly more newest events than weak ones: compress.
            v = math.sqrt(abs(change)) if abs(change) > 0.015 else 0.0
            density[1, i, j] = v if change > 0.0 else 0.0
            density[0, i, j] = v if change < 0.0 else 0.0
            total += v
    floor = 0.5 / (A * D)
    low = math.log(0.5)
    for p in range(2):
        for i in range(A + 2 * pad):
            for j in range(D + 2 * pad):
                table[p, i, j] = low
        if total <= 0.0:
            continue
        for i in range(A):
            for j in range(D):
                v = 0.0
                c = 0.0
                for di in range(-1, 2):
                    for dj in range(-1, 2):
                        if i + di >= 0 and i + di < A and j + dj >= 0 and j + dj < D:
                            w = (2 - abs(di)) * (2 - abs(dj))
                            v += w * density[p, i + di, j + dj]
                            c += w
                table[p, i + pad, j + pad] = math.log((v / c / total + floor) / (2.0 * floor))


@numba.njit(cache=True, nogil=True, fastmath=True)
def match(
    table: F4,
    pad: int,
    a0: float,
    dm: float,
    ev_a: F8,
    ev_d: F8,
    ev_p: I8,
    n: int,
    most: int,
    ra: int,
    rd: int,
    score: F4,
    out: F8,
) -> None:
    """Shift of the events against the table by exhaustive search within +-ra, +-rd px.

    score: (2 ra + 1, >= 2 rd + 1) scratch. out: shift a, shift d, their standard deviations (0: none), mean
    log-likelihood ratio, lead over the best shift more than 3 px away (nats of the events used), events used.
    """
    for k in range(7):
        out[k] = 0.0
    step = max(1, n // most)
    for i in range(2 * ra + 1):
        for j in range(2 * rd + 1):
            score[i, j] = 0.0
    A = table.shape[1]
    D = table.shape[2]
    used = 0
    for e in range(0, n, step):
        # An event at a fits the template moved by s where the template has a - s.
        ia = math.floor(ev_a[e] - a0 + 0.5) + pad
        jd = math.floor(ev_d[e] + dm + 0.5) + pad
        used += 1
        for i in range(-ra, ra + 1):
            k = min(max(ia - i, 0), A - 1)
            for j in range(-rd, rd + 1):
                c = min(max(jd - j, 0), D - 1)
                score[i + ra, j + rd] += table[ev_p[e], k, c]
    best = np.float32(-1e30)
    bi = 0
    bj = 0
    for i in range(2 * ra + 1):
        for j in range(2 * rd + 1):
            if score[i, j] > best:
                best = score[i, j]
                bi = i
                bj = j
    second = np.float32(-1e30)
    for i in range(2 * ra + 1):
        for j in range(2 * rd + 1):
            if (abs(i - bi) > 3 or abs(j - bj) > 3) and score[i, j] > second:
                second = score[i, j]
    out[4] = best / max(used, 1)
    out[5] = best - second if second > -1e29 else 0.0
    out[6] = used
    if best <= 0.0:
        return
    if bi >= 2 and bi <= 2 * ra - 2:
        bend = score[bi - 2, bj] - 2.0 * best + score[bi + 2, bj]
        if bend < -0.2:
            out[0] = bi - ra + (score[bi - 2, bj] - score[bi + 2, bj]) / bend
            out[2] = 2.0 / math.sqrt(-bend)
    if rd >= 2 and bj >= 2 and bj <= 2 * rd - 2:
        bend = score[bi, bj - 2] - 2.0 * best + score[bi, bj + 2]
        if bend < -0.2:
            out[1] = bj - rd + (score[bi, bj - 2] - score[bi, bj + 2]) / bend
            out[3] = 2.0 / math.sqrt(-bend)


@numba.njit(cache=True, nogil=True, fastmath=True)
def newest(ev_a: F8, ev_d: F8, ev_p: I8, ev_age: F8, n: int, window_ms: float, target: int, least_ms: float) -> int:
    """Keep only the newest events, about ``target`` of them and at least those of ``least_ms``; returns how many."""
    if n <= target:
        return n
    bins = np.zeros(64, np.int64)
    for i in range(n):
        bins[min(63, int(ev_age[i] / window_ms * 64))] += 1
    kept = 0
    edge = window_ms
    for b in range(64):
        kept += bins[b]
        if kept >= target and window_ms * (b + 1) / 64 >= least_ms:
            edge = window_ms * (b + 1) / 64
            break
    k = 0
    for i in range(n):
        if ev_age[i] <= edge:
            ev_a[k] = ev_a[i]
            ev_d[k] = ev_d[i]
            ev_p[k] = ev_p[i]
            ev_age[k] = ev_age[i]
            k += 1
    return k


@numba.njit(cache=True, nogil=True, fastmath=True)
def find_direction(
    lean_a: F4,
    lean_d: F4,
    pad: int,
    a0: float,
    dm: float,
    ev_a: F8,
    ev_d: F8,
    ev_p: I8,
    n: int,
    most: int,
    reach: int,
    sum_a: F4,
    sum_d: F4,
    out: F8,
) -> None:
    """Direction of motion (out[0] along a, out[1] along d) at the shift where signed events fit the gradients best.

    lean_a, lean_d: compressed gradients with a zero rim of ``pad``. Signed events summed over gradients give -M v with
    M the structure tensor: good enough to choose among the tables.
    """
    step = max(1, n // most)
    W = 2 * reach + 1
    for i in range(W):
        for j in range(W):
            sum_a[i, j] = 0.0
            sum_d[i, j] = 0.0
    A, D = lean_a.shape
    for e in range(0, n, step):
        ia = math.floor(ev_a[e] - a0 + 0.5) + pad
        jd = math.floor(ev_d[e] + dm + 0.5) + pad
        sign = 1.0 if ev_p[e] == 1 else -1.0
        for i in range(-reach, reach + 1):
            k = min(max(ia - i, 0), A - 1)
            for j in range(-reach, reach + 1):
                c = min(max(jd - j, 0), D - 1)
                sum_a[i + reach, j + reach] += sign * lean_a[k, c]
                sum_d[i + reach, j + reach] += sign * lean_d[k, c]
    best = np.float32(0.0)
    out[0] = 0.0
    out[1] = 0.0
    for i in range(W):
        for j in range(W):
            v = sum_a[i, j] * sum_a[i, j] + sum_d[i, j] * sum_d[i, j]
            if v > best:
                best = v
                out[0] = -sum_a[i, j]
                out[1] = -sum_d[i, j]


@numba.njit(cache=True, nogil=True, fastmath=True)
def find_step(ev_a: F8, n: int, half: int, counts: F8, out: F8) -> None:
    """Place along the tangent where events end: two rates, many inside and few outside, by likelihood.

    Events with a in [-half, half]. out: place px, gain in nats over a single rate (0: none), events per px inside.
    """
    bins = 2 * half + 1
    for b in range(bins):
        counts[b] = 0.0
    total = 0
    for i in range(n):
        b = math.floor(ev_a[i] + half + 0.5)
        if b >= 0 and b < bins:
            counts[b] += 1.0
            total += 1
    out[0] = 0.0
    out[1] = 0.0
    out[2] = 0.0
    if total < 20:
        return
    alone = total * math.log(total / bins)
    inside = 0.0
    best = -1e30
    for b in range(bins - 6):
        inside += counts[b]
        if b < 9:
            continue
        na = b + 1
        nb = bins - na
        outside = total - inside
        v = inside * math.log((inside + 0.5) / na) + outside * math.log((outside + 0.5) / nb)
        if v > best and inside / na > 3.0 * (outside + 0.5) / nb:
            best = v
            out[0] = b - half + 0.5
            out[2] = inside / na
    if best > -1e29:
        out[1] = best - alone
