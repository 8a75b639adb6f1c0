"""The chain's curve: a uniform cubic B-spline over its control nodes.

Legend: ``C`` (K, 2) control nodes, ``u`` in [0, K - 3] the material coordinate in node distances, ``w`` (S, 4) weights
of the control nodes ``j0 .. j0 + 3`` of a place. Uniform knots: a chain is lengthened by appending nodes, nothing else
changes.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motiondlo.geometry.curve import point_at

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


def weights(u: FloatArray, nodes: int) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """First control node (S,), weights (S, 4), their first and second derivatives by u, at places ``u`` (S,)."""
    j0 = np.clip(np.floor(u).astype(np.int64), 0, nodes - 4)
    f = u - j0
    w = np.stack([(1 - f) ** 3, 3 * f**3 - 6 * f**2 + 4, -3 * f**3 + 3 * f**2 + 3 * f + 1, f**3], axis=1) / 6.0
    w1 = np.stack([-((1 - f) ** 2), 3 * f**2 - 4 * f, -3 * f**2 + 2 * f + 1, f**2], axis=1) / 2.0
    w2 = np.stack([1 - f, 3 * f - 2, -3 * f + 1, f], axis=1)
    return j0, np.ascontiguousarray(w), np.ascontiguousarray(w1), np.ascontiguousarray(w2)


def design(u: FloatArray, nodes: int) -> FloatArray:
    """(S, K) matrix that maps control nodes to points at ``u``."""
    j0, w, _, _ = weights(u, nodes)
    matrix = np.zeros((len(u), nodes))
    rows = np.arange(len(u))
    for k in range(4):
        matrix[rows, j0 + k] = w[:, k]
    return matrix


def fit(polyline: FloatArray, length: float, nodes: int) -> FloatArray:
    """Control nodes (K, 2) of the spline nearest to a polyline of the given arc length, at equal arc distances."""
    samples = max(4 * nodes, 80)
    u = np.linspace(0.0, nodes - 3.0, samples)
    target = point_at(polyline, np.linspace(0.0, length, samples))
    second = np.diff(np.eye(nodes), 2, axis=0)
    # A weak pull towards even curvature keeps the outermost nodes, which few samples see, in line.
    left = np.vstack([design(u, nodes), 0.05 * np.diff(second, axis=0)])
    right = np.vstack([target, np.zeros((nodes - 3, 2))])
    return np.asarray(np.linalg.lstsq(left, right, rcond=None)[0], dtype=np.float64)
