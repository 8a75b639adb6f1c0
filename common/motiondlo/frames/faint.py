"""Second look for DLOs of the board's own colour: grey on grey, white on paper, black on black.

Such a DLO lies on the board's colour line, where cast shadows are, so the first look leaves it out. It shows by its
shading: one flank brighter than the other, between two sharp edges. A cast shadow is darkest in its middle and the
same to both sides; that, and the first look's DLOs with their shadows, is what has to be kept out.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.frames.board import BoardModel
from motiondlo.frames.classical import cut_wide, remove_thin
from motiondlo.frames.colour import board_distance
from motiondlo.frames.edges import RefinedCurve
from motiondlo.frames.mask_cleaning import close
from motiondlo.frames.masks import Mask
from motiondlo.frames.params import FaintParams, ForegroundParams
from motiondlo.frames.strip import Scene, sample_strip
from motiondlo.geometry.curve import arc_length, point_at

FloatArray = npt.NDArray[np.float64]


def faint_mask(board: BoardModel, taken: Mask, params: FaintParams, foreground: ForegroundParams) -> Mask:
    """What differs from the board at all, shadows included, away from what was found already.

    taken: (h, w) uint8 0/1, the first look's DLOs and obstacles. Returns (h, w) uint8 0/1 at working size.
    """
    width = taken.shape[1]
    low = max(params.threshold, params.noise_factor * board.noise)
    distance = board_distance(board.image_log - board.board_log, -params.level, params.level)
    mask = np.asarray(cv2.GaussianBlur(distance, (0, 0), 1.0) > low, dtype=np.uint8)
    reach = int(params.margin * width)
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    mask = np.asarray(mask & (1 - cv2.dilate(taken, disk)), dtype=np.uint8)
    mask = close(mask, params.closing_radius * width)
    mask = remove_thin(mask, 0.7 * foreground.min_width * width)
    return cut_wide(mask, foreground.max_width * foreground.wide_factor * width)[0]


def is_body(scene: Scene, curve: RefinedCurve, params: FaintParams) -> bool:
    """Whether a faint piece is a DLO and no shadow or stain: sharp edges all along, and shaded to one side."""
    if curve.edge_support < params.min_edge_support:
        return False
    if curve.width_spread > params.max_width_spread * curve.width:
        return False
    if curve.edge_blur > params.max_edge_blur_px:
        return False
    return shading(scene, curve.centre, curve.width) >= params.min_shading


def shading(scene: Scene, centre: FloatArray, width: float) -> float:
    """How much brighter one flank is than the other, relative to the board, whatever way the curve runs.

    The light comes from one direction, so the brighter flank changes side along a bent DLO: the median of the absolute
    differences over stretches of two widths.
    """
    length = float(arc_length(centre)[-1])
    s = np.arange(0.0, length, 2.0)
    strip = sample_strip(scene, point_at(centre, s), 0.5 * width, 0.5)
    level = strip.ratio.mean(axis=2)
    left = level[:, (strip.offsets > 0.12 * width) & (strip.offsets < 0.42 * width)].mean(axis=1)
    right = level[:, (strip.offsets < -0.12 * width) & (strip.offsets > -0.42 * width)].mean(axis=1)
    window = max(int(width), 4)
    smooth = np.convolve(left - right, np.ones(window) / window, mode="same")
    return float(np.median(np.abs(smooth)))
