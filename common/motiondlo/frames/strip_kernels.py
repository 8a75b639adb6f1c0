"""Bilinear samples of frame and board along the normals of a curve, in one pass."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
Float32Array = npt.NDArray[np.float32]
FloatArray = npt.NDArray[np.float64]


@numba.njit(cache=True, nogil=True)
def sample_pair(
    image: Image,
    board: Image,
    gain: Float32Array,
    scale: float,
    code_offset: float,
    centre: FloatArray,
    normals: FloatArray,
    offsets: FloatArray,
    out_image: Float32Array,
    out_ratio: Float32Array,
    known: npt.NDArray[np.bool_],
) -> None:
    """Fill the strip around a curve.

    image, board: (H, W, 3) uint8. gain: (h, w, 3) or (1, 1, 3) float32, factor of the frame's codes over the board's,
    at 1 / ``scale`` of the image's size; it varies slowly, and is interpolated between the first and the last column.
    centre, normals: (K, 2) image px; offsets: (V,) px. Receives out_image (K, V, 3) codes, out_ratio (K, V, 3)
    (image + code_offset) / (board * gain + code_offset), known (K, V) inside the image; outside, the border goes on.
    """
    height, width = image.shape[:2]
    gain_height, gain_width = gain.shape[:2]
    columns = len(offsets)
    left, right = np.empty(3, np.float32), np.empty(3, np.float32)
    for k in range(len(centre)):
        for side in range(2):
            offset = offsets[0] if side == 0 else offsets[columns - 1]
            x = (centre[k, 0] + offset * normals[k, 0] + 0.5) / scale - 0.5
            y = (centre[k, 1] + offset * normals[k, 1] + 0.5) / scale - 0.5
            x = min(max(x, 0.0), gain_width - 1.0)
            y = min(max(y, 0.0), gain_height - 1.0)
            x0, y0 = int(x), int(y)
            x1, y1 = min(x0 + 1, gain_width - 1), min(y0 + 1, gain_height - 1)
            u, v = x - x0, y - y0
            for c in range(3):
                value = (gain[y0, x0, c] * (1.0 - u) + gain[y0, x1, c] * u) * (1.0 - v) + (
                    gain[y1, x0, c] * (1.0 - u) + gain[y1, x1, c] * u
                ) * v
                if side == 0:
                    left[c] = value
                else:
                    right[c] = value
        for j in range(columns):
            share = np.float32(j / max(columns - 1, 1))
            px = centre[k, 0] + offsets[j] * normals[k, 0]
            py = centre[k, 1] + offsets[j] * normals[k, 1]
            known[k, j] = px >= 0.0 and py >= 0.0 and px <= width - 1.0 and py <= height - 1.0
            px = min(max(px, 0.0), width - 1.0)
            py = min(max(py, 0.0), height - 1.0)
            ix, iy = int(px), int(py)
            jx, jy = min(ix + 1, width - 1), min(iy + 1, height - 1)
            u32, v32 = np.float32(px - ix), np.float32(py - iy)
            a = (np.float32(1.0) - u32) * (np.float32(1.0) - v32)
            b = u32 * (np.float32(1.0) - v32)
            d = (np.float32(1.0) - u32) * v32
            e = u32 * v32
            for c in range(3):
                seen = a * image[iy, ix, c] + b * image[iy, jx, c] + d * image[jy, ix, c] + e * image[jy, jx, c]
                empty = a * board[iy, ix, c] + b * board[iy, jx, c] + d * board[jy, ix, c] + e * board[jy, jx, c]
                factor = left[c] + share * (right[c] - left[c])
                out_image[k, j, c] = seen
                out_ratio[k, j, c] = (seen + np.float32(code_offset)) / (empty * factor + np.float32(code_offset))
