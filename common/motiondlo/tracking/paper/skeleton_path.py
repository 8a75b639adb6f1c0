"""Skeleton path with progressive gap-bridging (paper, "Event Branch: Dynamic DLO").

"When sufficient connectivity is present, a skeleton path is additionally extracted via progressive gap-bridging to
obtain a more explicit geometric structure."
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d

from motiondlo.frames.thinning_kernels import thin
from motiondlo.geometry.curve import arc_length, resample
from motiondlo.tracking.paper.morphology import Mask, dilate
from motiondlo.tracking.paper.path_kernels import longest_paths

FloatArray = npt.NDArray[np.float64]

# Bridging radii, in diameters: small gaps first, so that a short bridge is not lost in a long one's blob.
_BRIDGES_DIAMETERS = (0.15, 0.35)
# Parts shorter than this are fragments.
_SHORTEST_PART_DIAMETERS = 1.5
# Staircase of the cell grid, and half the width over which a path's end direction is taken.
_SMOOTHING_CELLS = 3.0


def skeleton_paths(mask: Mask, diameter_cells: float) -> list[FloatArray]:
    """The longest path through every part of the bridged skeleton, longest first.

    mask: (h, w) uint8 0/1. Each path: (K, 2) float64 cell coordinates (column, row), smoothed, K >= 4. Thinning ends
    half a width before the mask does: both ends are carried on along their tangents to the mask's border.
    """
    skeleton = _thinned(np.pad(mask, 1))
    for bridge in _BRIDGES_DIAMETERS:
        radius = bridge * diameter_cells
        if radius >= 1.0:
            skeleton = _thinned(dilate(skeleton, radius))
    shortest = max(int(_SHORTEST_PART_DIAMETERS * diameter_cells), 4)
    cells, ends = longest_paths(skeleton, shortest)
    paths = []
    start = 0
    for end in ends:
        part = cells[start:end].astype(np.float64) - 1.0
        start = int(end)
        smooth = gaussian_filter1d(part, _SMOOTHING_CELLS, axis=0, mode="nearest")
        paths.append(_to_mask_border(smooth, mask, diameter_cells))
    return sorted(paths, key=lambda path: -arc_length(path)[-1])


def _thinned(mask: Mask) -> Mask:
    """8-connected skeleton of a mask whose outermost cells are cleared first."""
    skeleton = mask.copy()
    skeleton[[0, -1], :] = 0
    skeleton[:, [0, -1]] = 0
    ys, xs = (indices.astype(np.int32) for indices in np.nonzero(skeleton))
    thin(skeleton, ys, xs)
    return skeleton


def _to_mask_border(path: FloatArray, mask: Mask, diameter_cells: float) -> FloatArray:
    head = _tip_extension(path[::-1], mask, diameter_cells)[::-1]
    tail = _tip_extension(path, mask, diameter_cells)
    return np.concatenate([head, path, tail])


def _tip_extension(path: FloatArray, mask: Mask, diameter_cells: float) -> FloatArray:
    """Points after the path's last one, a cell apart, while they lie in the mask; at most one diameter."""
    back = min(max(int(diameter_cells), 3), len(path) - 1)
    direction = path[-1] - path[-1 - back]
    norm = float(np.hypot(*direction))
    if norm < 1e-9:
        return np.empty((0, 2))
    steps = np.arange(1.0, diameter_cells + 1.0)[:, None]
    points = path[-1] + steps * direction / norm
    column, row = np.round(points).astype(np.int64).T
    rows, columns = mask.shape
    outside = (column < 0) | (row < 0) | (column >= columns) | (row >= rows)
    hit = np.ones(len(points), np.bool_)
    hit[~outside] = mask[row[~outside], column[~outside]] == 0
    stop = int(hit.argmax()) if hit.any() else len(points)
    return np.asarray(points[:stop], dtype=np.float64)


def spread_over(paths: list[FloatArray], count: int) -> FloatArray:
    """``count`` points over all paths in proportion to their lengths, at least two on each. Returns (count', 2)."""
    lengths = np.array([arc_length(path)[-1] for path in paths])
    shares = np.maximum(np.round(count * lengths / lengths.sum()).astype(int), 2)
    return np.concatenate([resample(path, int(n)) for path, n in zip(paths, shares, strict=True)])
