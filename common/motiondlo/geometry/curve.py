"""Polylines in the plane: arc length, equidistant resampling, tangents and normals, distances.

Legend: ``Y`` (M, 2) nodes of a polyline, ``s`` arc length from the first node, ``t`` unit tangent,
``n = (-t_y, t_x)`` the left normal.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def arc_length(nodes: FloatArray) -> FloatArray:
    """Arc length at every node, starting at 0 (paper, "Arc-length parametrization").

    nodes: (M, 2) float64, any unit. Returns (M,) float64 in the same unit.
    """
    steps = np.hypot(np.diff(nodes[:, 0]), np.diff(nodes[:, 1]))
    return np.concatenate(([0.0], np.cumsum(steps)))


def point_at(nodes: FloatArray, s: FloatArray) -> FloatArray:
    """Points of the polyline at arc lengths ``s`` (K,), clamped to its ends. Returns (K, 2) float64."""
    knots = arc_length(nodes)
    return np.stack([np.interp(s, knots, nodes[:, 0]), np.interp(s, knots, nodes[:, 1])], axis=1)


def resample(nodes: FloatArray, count: int) -> FloatArray:
    """``count`` points at equal arc-length distances from the first to the last node. Returns (count, 2) float64."""
    knots = arc_length(nodes)
    return point_at(nodes, np.linspace(0.0, knots[-1], count))


def tangents(nodes: FloatArray) -> FloatArray:
    """Unit tangents by central differences, one-sided at the ends. (M, 2) -> (M, 2) float64."""
    t = np.empty_like(nodes)
    t[1:-1] = nodes[2:] - nodes[:-2]
    t[0] = nodes[1] - nodes[0]
    t[-1] = nodes[-1] - nodes[-2]
    return np.asarray(t / np.maximum(np.hypot(t[:, 0], t[:, 1]), 1e-12)[:, None], dtype=np.float64)


def left_normals(t: FloatArray) -> FloatArray:
    """Unit normals ``(-t_y, t_x)`` to unit tangents. (M, 2) -> (M, 2) float64."""
    return np.stack([-t[:, 1], t[:, 0]], axis=1)


def project(points: FloatArray, nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nearest place of a polyline for every point.

    points: (N, 2), nodes: (M, 2) with M >= 2. Returns (N,) distances and (N,) arc lengths of the nearest places.
    """
    a = nodes[:-1]
    d = np.diff(nodes, axis=0)
    length2 = np.maximum((d**2).sum(axis=1), 1e-18)
    rel = points[:, None, :] - a[None]
    u = np.clip((rel * d[None]).sum(axis=2) / length2[None], 0.0, 1.0)
    gap = rel - u[..., None] * d[None]
    dist = np.sqrt((gap**2).sum(axis=2))
    k = dist.argmin(axis=1)
    rows = np.arange(len(points))
    s = arc_length(nodes)
    return dist[rows, k], s[k] + u[rows, k] * np.sqrt(length2[k])


def distance_to_curve(points: FloatArray, nodes: FloatArray) -> FloatArray:
    """Distance of every point to the polyline (paper, point-to-curve distance). (N, 2), (M, 2) -> (N,) float64."""
    return project(points, nodes)[0]
