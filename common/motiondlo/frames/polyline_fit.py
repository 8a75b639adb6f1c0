"""From an ordered point sequence to M equidistant nodes, and the DLO's diameter (paper, "Polyline fitting")."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.interpolate import make_lsq_spline
from scipy.signal import savgol_filter

from motiondlo.geometry.curve import arc_length, resample

FloatArray = npt.NDArray[np.float64]


def smooth_path(path: FloatArray, window_px: float, order: int) -> FloatArray:
    """Savitzky-Golay filter on each axis: takes the pixel grid's staircase away without moving the curve (paper).

    path: (K, 2) px, resampled to steps of one px first. Paths shorter than the window are only resampled. The two end
    points are kept. Returns (K', 2).
    """
    even = resample(path, max(2, round(float(arc_length(path)[-1])) + 1))
    window = int(window_px) | 1
    if window <= order + 1 or len(even) <= window:
        return even
    smooth = savgol_filter(even, window, order, axis=0, mode="interp")
    smooth[0], smooth[-1] = even[0], even[-1]
    return np.asarray(smooth, dtype=np.float64)


def fit_spline(path: FloatArray, knot_spacing_px: float, count: int, weights: FloatArray | None = None) -> FloatArray:
    """Cubic B-spline over normalised chord length u_i, read at ``count`` equidistant nodes (paper).

    path: (K, 2) px; weights: (K,) or None. Least squares with knots about ``knot_spacing_px`` apart. Returns (count,
    2).
    """
    s = arc_length(path)
    keep = np.concatenate(([True], np.diff(s) > 1e-9))
    path, s = path[keep], s[keep]
    if weights is not None:
        weights = weights[keep]
    if len(path) < 8 or s[-1] <= 0.0:
        return resample(path, count)
    u = s / s[-1]
    spans = int(np.clip(s[-1] / knot_spacing_px, 1, len(path) // 3))
    knots = np.concatenate(([0.0] * 4, np.linspace(0.0, 1.0, spans + 1)[1:-1], [1.0] * 4))
    spline = make_lsq_spline(u, path, knots, k=3, w=weights)
    dense = np.asarray(spline(np.linspace(0.0, 1.0, max(4 * count, len(path)))), dtype=np.float64)
    return resample(dense, count)


def diameter_from_distance(distance: npt.NDArray[np.float32], mask: npt.NDArray[np.uint8]) -> float:
    """d_seg: twice the 75th percentile of the distance transform inside the mask (paper). px; 0 for an empty mask."""
    inside = distance[mask > 0]
    return float(2.0 * np.percentile(inside, 75.0)) if len(inside) else 0.0
