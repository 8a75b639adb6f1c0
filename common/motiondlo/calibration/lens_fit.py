"""The lens of one camera from views of a flat board, by OpenCV's calibration; what cannot tell a lens is refused.

Views that do not fit the others are left out, a third radial coefficient is kept only where the pictures tell it, and
the error is also measured on views that were held back: residuals alone flatter a model with many coefficients.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.calibration.lens_views import BoardView, BoardViews
from motiondlo.errors import CalibrationError
from motiondlo.geometry.lens import LensModel

FloatArray = npt.NDArray[np.float64]

_LEAST_VIEWS = 4
_HELD_OUT_FROM, _HELD_OUT_EVERY = 8, 4
_WRONG_VIEW, _LEAST_WRONG_PX = 3.0, 0.5
_SIGNIFICANT = 3.0
_CELLS = (8, 6)
_LEAST_COVERED, _FINE_COVERED = 0.3, 0.6
_LEAST_TILT_RAD, _FINE_TILT_RAD = np.radians(6.0), np.radians(20.0)
_UNSURE_FOCAL, _LARGEST_RMS_PX, _FINE_RMS_PX = 0.02, 3.0, 0.8


@dataclass(frozen=True)
class LensReport:
    """Figures for a person; distances in px."""

    pictures: int
    views: int
    """Of them with the board, and in agreement."""
    left_out: tuple[str, ...]
    """Names of views that do not fit the others."""
    corners: int
    rms_px: float
    p95_px: float
    held_out_px: float | None
    """Root mean square on views that the fit has not seen; None with few views."""
    focal_px: tuple[float, float]
    focal_sigma_px: float
    covered_share: float
    tilt_deg: float
    """Largest angle between two views of the board."""
    largest_shift_px: float
    """How far the lens moves a point of the image at most."""
    warnings: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


@dataclass(frozen=True)
class LensFit:
    """A lens, and how well it explains the views."""

    lens: LensModel
    used: tuple[BoardView, ...]
    residuals_px: tuple[FloatArray, ...]
    """Per used view (K, 2), seen less modelled."""


@dataclass(frozen=True)
class _Raw:
    matrix: FloatArray
    distortion: FloatArray
    rotations: list[FloatArray]
    shifts: list[FloatArray]
    sigma: FloatArray


def calibrate_lens(views: BoardViews) -> tuple[LensFit, LensReport]:
    """Fit and judge. Raises CalibrationError for views that cannot tell a lens."""
    used = list(views.views)
    _check_count(used, views)
    raw, k3 = _fit_with_needed(used, views.size_px)
    left_out = _wrong_views(used, raw)
    if left_out and len(used) - len(left_out) >= _LEAST_VIEWS:
        used = [view for k, view in enumerate(used) if k not in left_out]
        raw, k3 = _fit_with_needed(used, views.size_px)
    else:
        left_out = []
    residuals = _residuals(used, raw)
    error = np.concatenate([np.hypot(*r.T) for r in residuals])
    rms = float(np.sqrt((error**2).mean()))
    covered, tilt = _covered(used, views.size_px), _tilt(raw.rotations)
    lens = LensModel(raw.matrix, raw.distortion, views.size_px)
    _refuse(lens, raw, rms, covered, tilt)
    report = LensReport(
        pictures=views.pictures,
        views=len(used),
        left_out=tuple(views.views[k].name for k in left_out),
        corners=len(error),
        rms_px=rms,
        p95_px=float(np.percentile(error, 95)),
        held_out_px=_held_out(used, views.size_px, k3),
        focal_px=(float(raw.matrix[0, 0]), float(raw.matrix[1, 1])),
        focal_sigma_px=float(raw.sigma[:2].max()),
        covered_share=covered,
        tilt_deg=float(np.degrees(tilt)),
        largest_shift_px=lens.largest_shift_px(),
        warnings=_warnings(rms, covered, tilt, len(left_out), len(views.views)),
    )
    return LensFit(lens, tuple(used), tuple(residuals)), report


def _check_count(used: list[BoardView], views: BoardViews) -> None:
    if len(used) < _LEAST_VIEWS:
        raise CalibrationError(
            f"the board was found in {len(used)} of {views.pictures} pictures; {_LEAST_VIEWS} are needed, 15 are good.",
            "Show all of it, sharp, from different sides; check --board.",
        )


def _refuse(lens: LensModel, raw: _Raw, rms: float, covered: float, tilt: float) -> None:
    if not np.isfinite(raw.matrix).all() or not np.isfinite(raw.distortion).all() or rms > _LARGEST_RMS_PX:
        raise CalibrationError(
            f"the views do not agree with one lens (root mean square {rms:.1f} px).",
            "Use a flat board and one camera with its focus left alone; check the size given with --board.",
        )
    if tilt < _LEAST_TILT_RAD:
        raise CalibrationError(
            f"the board always faces the same way ({np.degrees(tilt):.0f} degrees at most between two views): "
            "distance and focal length look alike.",
            "Tilt it by 20 to 40 degrees, to different sides.",
        )
    if covered < _LEAST_COVERED:
        raise CalibrationError(
            f"the corners cover {100 * covered:.0f} % of the image, and say nothing about the rest of the lens.",
            "Show the board in every part of the image, up to the border.",
        )
    if float(raw.sigma[:2].max()) > _UNSURE_FOCAL * float(raw.matrix[0, 0]):
        raise CalibrationError(
            f"the focal length is known to {raw.sigma[:2].max():.0f} of {raw.matrix[0, 0]:.0f} px only.",
            "Give more views, more of them tilted.",
        )
    lens.check()


def _warnings(rms: float, covered: float, tilt: float, left_out: int, views: int) -> tuple[str, ...]:
    found = []
    if covered < _FINE_COVERED:
        found.append(f"the corners cover {100 * covered:.0f} % of the image: show the board in its other parts, too")
    if tilt < _FINE_TILT_RAD:
        found.append(f"the board is tilted by {np.degrees(tilt):.0f} degrees at most: 20 to 40 tell the focal length")
    if rms > _FINE_RMS_PX:
        found.append(f"{rms:.1f} px are much for a board: is it flat, and the picture sharp?")
    if left_out > 0.2 * views:
        found.append(f"{left_out} of {views} views do not fit the others")
    return tuple(found)


def _fit_with_needed(used: list[BoardView], size: tuple[int, int]) -> tuple[_Raw, bool]:
    """Five coefficients, or four where the fifth is not told from zero. Returns which: True for five."""
    raw = _fit(used, size, True)
    if abs(float(raw.distortion[4])) >= _SIGNIFICANT * float(raw.sigma[8]):
        return raw, True
    return _fit(used, size, False), False


def _fit(used: list[BoardView], size: tuple[int, int], with_k3: bool) -> _Raw:
    try:
        _, matrix, distortion, rotations, shifts, sigma, _, _ = cv2.calibrateCameraExtended(
            [view.board_points.astype(np.float32) for view in used],
            [view.image_points.astype(np.float32).reshape(-1, 1, 2) for view in used],
            size,
            np.eye(3),
            np.zeros(5),
            flags=0 if with_k3 else cv2.CALIB_FIX_K3,
        )
    except cv2.error as error:
        raise CalibrationError(
            "OpenCV finds no lens for these views.", "Give sharp views from different sides; check --board."
        ) from error
    return _Raw(
        np.asarray(matrix, dtype=np.float64),
        np.asarray(distortion, dtype=np.float64).ravel()[:5],
        [np.asarray(r, dtype=np.float64) for r in rotations],
        [np.asarray(t, dtype=np.float64) for t in shifts],
        np.asarray(sigma, dtype=np.float64).ravel(),
    )


def _residuals(used: list[BoardView], raw: _Raw) -> list[FloatArray]:
    return [
        view.image_points - _project(view, raw, rotation, shift)
        for view, rotation, shift in zip(used, raw.rotations, raw.shifts, strict=True)
    ]


def _project(view: BoardView, raw: _Raw, rotation: FloatArray, shift: FloatArray) -> FloatArray:
    seen, _ = cv2.projectPoints(view.board_points, rotation, shift, raw.matrix, raw.distortion)
    return np.asarray(seen, dtype=np.float64).reshape(-1, 2)


def _wrong_views(used: list[BoardView], raw: _Raw) -> list[int]:
    rms = np.array([np.sqrt((r**2).sum(axis=1).mean()) for r in _residuals(used, raw)])
    limit = max(_WRONG_VIEW * float(np.median(rms)), _LEAST_WRONG_PX)
    return [int(k) for k in np.flatnonzero(rms > limit)]


def _held_out(used: list[BoardView], size: tuple[int, int], with_k3: bool) -> float | None:
    """Root mean square error on every fourth view, with a lens from the others."""
    if len(used) < _HELD_OUT_FROM:
        return None
    raw = _fit([view for k, view in enumerate(used) if k % _HELD_OUT_EVERY], size, with_k3)
    squared = []
    for view in used[::_HELD_OUT_EVERY]:
        found, rotation, shift = cv2.solvePnP(view.board_points, view.image_points, raw.matrix, raw.distortion)
        if found:
            squared.append(((view.image_points - _project(view, raw, rotation, shift)) ** 2).sum(axis=1))
    return float(np.sqrt(np.concatenate(squared).mean())) if squared else None


def _covered(used: list[BoardView], size: tuple[int, int]) -> float:
    """Share of the image's cells that some corner lies in."""
    points = np.concatenate([view.image_points for view in used])
    cell = np.clip((points / size * _CELLS).astype(np.int64), 0, np.array(_CELLS) - 1)
    return len(np.unique(cell, axis=0)) / (_CELLS[0] * _CELLS[1])


def _tilt(rotations: list[FloatArray]) -> float:
    """Largest angle between the normals of two views, rad."""
    normals = np.array([cv2.Rodrigues(r)[0][:, 2] for r in rotations], dtype=np.float64)
    return float(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)).max())
