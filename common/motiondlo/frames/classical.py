"""Weight-free segmenter: what differs from the empty board, is no cast shadow, and is about as wide as a cable."""

from __future__ import annotations

import cv2
import numpy as np

from motiondlo.frames.board import BoardModel, model_board
from motiondlo.frames.colour import Image
from motiondlo.frames.masks import Mask, MaskSet, ScoredMask
from motiondlo.frames.params import ForegroundParams


class ClassicalBackend:
    """The embedded default: no weights, no accelerator, about 50 ms an image on one core."""

    def __init__(self, params: ForegroundParams) -> None:
        self._params = params

    @property
    def name(self) -> str:
        """``classical``."""
        return "classical"

    def segment(self, image_bgr: Image, background: Image | None, frame_name: str) -> MaskSet:
        """One foreground mask with all DLOs at working size, and the wide things that may hold or hide them."""
        return segment_board(model_board(image_bgr, background, self._params), self._params)


def segment_board(board: BoardModel, params: ForegroundParams) -> MaskSet:
    """Foreground of a board comparison, split into cable-wide parts and obstacles."""
    foreground = hysteresis_mask(board, params)
    width = foreground.shape[1]
    # A mask may be narrower than the DLO by its soft edges.
    foreground = remove_thin(foreground, 0.7 * params.min_width * width)
    cables, obstacles = cut_wide(foreground, params.max_width * params.wide_factor * width)
    if not cables.any():
        return MaskSet((), obstacles)
    return MaskSet((ScoredMask(cables, 1.0),), obstacles)


def hysteresis_mask(board: BoardModel, params: ForegroundParams) -> Mask:
    """Pixels off the board's colour line, in pieces that reach the higher threshold somewhere. (h, w) uint8 0/1."""
    low = max(params.threshold, params.noise_factor * board.noise)
    weak = np.asarray(board.distance > low, dtype=np.uint8)
    strong = board.distance > params.hysteresis * low
    count, labels = cv2.connectedComponents(weak, connectivity=8)
    keep = np.zeros(count, np.uint8)
    keep[np.unique(labels[strong])] = 1
    keep[0] = 0
    return np.asarray(keep[labels], dtype=np.uint8)


def remove_thin(mask: Mask, min_width_px: float) -> Mask:
    """Opening with a disk: printed lines, letters and noise narrower than the narrowest DLO go."""
    radius = int(0.5 * min_width_px)
    if radius < 1:
        return mask
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, disk), dtype=np.uint8)


def cut_wide(mask: Mask, max_width_px: float) -> tuple[Mask, Mask]:
    """Separate what is wider than any cable (grippers, labels, plates) by an opening through two distance transforms.

    Returns the rest, and the wide parts, both (h, w) uint8 0/1. Holes are closed first: a gripper's bolts and slots
    would make it look like a bundle of narrow things.
    """
    radius = 0.5 * max_width_px
    solid = fill_holes(mask, max_area_px=(0.35 * max_width_px) ** 2)
    # Replicated border: a wide thing that leaves the image stays wide there.
    pad = int(radius) + 2
    padded = cv2.copyMakeBorder(solid, pad, pad, pad, pad, cv2.BORDER_REPLICATE)
    inner = cv2.distanceTransform(padded, cv2.DIST_L2, 3)
    core = np.asarray(inner > radius, dtype=np.uint8)
    if not core.any():
        return mask, np.zeros_like(mask)
    near = cv2.distanceTransform(1 - core, cv2.DIST_L2, 3) <= radius + 1.5
    wide = near[pad:-pad, pad:-pad]
    obstacles = np.asarray(solid & wide, dtype=np.uint8)
    return np.asarray(mask & ~wide, dtype=np.uint8), obstacles


def fill_holes(mask: Mask, max_area_px: float) -> Mask:
    """Fill background pieces up to ``max_area_px`` pixels that do not touch the image border. (h, w) uint8 0/1."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(1 - mask, connectivity=4)
    height, width = mask.shape
    fill = np.zeros(count, np.uint8)
    for k in range(1, count):
        x, y, w, h, area = stats[k]
        inside = x > 0 and y > 0 and x + w < width and y + h < height
        fill[k] = inside and area <= max_area_px
    fill[0] = 0
    return np.asarray(mask | fill[labels], dtype=np.uint8)
