"""Homographies between image planes; named ``target_from_source``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from motiondlo.errors import CalibrationError

FloatArray = npt.NDArray[np.float64]

# A plane seen by two cameras gives condition numbers up to about 1e7 in pixels; beyond this it cannot be inverted.
_MAX_CONDITION = 1e12


def checked_homography(matrix: npt.NDArray[np.generic], name: str = "homography") -> FloatArray:
    """Return ``matrix`` as (3, 3) float64, scaled so that its last element is 1.

    Raises CalibrationError when the shape is wrong, a value is not finite, or the matrix is singular.
    """
    if matrix.shape != (3, 3):
        raise CalibrationError(f"{name}: shape {matrix.shape}, expected (3, 3).", "Calibrate it again.")
    try:
        h = matrix.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise CalibrationError(f"{name}: {matrix.dtype} is no number type.", "Calibrate it again.") from error
    if not np.isfinite(h).all():
        raise CalibrationError(f"{name}: contains values that are not finite.", "Calibrate it again.")
    if abs(h[2, 2]) < 1e-12 or np.linalg.cond(h) > _MAX_CONDITION:
        raise CalibrationError(f"{name}: singular, it cannot be inverted.", "Calibrate it again.")
    return np.asarray(h / h[2, 2], dtype=np.float64)


def load_homography(path: Path) -> FloatArray:
    """Read a 3x3 homography from a ``.npy`` file. Raises CalibrationError naming the file."""
    if not path.is_file():
        raise CalibrationError(f"{path}: no such file.", "Calibrate the cell, or use --mode event, which needs none.")
    try:
        matrix = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise CalibrationError(f"{path}: not a readable .npy file ({error}).", "Calibrate it again.") from error
    if not isinstance(matrix, np.ndarray):
        raise CalibrationError(f"{path}: holds no array.", "Calibrate it again.")
    return checked_homography(matrix, str(path))


def warp_points(points: FloatArray, target_from_source: FloatArray) -> FloatArray:
    """Map points by a homography (paper, "Polyline fitting": point-level warp). (N, 2) -> (N, 2) float64."""
    h = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ target_from_source.T
    return np.asarray(h[:, :2] / h[:, 2:], dtype=np.float64)
