"""Tangential measurements from the patches of a DLO's texture, all in one call."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from motiondlo.tracking.chain.filter_kernels import place, row_variance, update
from motiondlo.tracking.chain.patch_kernels import collect, match, newest

F8 = npt.NDArray[np.float64]
F4 = npt.NDArray[np.float32]
I8 = npt.NDArray[np.int64]

_REACH = 8
_SIDE = 2


@numba.njit(cache=True, nogil=True, fastmath=True)
def measure_texture(
    last: npt.NDArray[Any],
    t_us: int,
    dt_ms: float,
    latency_ms: float,
    window_px: float,
    window_max: float,
    x: F8,
    P: F8,
    K: int,
    j0: I8,
    w: F8,
    w1: F8,
    w2: F8,
    tables: F4,
    pad: int,
    half_length: float,
    half_width: float,
    sigma_px: float,
    Ph: F8,
    ev_a: F8,
    ev_d: F8,
    ev_p: I8,
    ev_age: F8,
    score: F4,
    out: F8,
    shifts: F8,
) -> int:
    """Match every patch in view that moves, and absorb its shift along the tangent; returns how many were absorbed.

    j0 .. w2: places of the N patches. tables (N, directions, 2, A, D). shifts (N,): measured shifts, NaN without one.
    """
    H = last.shape[1]
    W = last.shape[2]
    N, directions = tables.shape[0], tables.shape[1]
    g = np.empty((N, 10))
    index = np.empty(8, np.int64)
    h = np.empty(8)
    box = np.array([-half_length, half_length, half_width])
    point = np.empty(2)
    tangent = np.empty(2)
    normal = np.empty(2)
    velocity = np.empty(2)
    used = 0
    rim = half_length + 4.0
    for i in range(N):
        shifts[i] = np.nan
        place(x, K, j0[i : i + 1], w[i : i + 1], w1[i : i + 1], w2[i : i + 1], g[i : i + 1])
        speed = math.sqrt(g[i, 4] * g[i, 4] + g[i, 5] * g[i, 5])
        if speed < 0.3 or g[i, 0] < rim or g[i, 1] < rim or g[i, 0] > W - rim or g[i, 1] > H - rim:
            continue
        for c in range(2):
            point[c] = g[i, c]
            tangent[c] = g[i, 2 + c]
            velocity[c] = g[i, 4 + c]
        normal[0] = -tangent[1]
        normal[1] = tangent[0]
        turn = 0.0
        for q in range(4):
            j = 2 * K + j0[i] + q
            turn += w1[i, q] * (normal[0] * x[j] + normal[1] * x[K + j])
        window = min(max(window_px / speed, 1.0), window_max)
        n = collect(
            last,
            t_us,
            window,
            latency_ms,
            point,
            tangent,
            normal,
            velocity,
            turn / g[i, 9],
            box,
            ev_a,
            ev_d,
            ev_p,
            ev_age,
        )
        if n < 40:
            continue
        n = newest(ev_a, ev_d, ev_p, ev_age, n, window, 250, 1.0)
        angle = math.atan2(
            velocity[0] * normal[0] + velocity[1] * normal[1], velocity[0] * tangent[0] + velocity[1] * tangent[1]
        )
        k = math.floor(angle / (2.0 * math.pi) * directions + 0.5) % directions
        if speed < 1.2:
            # At onset the motion along the DLO is hardly known: try all directions.
            best = 0.0
            for d in range(directions):
                match(tables[i, d], pad, -half_length, half_width, ev_a, ev_d, ev_p, n, 80, _REACH, _SIDE, score, out)
                if out[4] > best:
                    best = out[4]
                    k = d
        match(tables[i, k], pad, -half_length, half_width, ev_a, ev_d, ev_p, n, 200, _REACH, _SIDE, score, out)
        if out[2] <= 0.0 or out[4] < 0.12 or out[5] < 5.0 or abs(out[0]) > _REACH - 1.5:
            continue
        age = 0.0
        for e in range(n):
            age += ev_age[e]
        age /= n
        for q in range(4):
            index[q] = j0[i] + q
            index[4 + q] = K + j0[i] + q
            h[q] = w[i, q] * tangent[0]
            h[4 + q] = w[i, q] * tangent[1]
        z = out[0]
        R = (sigma_px * sigma_px + 2.0 * out[2] * out[2] + (0.15 * age) ** 2) * max(1.0, 2.0 * age / dt_ms)
        nis = z * z / (row_variance(P, index, h, 8) + R)
        if nis > 25.0:
            continue
        update(x, P, index, h, 8, z, R * (1.0 + 0.25 * nis), Ph)
        shifts[i] = z
        used += 1
    return used
