"""The image in a curve's own coordinates: rows along the arc, columns along the normal ("straightened strip")."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.frames.board import BoardModel
from motiondlo.frames.colour import Float32Array, Image
from motiondlo.frames.covers import Cover
from motiondlo.geometry.curve import left_normals, tangents

FloatArray = npt.NDArray[np.float64]

CODE_OFFSET = 8.0
"""Added to both codes of a ratio: bounds its noise in the dark."""


@dataclass(frozen=True)
class Scene:
    """Frame and board at full resolution, for sampling."""

    image_bgr: Image
    background: Image | None
    board: BoardModel
    wide: Cover | None = None
    """What is wider than any DLO: grippers, plates, knots of several DLOs."""

    @cached_property
    def image_float(self) -> Float32Array:
        """(H, W, 3) float32: strips overlap, so converting once is cheaper than per strip."""
        return self.image_bgr.astype(np.float32)

    @cached_property
    def background_float(self) -> Float32Array | None:
        """(H, W, 3) float32, or None without a plate."""
        return None if self.background is None else self.background.astype(np.float32)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.image_bgr.shape[1], self.image_bgr.shape[0]


@dataclass(frozen=True)
class Strip:
    """Samples along a curve."""

    image: Float32Array
    """(K, V, 3) image codes 0..255."""
    ratio: Float32Array
    """(K, V, 3) image over board, 1 on the empty board: what is printed on the board cancels."""
    known: npt.NDArray[np.bool_]
    """(K, V) inside the image."""
    offsets: FloatArray
    """(V,) signed distance from the curve along the left normal, px."""
    places: FloatArray
    """(K, V, 2) image px."""


def sample_strip(scene: Scene, centre: FloatArray, half_width_px: float, step_px: float) -> Strip:
    """Sample frame and board around a curve.

    centre: (K, 2) image px. Columns reach ``half_width_px`` to both sides in steps of ``step_px``.
    """
    count = int(np.ceil(half_width_px / step_px))
    offsets = np.asarray(np.arange(-count, count + 1) * step_px, dtype=np.float64)
    normals = left_normals(tangents(centre))
    places = centre[:, None, :] + offsets[None, :, None] * normals[:, None, :]
    width, height = scene.size
    map_x, map_y = places[..., 0].astype(np.float32), places[..., 1].astype(np.float32)
    known = (map_x >= 0) & (map_y >= 0) & (map_x <= width - 1) & (map_y <= height - 1)
    image = _remap(scene.image_float, map_x, map_y)
    if scene.background_float is not None:
        board = _remap(scene.background_float, map_x, map_y)
        gain = scene.board.gain_log
        if gain.shape[0] == 1:
            gain_at = np.broadcast_to(gain, board.shape)
        else:
            gain_at = _at_working_size(gain, map_x, map_y, scene.board.scale)
        # Codes grow with about the 2.2th root of light.
        board = np.asarray(board * np.exp(gain_at / np.float32(2.2)), dtype=np.float32)
    else:
        light = np.maximum(np.exp(_at_working_size(scene.board.board_log, map_x, map_y, scene.board.scale)) - 0.02, 0.0)
        code = np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1.0 / 2.4) - 0.055) * 255.0
        board = np.asarray(code, dtype=np.float32)
    ratio = (image + np.float32(CODE_OFFSET)) / (board + np.float32(CODE_OFFSET))
    return Strip(image, np.asarray(ratio, dtype=np.float32), known, offsets, places)


def _remap(image: Float32Array, map_x: Float32Array, map_y: Float32Array) -> Float32Array:
    sampled = cv2.remap(image, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(sampled, dtype=np.float32)


def _at_working_size(values: Float32Array, map_x: Float32Array, map_y: Float32Array, scale: float) -> Float32Array:
    """Samples of an array at working size; pixel centres are integers at both sizes."""
    small_x = (map_x + np.float32(0.5)) / np.float32(scale) - np.float32(0.5)
    small_y = (map_y + np.float32(0.5)) / np.float32(scale) - np.float32(0.5)
    sampled = cv2.remap(values, small_x, small_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(sampled, dtype=np.float32)
