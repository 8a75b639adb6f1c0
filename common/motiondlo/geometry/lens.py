"""Lens distortion of one camera in OpenCV's model, applied to points, in both directions.

The file is JSON: ``{"width": 1296, "height": 972, "camera_matrix": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]],
"distortion": [k1, k2, p1, p2, k3]}``, with 4, 5, 8, 12 or 14 coefficients, as ``cv2.calibrateCamera`` gives them.
Undistorted points are pixels of an ideal camera with the same matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from motiondlo.errors import CalibrationError

FloatArray = npt.NDArray[np.float64]

_COUNTS = (4, 5, 8, 12, 14)
_ROUNDS = 30
_EXACT_PX = 1e-6
_ROUND_TRIP_PX = 0.01
_REMEDY = "Calibrate the lens again, with pictures that show the board in every corner."

_Row = Annotated[tuple[float, ...], Field(min_length=3, max_length=3)]


class _LensFile(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)
    width: int = Field(gt=0, le=16384)
    height: int = Field(gt=0, le=16384)
    camera_matrix: Annotated[tuple[_Row, ...], Field(min_length=3, max_length=3)]
    distortion: tuple[float, ...]


@dataclass(frozen=True)
class LensModel:
    """What one camera's lens does to points."""

    camera_matrix: FloatArray
    """(3, 3)."""
    distortion: FloatArray
    """(D,) in OpenCV's order."""
    size_px: tuple[int, int]
    """Width and height of the image that it was calibrated for."""

    def distorted(self, points: FloatArray) -> FloatArray:
        """Where the real camera sees ideal points. (N, 2) px -> (N, 2) px."""
        if not len(points):
            return points.astype(np.float64)
        rays = self._rays(points)
        image, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), self.camera_matrix, self.distortion)
        return np.asarray(image, dtype=np.float64).reshape(-1, 2)

    def undistorted(self, points: FloatArray) -> FloatArray:
        """Where an ideal camera would see points of the real one. (N, 2) px -> (N, 2) px.

        OpenCV's own five rounds leave tenths of pixels in the corners of wide lenses; here the points decide.
        """
        ideal = points.astype(np.float64)
        for _ in range(_ROUNDS):
            gap = self.distorted(ideal) - points
            ideal = ideal - gap
            if not len(gap) or float(np.abs(gap).max()) < _EXACT_PX:
                break
        return ideal

    def largest_shift_px(self) -> float:
        """How far the lens moves a point of the image at most."""
        points = self._border()
        return float(np.hypot(*(self.undistorted(points) - points).T).max())

    def check(self) -> None:
        """Raises CalibrationError when the model folds inside the image: then it cannot be undone."""
        points = self._border()
        back = self.distorted(self.undistorted(points))
        with np.errstate(invalid="ignore"):
            error = np.hypot(*(back - points).T)
        if not bool((error < _ROUND_TRIP_PX).all()):
            raise CalibrationError("the distortion cannot be undone all over the image.", _REMEDY)

    def _rays(self, points: FloatArray) -> FloatArray:
        k = self.camera_matrix
        y = (points[:, 1] - k[1, 2]) / k[1, 1]
        x = (points[:, 0] - k[0, 2] - k[0, 1] * y) / k[0, 0]
        return np.stack([x, y, np.ones_like(x)], axis=1)

    def _border(self) -> FloatArray:
        """(N, 2) points of a grid from border to border."""
        x, y = np.meshgrid(np.linspace(0, self.size_px[0] - 1, 21), np.linspace(0, self.size_px[1] - 1, 15))
        return np.stack([x.ravel(), y.ravel()], axis=1)


def load_lens(path: Path) -> LensModel:
    """Read a lens file. Raises CalibrationError naming the file and what is wrong with it."""
    try:
        file = _LensFile.model_validate_json(path.read_bytes())
    except OSError as error:
        raise CalibrationError(
            f"{path}: cannot be read ({error.strerror}).", "Give a lens file that exists."
        ) from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "file"
        raise CalibrationError(f"{path}: {where}: {first['msg']}.", "Correct the lens file.") from error
    if len(file.distortion) not in _COUNTS:
        raise CalibrationError(
            f"{path}: {len(file.distortion)} distortion coefficients.", f"OpenCV's models have one of {_COUNTS}."
        )
    k = np.array(file.camera_matrix, dtype=np.float64)
    middle = k[:2, 2] / (file.width, file.height)
    if not (k[0, 0] > 0 and k[1, 1] > 0 and k[2, 2] == 1.0 and (middle > 0).all() and (middle < 1).all()):
        raise CalibrationError(f"{path}: camera_matrix is none of a camera of that size.", "Correct the lens file.")
    if abs(k[0, 1]) > 0 or k[1, 0] != 0 or (k[2, :2] != 0).any():
        raise CalibrationError(
            f"{path}: camera_matrix has skew, which OpenCV's model has not.", "Correct the lens file."
        )
    lens = LensModel(k, np.array(file.distortion, dtype=np.float64), (file.width, file.height))
    try:
        lens.check()
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error.what}", error.what_to_do) from error
    return lens
