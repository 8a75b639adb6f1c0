"""Another look for wires: DLOs too narrow for the first one, which leaves all out that printed lines and letters are.

Against the empty board's picture lines and letters cancel, so whatever is a ridge in the *difference* lies on it: a
strip that differs from both of its sides, a few pixels wide. The difference to both sides, not to the board, is what
counts; a wire of the colour that its own shadow has still is a strip, and light that changes slowly is none. Without
that picture nothing tells a wire from a line on the board, and this look finds nothing.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from motiondlo.frames.board import BoardModel
from motiondlo.frames.classical import cut_wide
from motiondlo.frames.colour import Float32Array, board_distance
from motiondlo.frames.edges import RefinedCurve
from motiondlo.frames.masks import Mask
from motiondlo.frames.params import ForegroundParams, ThinParams
from motiondlo.frames.strip import Scene, sample_strip
from motiondlo.frames.traversal import Chain
from motiondlo.geometry.curve import left_normals, tangents

FloatArray = npt.NDArray[np.float64]

_INNER_PX, _OUTER_PX = 0.8, 4.0
"""Scales, working px: of a wire, and of what is beside it."""
_AROUND_PX = 13
"""Reach of the weaker lines of the other sign to both sides of a strong strip, working px."""
_BRIGHTER_LOG = 0.05
_BESIDE_W, _BESIDE_PX, _BESIDE_ROWS = (0.8, 1.8), 2.0, 9
_SIDE_PX, _STEP_SHARE = 4.0, 1.4
_WIDE = 1.4
"""In multiples of the narrowest DLO of the first look: what is wider has edges that are no wires."""


def ridge_strength(board: BoardModel) -> Float32Array:
    """Log contrast of a strip with both of its sides. (h, w) float32 at working size."""
    ratio = board.image_log - board.board_log
    inner = cv2.GaussianBlur(ratio, (0, 0), _INNER_PX)
    inner -= cv2.GaussianBlur(ratio, (0, 0), _OUTER_PX)
    np.multiply(inner, inner, out=inner)
    return np.asarray(np.sqrt((inner[..., 0] + inner[..., 1] + inner[..., 2]) * np.float32(1.0 / 3.0)), np.float32)


def is_strip(board: BoardModel, chain: Chain) -> bool:
    """Whether a chain differs from both of its sides alike: the rim of a shadow, a step, differs from one of them."""
    path = chain.path[::2]
    if len(path) < 4:
        return False
    across = left_normals(tangents(gaussian_filter1d(path, 2.0, axis=0, mode="nearest")))
    height, width = board.distance.shape
    colours = []
    for offset in (-_SIDE_PX, 0.0, _SIDE_PX):
        at = np.round(path + offset * across).astype(np.int64)
        rows, columns = np.clip(at[:, 1], 0, height - 1), np.clip(at[:, 0], 0, width - 1)
        colours.append(board.image_log[rows, columns] - board.board_log[rows, columns])
    left, middle, right = colours
    ridge = np.linalg.norm(middle - 0.5 * (left + right), axis=1)
    return float(np.median(np.linalg.norm(left - right, axis=1))) < _STEP_SHARE * float(np.median(ridge))


def thin_mask(board: BoardModel, taken: Mask, params: ThinParams, foreground: ForegroundParams) -> Mask:
    """Strips away from what was found already. taken: (h, w) uint8 0/1. Returns (h, w) uint8 0/1 at working size."""
    if not board.from_plate:
        return np.zeros_like(taken)
    width = taken.shape[1]
    strength = ridge_strength(board)
    low = max(params.threshold, params.noise_factor * 1.4826 * float(np.median(strength[::3, ::3])))
    crest = cv2.dilate(strength, np.ones((_AROUND_PX, _AROUND_PX), np.uint8))
    mask = np.asarray((strength > low) & (strength > params.flank * crest), dtype=np.uint8)
    # Whatever is no shadow, however little it differs.
    off = board_distance(board.image_log - board.board_log, float(np.log(foreground.shadow_darkest)), _BRIGHTER_LOG)
    wide = cut_wide(np.asarray(off > low, dtype=np.uint8), _WIDE * foreground.min_width * width)[1]
    reach = max(1, int(params.margin * width))
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    mask[cv2.dilate(taken | wide, disk) > 0] = 0
    return _long_pieces(mask, params.min_piece * width)


def beside_limit(board: BoardModel, params: ThinParams) -> float:
    """Log difference that a wire's better side has at most: a fixed one, or multiples of the board's own."""
    level = cv2.blur((board.image_log - board.board_log)[::2, ::2].mean(axis=2), (3, 3))
    return max(params.max_beside, params.beside_noise_factor * 1.4826 * float(np.median(np.abs(level))))


def is_wire(scene: Scene, curve: RefinedCurve, params: ThinParams, most_beside: float) -> bool:
    """Whether a strip is a wire: two edges all along, one width, and the empty board at least on one side of it.

    most_beside: from ``beside_limit``.
    """
    if curve.edge_support < params.min_edge_support or curve.width_spread > params.max_width_spread * curve.width:
        return False
    return beside(scene, curve.centre, curve.width) <= most_beside


def beside(scene: Scene, centre: FloatArray, width: float) -> float:
    """Log difference from the empty board beside a strip, of the side that differs less: upper quartile along it.

    A groove in a gripper of the board's colour is a strip too, but what it lies in is not the board: its texture is
    another one. A wire's own shadow falls to one side.
    """
    reach = _BESIDE_W[1] * width + _BESIDE_PX
    strip = sample_strip(scene, centre, reach, 1.0)
    level = 2.2 * np.log(np.maximum(strip.ratio.mean(axis=2), 1e-3))
    sides = []
    for sign in (-1.0, 1.0):
        away = sign * strip.offsets
        part = (away > _BESIDE_W[0] * width + _BESIDE_PX) & (away < reach)
        sides.append(np.abs(uniform_filter1d(level[:, part].mean(axis=1), _BESIDE_ROWS)))
    return float(np.percentile(np.minimum(*sides), 75.0))


def _long_pieces(mask: Mask, least_px: float) -> Mask:
    """Drop components whose bounding box is short: noise, dirt, what is left of a gripper's parts."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    spans: npt.NDArray[np.float64] = np.hypot(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT])
    keep = np.asarray(spans >= least_px, dtype=np.uint8)
    keep[0] = 0
    return np.asarray(keep[labels] if count > 1 else mask, dtype=np.uint8)
