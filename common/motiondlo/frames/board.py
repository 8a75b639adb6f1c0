"""The empty board under a frame: from the background plate where there is one, from a wide local median otherwise."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from motiondlo.frames.colour import Float32Array, Image, board_distance, log_colour
from motiondlo.frames.params import ForegroundParams

# Gains are estimated on an image of about this width: they vary slowly.
_GAIN_WIDTH_PX = 108


@dataclass(frozen=True)
class BoardModel:
    """Board and difference at working size."""

    image_log: Float32Array
    """(h, w, 3) log colour of the shrunk frame."""
    board_log: Float32Array
    """(h, w, 3) log colour of the board, brought to the frame's exposure."""
    gain_log: Float32Array
    """(h, w, 3) or (1, 1, 3): that exposure; zero without a plate."""
    distance: Float32Array
    """(h, w) distance from the board's colour line."""
    noise: float
    """Robust standard deviation of ``distance`` on the board."""
    scale: float
    """Image pixels per working pixel."""
    from_plate: bool


def working_scale(image_width_px: int, work_width_px: int) -> int:
    """Integer factor by which an image is shrunk so that it stays at least as wide as the working width."""
    return max(1, image_width_px // work_width_px)


def shrink(image: Image, scale: int) -> Image:
    """Average over blocks of ``scale`` x ``scale`` pixels. (H, W[, 3]) -> (H // scale, W // scale[, 3])."""
    if scale == 1:
        return image
    height, width = image.shape[0] // scale * scale, image.shape[1] // scale * scale
    small = cv2.resize(image[:height, :width], (width // scale, height // scale), interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


def model_board(image_bgr: Image, background: Image | None, params: ForegroundParams) -> BoardModel:
    """Compare a frame with its empty board.

    image_bgr, background: (H, W, 3) uint8 of the same shape. A plate of another exposure or under local flicker is
    brought to the frame's light by a smooth gain.
    """
    scale = working_scale(image_bgr.shape[1], params.work_width_px)
    small = shrink(image_bgr, scale)
    image_log = log_colour(small)
    if background is not None:
        board_log = log_colour(shrink(background, scale))
        gain_log = smooth_gain(image_log - board_log, params.local_gain_limit)
        board_log = board_log + gain_log
    else:
        gain_log = np.zeros((1, 1, 3), np.float32)
        board_log = log_colour(board_without_plate(small, params))
    distance = board_distance(
        image_log - board_log, float(np.log(params.shadow_darkest)), float(np.log(params.brightest))
    )
    sample = distance[::3, ::3]
    noise = float(1.4826 * np.median(sample))
    return BoardModel(image_log, board_log, gain_log, distance, noise, float(scale), background is not None)


def smooth_gain(ratio: Float32Array, limit: float) -> Float32Array:
    """Slowly varying log gain of the frame over the plate: exposure, white balance and flicker on a part of the board.

    ratio: (h, w, 3) float32. One median per channel for the whole image, plus a wide local median of what is left,
    clipped to ``limit`` (what exceeds it is an object, not light). Returns (h, w, 3) float32, or (1, 1, 3) if the
    light is the same all over.
    """
    height, width = ratio.shape[:2]
    step = max(1, width // _GAIN_WIDTH_PX)
    coarse = ratio[step // 2 :: step, step // 2 :: step]
    whole = np.median(coarse.reshape(-1, 3), axis=0).astype(np.float32)
    if limit <= 0.0:
        return whole[None, None]
    # 8 bits over +-2 limit: the median filter works on bytes.
    level = (coarse - whole).mean(axis=2)
    code = np.clip(level / (2.0 * limit) * 127.0 + 128.0, 0, 255).astype(np.uint8)
    window = max(3, code.shape[1] // 4) | 1
    local = (cv2.medianBlur(code, window).astype(np.float32) - 128.0) / 127.0 * (2.0 * limit)
    # One code of quantisation is no light.
    local = np.where(np.abs(local) < 2.0 * limit / 127.0 * 1.5, 0.0, np.clip(local, -limit, limit)).astype(np.float32)
    if not local.any():
        return whole[None, None]
    full = cv2.resize(cv2.GaussianBlur(local, (0, 0), 2.0), (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(full[..., None] + whole, dtype=np.float32)


def board_without_plate(small: Image, params: ForegroundParams) -> Image:
    """The board as a wide local median of the frame itself, for cells without a plate.

    small: (h, w, 3) uint8. Where many DLOs lie close together they are the majority, so a second pass takes the median
    with everything that differed from the first one filled in from its surroundings. Returns (h, w, 3) uint8.
    """
    height, width = small.shape[:2]
    half = np.asarray(
        cv2.resize(small, (max(1, width // 2), max(1, height // 2)), interpolation=cv2.INTER_AREA), dtype=np.uint8
    )
    window = max(3, int(params.plate_window * half.shape[1])) | 1
    first = np.asarray(cv2.medianBlur(half, window), dtype=np.uint8)
    distance = board_distance(
        log_colour(half) - log_colour(first), float(np.log(params.shadow_darkest)), float(np.log(params.brightest))
    )
    # The margin takes soft edges and shadows along.
    covered = cv2.dilate(np.asarray(distance > 0.5 * params.threshold, dtype=np.uint8), np.ones((5, 5), np.uint8))
    filled = np.where(covered[..., None] > 0, _fill(half, covered, 0.5 * window), half).astype(np.uint8)
    median = cv2.medianBlur(filled, window)
    return np.asarray(cv2.resize(median, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def _fill(image: Image, covered: Image, sigma_px: float) -> Float32Array:
    """Weighted mean of what is not covered around each pixel, from near by where there is some, else from farther."""
    weight = (1 - covered).astype(np.float32)
    values = image.astype(np.float32) * weight[..., None]
    total = np.zeros_like(values)
    share = np.zeros_like(weight)
    for factor, importance in ((1.0, 1.0), (4.0, 0.02)):
        # Wide Gaussians are cheap on a small image.
        step = max(1, int(sigma_px * factor / 4.0))
        size = (max(1, image.shape[1] // step), max(1, image.shape[0] // step))
        kernel_sigma = sigma_px * factor / step
        for source, into in ((values, total), (weight, share)):
            coarse = cv2.GaussianBlur(cv2.resize(source, size, interpolation=cv2.INTER_AREA), (0, 0), kernel_sigma)
            np.add(into, importance * cv2.resize(coarse, image.shape[1::-1], interpolation=cv2.INTER_LINEAR), out=into)
    return np.asarray(total / np.maximum(share, 1e-6)[..., None], dtype=np.float32)
