"""Edges of things that the empty board's picture shows, too: a plate that a DLO runs under is on it.

Such a plate is no difference to the board, and where a DLO goes under its edge obliquely the end looks like a tip.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.frames.strip import Scene

FloatArray = npt.NDArray[np.float64]

_SMOOTH_PX = 1.5
_TIMES_TYPICAL, _LEAST_SLOPE = 4.0, 2.0
"""An edge's slope, in multiples of the usual one around it, and in codes per px."""
_LENGTH_W = 1.5
_SIDE_PX = (4.0, 9.0)
_STEP_CODES = 5.0


def on_board_edge(scene: Scene, point: FloatArray, width: float) -> bool:
    """Whether a lasting step of the empty board goes through a place, (2,) image px: no printed line, no texture.

    width: of the DLO that ends there, px. False without a picture of the empty board.
    """
    if scene.background is None:
        return False
    reach = int(1.2 * width + _SIDE_PX[1])
    x, y = round(float(point[0])), round(float(point[1]))
    left, top = max(x - reach, 0), max(y - reach, 0)
    patch = scene.background[top : y + reach + 1, left : x + reach + 1]
    if min(patch.shape[:2]) < 8:
        return False
    grey = cv2.GaussianBlur(patch.mean(axis=2).astype(np.float32), (0, 0), _SMOOTH_PX)
    slope = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(grey, cv2.CV_32F, 0, 1, scale=0.125))
    strong = np.asarray(slope > max(_TIMES_TYPICAL * float(np.median(slope)), _LEAST_SLOPE), dtype=np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(strong, connectivity=8)
    for k in range(1, count):
        long = np.hypot(stats[k, cv2.CC_STAT_WIDTH], stats[k, cv2.CC_STAT_HEIGHT]) >= _LENGTH_W * width
        if long and _is_step(grey, labels == k, np.array([x - left, y - top], dtype=np.float64), width):
            return True
    return False


def _is_step(grey: npt.NDArray[np.float32], edge: npt.NDArray[np.bool_], place: FloatArray, width: float) -> bool:
    """Whether an edge passes a place within half a width, and the board differs on both sides of it."""
    ys, xs = np.nonzero(edge)
    points = np.stack([xs, ys], axis=1).astype(np.float64)
    if float(np.hypot(*(points - place).T).min()) > 0.6 * width:
        return False
    middle = points.mean(axis=0)
    across = np.linalg.svd(points - middle, full_matrices=False)[2][1]
    off = np.abs((points - middle) @ across)
    if float(np.percentile(off, 90.0)) > 0.2 * width:
        return False  # no straight edge
    height, columns = grey.shape
    levels = []
    for sign in (-1.0, 1.0):
        at = np.round(points[:, None] + sign * np.linspace(*_SIDE_PX, 4)[None, :, None] * across).astype(np.int64)
        inside = (at >= 0).all(axis=2) & (at[..., 0] < columns) & (at[..., 1] < height)
        if not inside.any():
            return False
        levels.append(float(np.median(grey[at[inside][:, 1], at[inside][:, 0]])))
    return abs(levels[1] - levels[0]) > _STEP_CODES
