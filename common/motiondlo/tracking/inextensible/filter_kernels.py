"""The extended Kalman filter of a curve: prediction, rows of measurements, robust solution.

Legend: state ``x`` (N,) = pose ``q`` (n,), its rates (n,) per ms, and five constants of the DLO: stretch - 1, offsets
of both ends along the material (px; of a held end: of its patch, outward), height ratios of what holds either end.
``C`` (N, N) its covariance. Rows of measurements: ``z = H (x - x_predicted)`` with weight ``w = 1 / sigma^2``.
"""

from __future__ import annotations

import numba
import numpy as np

CONSTANTS = 5
STRETCH, END_A, END_B, RATIO_A, RATIO_B = 0, 1, 2, 3, 4


@numba.njit(cache=True, nogil=True, fastmath=True)
def predict(x, cov, n, dt_ms, decay, acceleration, scale, constants_q):  # type: ignore[no-untyped-def]
    """Advance state and covariance in place by ``dt_ms``.

    acceleration: (n, n) covariance of a unit acceleration field, times ``scale`` px^2/ms^3; decay: factor of the rates;
    constants_q: (5,) random-walk variances per ms.
    """
    size = x.shape[0]
    for i in range(n):
        x[i] += dt_ms * x[n + i]
        x[n + i] *= decay
    for i in range(n):
        for j in range(n):
            cov[i, j] += dt_ms * (cov[i, n + j] + cov[n + i, j]) + dt_ms * dt_ms * cov[n + i, n + j]
    for i in range(n):
        for j in range(n):
            cov[i, n + j] = (cov[i, n + j] + dt_ms * cov[n + i, n + j]) * decay
    for i in range(n):
        for j in range(2 * n, size):
            cov[i, j] += dt_ms * cov[n + i, j]
            cov[n + i, j] *= decay
            cov[j, i] = cov[i, j]
            cov[j, n + i] = cov[n + i, j]
    q3 = scale * dt_ms**3 / 3.0
    q2 = scale * dt_ms**2 / 2.0
    q1 = scale * dt_ms
    for i in range(n):
        for j in range(n):
            cov[i, j] += q3 * acceleration[i, j]
            cov[i, n + j] += q2 * acceleration[i, j]
            cov[n + i, n + j] = cov[n + i, n + j] * decay * decay + q1 * acceleration[i, j]
    for i in range(n):
        for j in range(n):
            cov[n + j, i] = cov[i, n + j]
    for k in range(CONSTANTS):
        cov[2 * n + k, 2 * n + k] += constants_q[k] * dt_ms


@numba.njit(cache=True, nogil=True, fastmath=True)
def place_stations(  # type: ignore[no-untyped-def]
    x, cov, n, points, theta, jacobian, stride, ds_px, p_out, th_out, kappa, vn, vt, omega, h_normal, h_stretch, sn, sv
):
    """Station quantities of a placed curve.

    Out: p_out (m, 2), th_out, kappa (1/px), vn, vt (px/ms), omega (rad/ms: slope of vn along the curve), h_normal
    (m, n): derivative of the normal coordinate, h_stretch (m,), sn, sv: standard deviations of normal place and rate.
    """
    m = jacobian.shape[0]
    samples = points.shape[0]
    pixel = ds_px * (1.0 + x[2 * n + STRETCH])
    for i in range(m):
        j = i * stride
        p_out[i, 0] = points[j, 0]
        p_out[i, 1] = points[j, 1]
        th_out[i] = theta[j]
        a, b = max(j - 1, 0), min(j + 1, samples - 1)
        kappa[i] = (theta[b] - theta[a]) / ((b - a) * pixel)
        tx, ty = np.cos(theta[j]), np.sin(theta[j])
        v_normal = 0.0
        v_tangent = 0.0
        for k in range(n):
            h = -ty * jacobian[i, 0, k] + tx * jacobian[i, 1, k]
            h_normal[i, k] = h
            v_normal += h * x[n + k]
            v_tangent += (tx * jacobian[i, 0, k] + ty * jacobian[i, 1, k]) * x[n + k]
        vn[i] = v_normal
        vt[i] = v_tangent
        stretch = 1.0 + x[2 * n + STRETCH]
        h_stretch[i] = (-ty * (points[j, 0] - x[0]) + tx * (points[j, 1] - x[1])) / stretch
    for i in range(m):
        a, b = max(i - 1, 0), min(i + 1, m - 1)
        # d p / d s rotates with the curve: the slope of vn along s, less what the curvature takes from vt.
        omega[i] = (vn[b] - vn[a]) / ((b - a) * stride * pixel) + kappa[i] * vt[i]
        s_pos = 0.0
        s_vel = 0.0
        for k in range(n):
            row_p = 0.0
            row_v = 0.0
            for c in range(n):
                row_p += cov[k, c] * h_normal[i, c]
                row_v += cov[n + k, n + c] * h_normal[i, c]
            s_pos += row_p * h_normal[i, k]
            s_vel += row_v * h_normal[i, k]
        sn[i] = np.sqrt(max(s_pos, 1e-6))
        sv[i] = np.sqrt(max(s_vel, 1e-8))


@numba.njit(cache=True, nogil=True, fastmath=True)
def keep_bend(n, dt_ms, x, memory, bend_sigma, rate_sigma, cov, dx, gain):  # type: ignore[no-untyped-def]
    """Second differences of the angle coefficients stay near the remembered ones, those of the rates near zero.

    One scalar update after the other, in place, on ``cov`` and on the step ``dx`` (N,) from x. gain: (N,) scratch.
    """
    size = cov.shape[0]
    for part in range(2):
        sigma = bend_sigma if part == 0 else rate_sigma
        noise = sigma * sigma / dt_ms
        for k in range(3, n - 1):
            b = part * n + k
            for j in range(size):
                gain[j] = cov[b - 1, j] - 2.0 * cov[b, j] + cov[b + 1, j]
            variance = gain[b - 1] - 2.0 * gain[b] + gain[b + 1] + noise
            now = x[b - 1] + dx[b - 1] - 2.0 * (x[b] + dx[b]) + x[b + 1] + dx[b + 1]
            share = 1.0 / variance
            step = ((memory[k] if part == 0 else 0.0) - now) * share
            for i in range(size):
                dx[i] += gain[i] * step
                scaled = gain[i] * share
                for j in range(size):
                    cov[i, j] -= scaled * gain[j]


# Without fastmath, which would take it for granted that all numbers are finite.
@numba.njit(cache=True, nogil=True)
def factor(gram, variance, out):  # type: ignore[no-untyped-def]
    """Cholesky factor (lower) of ``gram + diag(variance)`` into ``out``, all (R, R); False if it is not positive."""
    rows = gram.shape[0]
    for i in range(rows):
        for j in range(i):
            total = gram[i, j]
            for k in range(j):
                total -= out[i, k] * out[j, k]
            out[i, j] = total / out[j, j]
        total = gram[i, i] + variance[i]
        for k in range(i):
            total -= out[i, k] * out[i, k]
        if not total > 0.0:
            return False
        out[i, i] = np.sqrt(total)
    return True


@numba.njit(cache=True, nogil=True)
def solve_factored(lower, z, y):  # type: ignore[no-untyped-def]
    """y = (L L')^-1 z; all of length R."""
    rows = lower.shape[0]
    for i in range(rows):
        total = z[i]
        for k in range(i):
            total -= lower[i, k] * y[k]
        y[i] = total / lower[i, i]
    for i in range(rows - 1, -1, -1):
        y[i] /= lower[i, i]
        for k in range(i):
            y[k] -= lower[i, k] * y[i]


@numba.njit(cache=True, nogil=True)
def solve(cov, dx, h, z, w, rows, nu, passes, robust):  # type: ignore[no-untyped-def]
    """Student-t weighted update of ``cov`` (N, N) and the step ``dx`` (N,) in place from ``rows`` measurements.

    h: (R, N), z, w: (R,) relative to the state without the step, robust: (R,) uint8 1 where the weight falls with the
    residual. Returns whether the numbers held; if not, cov and dx are spoilt.
    """
    size = cov.shape[0]
    if rows > 0:
        hr = h[:rows]
        gain = hr @ cov
        gram = gain @ hr.T
        left = z[:rows] - hr @ dx
        variance = np.empty(rows)
        lower = np.empty((rows, rows))
        y = np.empty(rows)
        for turn in range(passes):
            for i in range(rows):
                v = 1.0 / w[i]
                if robust[i]:
                    # The residual of the pass before; the whole measurement before the first.
                    residual = left[i] if turn == 0 else variance[i] * y[i]
                    v *= (nu + residual * residual * w[i]) / (nu + 1.0)
                variance[i] = v
            if not factor(gram, variance, lower):
                return False
            solve_factored(lower, left, y)
        for i in range(rows):
            for j in range(size):
                dx[j] += gain[i, j] * y[i]
        # gain becomes L^-1 H C, row by row.
        for i in range(rows):
            for k in range(i):
                share = lower[i, k]
                for j in range(size):
                    gain[i, j] -= share * gain[k, j]
            share = 1.0 / lower[i, i]
            for j in range(size):
                gain[i, j] *= share
        cov -= gain.T @ gain
    sound = True
    for i in range(size):
        sound = sound and np.isfinite(dx[i]) and np.isfinite(cov[i, i]) and cov[i, i] > 0.0
        for j in range(i):
            mean = 0.5 * (cov[i, j] + cov[j, i])
            cov[i, j] = mean
            cov[j, i] = mean
    return sound
