"""Log colour of images, and how far a pixel is from the board that lies under it, lit or in shadow."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
Float32Array = npt.NDArray[np.float32]

LOG_OFFSET = 0.02
"""Added to linear light before the logarithm: bounds the noise of dark places."""


def _log_table() -> Float32Array:
    code = np.arange(256) / 255.0
    linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.log(linear + LOG_OFFSET), dtype=np.float32)


_LOG_TABLE = _log_table()


def log_colour(image_bgr: Image) -> Float32Array:
    """Natural logarithm of linear light + 0.02. (H, W, 3) uint8 sRGB -> (H, W, 3) float32."""
    return np.asarray(cv2.LUT(image_bgr, _LOG_TABLE), dtype=np.float32)


def board_distance(ratio: Float32Array, darkest_log: float, brightest_log: float) -> Float32Array:
    """Distance from the colour line of the board: every brightness that light or cast shadow can give it.

    ratio: (..., 3) float32, log colour minus the board's log colour. darkest_log, brightest_log: range of the line.
    A cast shadow is the board times a factor, the same in all channels, so it lies on the line; a DLO does not, unless
    it has the board's hue and the shadow's brightness. Returns (...) float32.
    """
    level = (ratio[..., 0] + ratio[..., 1] + ratio[..., 2]) * np.float32(1.0 / 3.0)
    chroma2 = np.zeros_like(level)
    for channel in range(3):
        off = ratio[..., channel] - level
        chroma2 += off * off
    beyond = np.maximum(level - np.float32(brightest_log), np.float32(darkest_log) - level)
    beyond = np.maximum(beyond, np.float32(0.0))
    return np.asarray(np.sqrt(chroma2 + beyond * beyond), dtype=np.float32)
