"""Resting shapes of cables: plane curves given by their tangent angle along the arc length, and heights."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def smooth_step(x: FloatArray) -> FloatArray:
    """0 below 0, 1 above 1, smooth to the second derivative in between."""
    u = np.clip(x, 0.0, 1.0)
    return np.asarray(u**3 * (10.0 + u * (6.0 * u - 15.0)))


def angle_profile(u: FloatArray, turn_rad: float, wave_rad: float) -> FloatArray:
    """Tangent angle relative to the start, at shares ``u`` (N,) of the length: an even turn and one wave. (N,)."""
    return turn_rad * smooth_step(0.08 + 0.84 * u) + wave_rad * np.sin(2.0 * np.pi * u) ** 2 * np.sign(0.5 - u)


def loop_profile(u: FloatArray, centre: float, share: float, sign: float) -> FloatArray:
    """A full turn in a ``share`` of the length around ``centre``: the curve crosses itself. (N,)."""
    return sign * 2.0 * np.pi * smooth_step(0.16 + 0.68 * (u - centre + 0.5 * share) / share)


def curve_from_angles(start: FloatArray, angles: FloatArray, length_mm: float) -> FloatArray:
    """Vertices (N + 1, 2) of a chain of N equal segments with directions ``angles`` (N,), from ``start`` (2,)."""
    step = length_mm / len(angles)
    moves = step * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.concatenate([start[None], start[None] + np.cumsum(moves, axis=0)])


def crossings(a: FloatArray, b: FloatArray, skip: int = 0) -> list[tuple[int, int]]:
    """Pairs (i, j) of segments of polylines ``a`` (N, 2) and ``b`` (M, 2) that cross; with ``skip`` > 0 only pairs
    of one polyline with j > i + skip."""
    found = []
    da, db = np.diff(a, axis=0), np.diff(b, axis=0)
    for i in range(len(da)):
        rel = b[:-1] - a[i]
        den = da[i, 0] * db[:, 1] - da[i, 1] * db[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            s = (rel[:, 0] * db[:, 1] - rel[:, 1] * db[:, 0]) / den
            t = (rel[:, 0] * da[i, 1] - rel[:, 1] * da[i, 0]) / den
        hit = (s >= 0) & (s < 1) & (t >= 0) & (t < 1)
        found += [(i, int(j)) for j in np.flatnonzero(hit) if not skip or j > i + skip]
    return found


def bump(arc_mm: FloatArray, at_mm: float, height_mm: float, half_width_mm: float) -> FloatArray:
    """A smooth rise by ``height_mm`` around ``at_mm``, flat on top for a third of its width. (N,)."""
    x = np.abs(arc_mm - at_mm) / half_width_mm
    return height_mm * (1.0 - smooth_step((x - 0.3) / 0.7))
