"""The inextensible curve and its derivatives.

Legend: ``c`` coefficients of the tangent angle ``theta(s) = B(s) c``; ``a`` (2,) the anchor, a point of the curve near
its middle; ``stretch`` pixels per material pixel; ``p(s) = a + stretch * integral from s_a to s of (cos, sin) theta``.
A pose ``q`` (n,) is ``(a_x, a_y, c_0 .. c_K-1)``. The curve is sampled every ``ds_px`` of material; every
``stride``-th sample is a station.
"""

from __future__ import annotations

import numba
import numpy as np

ANGLE_FLOOR = 1.0
"""Inverse variance of angle coefficients, 1/rad^2: no field of places may leave them free."""


@numba.njit(cache=True, nogil=True, fastmath=True)
def place_curve(q, stretch, basis, ds_px, anchor, stride, theta, points, jacobian):  # type: ignore[no-untyped-def]
    """Sample the curve and differentiate it at the stations.

    q: (n,) float64 pose, basis: (S, K) float64, anchor: index of the sample that is the anchor (a station).
    Out: theta (S,) rad, points (S, 2) px, jacobian (m, 2, n): d p / d q at the stations, m = (S - 1) / stride + 1.
    """
    samples, k_count = basis.shape
    for i in range(samples):
        angle = 0.0
        for k in range(k_count):
            angle += basis[i, k] * q[2 + k]
        theta[i] = angle
    points[anchor, 0] = q[0]
    points[anchor, 1] = q[1]
    m0 = anchor // stride
    jacobian[m0, :, :] = 0.0
    jacobian[m0, 0, 0] = 1.0
    jacobian[m0, 1, 1] = 1.0
    jx = np.zeros(k_count)
    jy = np.zeros(k_count)
    for direction in (1, -1):
        jx[:] = 0.0
        jy[:] = 0.0
        i = anchor
        half = 0.5 * stretch * ds_px * direction
        while 0 <= i + direction < samples:
            j = i + direction
            c0, s0, c1, s1 = np.cos(theta[i]), np.sin(theta[i]), np.cos(theta[j]), np.sin(theta[j])
            points[j, 0] = points[i, 0] + half * (c0 + c1)
            points[j, 1] = points[i, 1] + half * (s0 + s1)
            for k in range(k_count):
                jx[k] -= half * (s0 * basis[i, k] + s1 * basis[j, k])
                jy[k] += half * (c0 * basis[i, k] + c1 * basis[j, k])
            if j % stride == 0:
                m = j // stride
                jacobian[m, 0, 0] = 1.0
                jacobian[m, 0, 1] = 0.0
                jacobian[m, 1, 0] = 0.0
                jacobian[m, 1, 1] = 1.0
                for k in range(k_count):
                    jacobian[m, 0, 2 + k] = jx[k]
                    jacobian[m, 1, 2 + k] = jy[k]
            i = j


@numba.njit(cache=True, nogil=True, fastmath=True)
def acceleration_covariance(jacobian, nodes, precision, floor, out):  # type: ignore[no-untyped-def]
    """Covariance of the pose's acceleration when the nodes accelerate like a smooth random field.

    jacobian: (m, 2, n); nodes: (g,) int64 stations; precision: (g, g) inverse covariance of the field at the nodes
    (each coordinate on its own). Conditioning the field on constant length gives
    ``(sum_xy J' precision J + floor)^-1``, the floor for the angles only. out: (n, n).
    """
    n = jacobian.shape[2]
    g = nodes.shape[0]
    a = np.zeros((n, n))
    jn = np.empty((g, n))
    for c in range(2):
        for i in range(g):
            for k in range(n):
                jn[i, k] = jacobian[nodes[i], c, k]
        a += jn.T @ (precision @ jn)
    for k in range(2, n):
        a[k, k] += floor
    out[:, :] = np.linalg.inv(a)
