"""Kalman filter over the control nodes of a chain: prediction and sequential scalar updates.

State x (n,), n = 4 K + E: node x (K), node y (K), velocity x (K), velocity y (K), extras (E). P (n, n) covariance, kept
symmetric in full. Units: px, ms. Every update has at most a dozen non-zero entries in its row ``h``; sequential updates
then cost n^2 each, and an innovation is judged with all that was learned before it in the same batch.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

F8 = npt.NDArray[np.float64]
I8 = npt.NDArray[np.int64]
B1 = npt.NDArray[np.bool_]


@numba.njit(cache=True, nogil=True, fastmath=True)
def predict(x: F8, P: F8, K: int, dt: float, decay: float, kernel: F8, q: float) -> None:
    """Constant velocity with decay; acceleration noise ``q * kernel`` (K, K), px^2/ms^3, alike in x and y."""
    n = x.shape[0]
    m = 2 * K
    for i in range(m):
        x[i] += dt * x[m + i]
        x[m + i] *= decay
    for i in range(m):
        for j in range(n):
            P[i, j] += dt * P[m + i, j]
        for j in range(n):
            P[m + i, j] *= decay
    for i in range(n):
        for j in range(m):
            P[i, j] += dt * P[i, m + j]
        for j in range(m):
            P[i, m + j] *= decay
    c3 = q * dt * dt * dt / 3.0
    c2 = q * dt * dt / 2.0
    c1 = q * dt
    for a in range(2):
        o = a * K
        for i in range(K):
            for j in range(K):
                k = kernel[i, j]
                P[o + i, o + j] += c3 * k
                P[o + i, m + o + j] += c2 * k
                P[m + o + i, o + j] += c2 * k
                P[m + o + i, m + o + j] += c1 * k


@numba.njit(cache=True, nogil=True, fastmath=True)
def row_variance(P: F8, index: I8, h: F8, k: int) -> float:
    """h P h' of a row with ``k`` non-zero entries."""
    s = 0.0
    for a in range(k):
        for b in range(k):
            s += h[a] * h[b] * P[index[a], index[b]]
    return s


@numba.njit(cache=True, nogil=True, fastmath=True)
def update(x: F8, P: F8, index: I8, h: F8, k: int, innovation: float, R: float, Ph: F8) -> None:
    """One scalar measurement: row ``h`` at ``index`` (first ``k`` entries), its innovation and variance R."""
    n = x.shape[0]
    for i in range(n):
        Ph[i] = 0.0
    for q in range(k):
        hq = h[q]
        row = P[index[q]]
        for i in range(n):
            Ph[i] += hq * row[i]
    s = R
    for q in range(k):
        s += h[q] * Ph[index[q]]
    gain = innovation / s
    inv = 1.0 / s
    for i in range(n):
        x[i] += gain * Ph[i]
    for i in range(n):
        c = Ph[i] * inv
        row = P[i]
        for j in range(n):
            row[j] -= c * Ph[j]


@numba.njit(cache=True, nogil=True, fastmath=True)
def place(x: F8, K: int, j0: I8, w: F8, w1: F8, w2: F8, out: F8) -> None:
    """Geometry at S places: out (S, 10) = x, y, tangent x, y, velocity x, y, normal velocity, tangential velocity,
    curvature (1/px, positive to the left), stretch (px per unit of u). Left normal: (-ty, tx)."""
    for s in range(j0.shape[0]):
        px = 0.0
        py = 0.0
        dx = 0.0
        dy = 0.0
        ddx = 0.0
        ddy = 0.0
        vx = 0.0
        vy = 0.0
        for q in range(4):
            j = j0[s] + q
            px += w[s, q] * x[j]
            py += w[s, q] * x[K + j]
            dx += w1[s, q] * x[j]
            dy += w1[s, q] * x[K + j]
            ddx += w2[s, q] * x[j]
            ddy += w2[s, q] * x[K + j]
            vx += w[s, q] * x[2 * K + j]
            vy += w[s, q] * x[3 * K + j]
        length = math.sqrt(dx * dx + dy * dy) + 1e-9
        tx = dx / length
        ty = dy / length
        out[s, 0] = px
        out[s, 1] = py
        out[s, 2] = tx
        out[s, 3] = ty
        out[s, 4] = vx
        out[s, 5] = vy
        out[s, 6] = -ty * vx + tx * vy
        out[s, 7] = tx * vx + ty * vy
        out[s, 8] = (dx * ddy - dy * ddx) / (length * length * length)
        out[s, 9] = length


@numba.njit(cache=True, nogil=True, fastmath=True)
def place_covariance(P: F8, K: int, j0: I8, w: F8, out: F8, velocity: bool) -> None:
    """Covariance xx, xy, yy of position (or velocity) at S places; out (S, 3)."""
    o = 2 * K if velocity else 0
    for s in range(j0.shape[0]):
        xx = 0.0
        xy = 0.0
        yy = 0.0
        for a in range(4):
            for b in range(4):
                c = w[s, a] * w[s, b]
                i = o + j0[s] + a
                j = o + j0[s] + b
                xx += c * P[i, j]
                xy += c * P[i, j + K]
                yy += c * P[i + K, j + K]
        out[s, 0] = xx
        out[s, 1] = xy
        out[s, 2] = yy


@numba.njit(cache=True, nogil=True, fastmath=True)
def measure_normals(
    x: F8,
    P: F8,
    K: int,
    j0: I8,
    w: F8,
    geometry: F8,
    offset: F8,
    variance: F8,
    age: F8,
    use: B1,
    gate: float,
    nis: F8,
    Ph: F8,
) -> int:
    """Absorb offsets along the normals of the predicted curve, from both ends inwards; refuse those beyond the gate.

    offset, variance, age (ms, times the share that counts), use (S,); geometry as of :func:`place` before this batch.
    ``use`` is cleared where an offset was refused; nis (S,) gets the normalised innovations squared.
    """
    index = np.empty(16, np.int64)
    h = np.empty(16)
    count = 0
    S = j0.shape[0]
    for q in range(S):
        s = q // 2 if q % 2 == 0 else S - 1 - q // 2
        if not use[s]:
            continue
        nx = -geometry[s, 3]
        ny = geometry[s, 2]
        px = -geometry[s, 0]
        py = -geometry[s, 1]
        vx = -geometry[s, 4]
        vy = -geometry[s, 5]
        for a in range(4):
            j = j0[s] + a
            c = w[s, a]
            px += c * x[j]
            py += c * x[K + j]
            vx += c * x[2 * K + j]
            vy += c * x[3 * K + j]
            index[a] = j
            index[4 + a] = K + j
            index[8 + a] = 2 * K + j
            index[12 + a] = 3 * K + j
            h[a] = c * nx
            h[4 + a] = c * ny
            h[8 + a] = -age[s] * c * nx
            h[12 + a] = -age[s] * c * ny
        # Events of mean age a, moved on with the predicted velocity, show the place less a times its error.
        expected = nx * (px - age[s] * vx) + ny * (py - age[s] * vy)
        innovation = offset[s] - expected
        e = innovation * innovation / (row_variance(P, index, h, 16) + variance[s])
        nis[s] = e
        if e > gate * gate:
            use[s] = False
            continue
        update(x, P, index, h, 16, innovation, variance[s] * (1.0 + 0.25 * e), Ph)
        count += 1
    return count


@numba.njit(cache=True, nogil=True, fastmath=True)
def rest_normals(x: F8, P: F8, K: int, j0: I8, w: F8, geometry: F8, mask: B1, R: float, both: bool, Ph: F8) -> None:
    """Zero normal velocity (``both``: tangential too) where ``mask``: silence of a visible part is a measurement."""
    index = np.empty(8, np.int64)
    h = np.empty(8)
    for s in range(j0.shape[0]):
        if not mask[s]:
            continue
        for d in range(2 if both else 1):
            nx = -geometry[s, 3] if d == 0 else geometry[s, 2]
            ny = geometry[s, 2] if d == 0 else geometry[s, 3]
            v = 0.0
            for a in range(4):
                j = j0[s] + a
                index[a] = 2 * K + j
                index[4 + a] = 3 * K + j
                h[a] = w[s, a] * nx
                h[4 + a] = w[s, a] * ny
                v += h[a] * x[2 * K + j] + h[4 + a] * x[3 * K + j]
            update(x, P, index, h, 8, -v, R, Ph)


@numba.njit(cache=True, nogil=True, fastmath=True)
def keep_length(x: F8, P: F8, K: int, j0: I8, w1: F8, stretch: float, R: float, Ph: F8) -> None:
    """Soft inextensibility at S places: ``stretch`` px per unit of u, times one plus the last state.

    That state is the common scale: perspective and height change a length in pixels by up to a percent.
    """
    index = np.empty(9, np.int64)
    h = np.empty(9)
    last = x.shape[0] - 1
    index[8] = last
    h[8] = -stretch
    for s in range(j0.shape[0]):
        dx = 0.0
        dy = 0.0
        for a in range(4):
            dx += w1[s, a] * x[j0[s] + a]
            dy += w1[s, a] * x[K + j0[s] + a]
        length = math.sqrt(dx * dx + dy * dy) + 1e-9
        for a in range(4):
            index[a] = j0[s] + a
            index[4 + a] = K + j0[s] + a
            h[a] = w1[s, a] * dx / length
            h[4 + a] = w1[s, a] * dy / length
        update(x, P, index, h, 9, stretch * (1.0 + x[last]) - length, R, Ph)


@numba.njit(cache=True, nogil=True, fastmath=True)
def bends(x: F8, K: int, out: F8) -> None:
    """Second difference along the local normal at the inner control nodes; out (K,), 0 at both ends."""
    out[0] = 0.0
    out[K - 1] = 0.0
    for m in range(1, K - 1):
        dx = x[m + 1] - x[m - 1]
        dy = x[K + m + 1] - x[K + m - 1]
        length = math.sqrt(dx * dx + dy * dy) + 1e-9
        out[m] = (-dy * (x[m + 1] - 2 * x[m] + x[m - 1]) + dx * (x[K + m + 1] - 2 * x[K + m] + x[K + m - 1])) / length


@numba.njit(cache=True, nogil=True, fastmath=True)
def keep_shape(x: F8, P: F8, K: int, own: F8, R: float, Ph: F8) -> None:
    """Weak bending prior: second differences stay near the slowly adapting own shape ``own`` (K,)."""
    index = np.empty(6, np.int64)
    h = np.empty(6)
    for m in range(1, K - 1):
        dx = x[m + 1] - x[m - 1]
        dy = x[K + m + 1] - x[K + m - 1]
        length = math.sqrt(dx * dx + dy * dy) + 1e-9
        nx = -dy / length
        ny = dx / length
        k = nx * (x[m + 1] - 2 * x[m] + x[m - 1]) + ny * (x[K + m + 1] - 2 * x[K + m] + x[K + m - 1])
        index[0] = m - 1
        index[1] = m
        index[2] = m + 1
        index[3] = K + m - 1
        index[4] = K + m
        index[5] = K + m + 1
        h[0] = nx
        h[1] = -2 * nx
        h[2] = nx
        h[3] = ny
        h[4] = -2 * ny
        h[5] = ny
        update(x, P, index, h, 6, own[m] - k, R, Ph)


@numba.njit(cache=True, nogil=True, fastmath=True)
def limit_velocity_variance(P: F8, K: int, most: float) -> None:
    """Scale rows and columns so that no velocity variance exceeds ``most``: a hidden end must not go anywhere."""
    n = P.shape[0]
    for i in range(2 * K, 4 * K):
        if P[i, i] > most:
            f = math.sqrt(most / P[i, i])
            for j in range(n):
                P[i, j] *= f
            for j in range(n):
                P[j, i] *= f
