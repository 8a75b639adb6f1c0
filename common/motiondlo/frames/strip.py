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
from motiondlo.frames.strip_kernels import sample_pair
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
    def board_bgr(self) -> Image:
        """(H, W, 3) uint8: the plate, or, without one, the board's own model at full size."""
        if self.background is not None:
            return self.background
        light = np.maximum(np.exp(self.board.board_log) - 0.02, 0.0)
        code = np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1.0 / 2.4) - 0.055) * 255.0
        full = cv2.resize(code.astype(np.float32), self.size, interpolation=cv2.INTER_LINEAR)
        return np.asarray(np.clip(full + 0.5, 0.0, 255.0), dtype=np.uint8)

    @cached_property
    def code_gain(self) -> Float32Array:
        """(h, w, 3) or (1, 1, 3): codes of the frame over those of the plate (2.2th root of light)."""
        return np.asarray(np.exp(self.board.gain_log / np.float32(2.2)), dtype=np.float32)

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
    centre: FloatArray
    """(K, 2) image px."""
    normals: FloatArray
    """(K, 2) unit vectors."""

    @property
    def places(self) -> FloatArray:
        """(K, V, 2) image px."""
        return _places(self.centre, self.normals, self.offsets)


def sample_strip(scene: Scene, centre: FloatArray, half_width_px: float, step_px: float) -> Strip:
    """Sample frame and board around a curve.

    centre: (K, 2) image px. Columns reach ``half_width_px`` to both sides in steps of ``step_px``.
    """
    count = int(np.ceil(half_width_px / step_px))
    offsets = np.asarray(np.arange(-count, count + 1) * step_px, dtype=np.float64)
    centre = np.ascontiguousarray(centre, dtype=np.float64)
    normals = np.ascontiguousarray(left_normals(tangents(centre)))
    shape = (len(centre), len(offsets))
    image, ratio = np.empty((*shape, 3), np.float32), np.empty((*shape, 3), np.float32)
    known = np.empty(shape, np.bool_)
    sample_pair(
        scene.image_bgr,
        scene.board_bgr,
        scene.code_gain,
        scene.board.scale,
        CODE_OFFSET,
        centre,
        normals,
        offsets,
        image,
        ratio,
        known,
    )
    return Strip(image, ratio, known, offsets, centre, normals)


def _places(centre: FloatArray, normals: FloatArray, offsets: FloatArray) -> FloatArray:
    return np.asarray(centre[:, None, :] + offsets[None, :, None] * normals[:, None, :], dtype=np.float64)
