"""Corners of checkerboards and ChArUco boards, to a fraction of a pixel, in pictures of either camera."""

from __future__ import annotations

import re
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.calibration.point_pairs import PointPairs
from motiondlo.errors import CalibrationError

FloatArray = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

_MARKER_SHARE = 0.75
_WINDOW_SHARE = 0.3


@dataclass(frozen=True)
class Board:
    """A flat board: inner corners of a checkerboard, or squares of a ChArUco board (markers 3/4 of a square)."""

    kind: str
    columns: int
    rows: int


@dataclass(frozen=True)
class Corners:
    """Corners that were found, by number."""

    ids: npt.NDArray[np.int64]
    """(K,)."""
    points: FloatArray
    """(K, 2) px."""


def parse_board(text: str) -> Board:
    """``checkerboard:9x6`` or ``charuco:8x6``. Raises CalibrationError."""
    match = re.fullmatch(r"(checkerboard|charuco):(\d{1,2})x(\d{1,2})", text)
    if match is None or min(int(match[2]), int(match[3])) < 3:
        raise CalibrationError(f"--board {text!r}: no board.", "Write checkerboard:9x6 or charuco:8x6, 3 or more each.")
    return Board(match[1], int(match[2]), int(match[3]))


def charuco_board(board: Board) -> cv2.aruco.CharucoBoard:
    """OpenCV's description of a ChArUco board; its ``generateImage`` draws one to print or to show."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    return cv2.aruco.CharucoBoard((board.columns, board.rows), 1.0, _MARKER_SHARE, dictionary)


def find_corners(grey: Grey, board: Board) -> Corners | None:
    """Corners of the board in (H, W) uint8; None when it is not seen.

    A blinking board may be inverted in a picture made from events, so both ways are tried.
    """
    for picture in (grey, 255 - grey):
        found = _charuco(picture, board) if board.kind == "charuco" else _checkerboard(picture, board)
        if found is not None:
            return found
    return None


def pair_corners(rgb: Corners, event: Corners, board: Board) -> tuple[FloatArray, FloatArray]:
    """(K, 2) rgb px and (K, 2) event px of the corners seen in both pictures.

    A checkerboard looks alike from both ends: the numbering with which the cameras are turned less against one another
    is taken (boards whose cameras are turned by more than 90 degrees need ChArUco).
    """
    common, a, b = np.intersect1d(rgb.ids, event.ids, return_indices=True)
    p, q = rgb.points[a], event.points[b]
    if board.kind == "checkerboard" and len(common):
        along_p, along_q = p[-1] - p[0], q[-1] - q[0]
        if float(along_p @ along_q) < 0:
            q = q[::-1].copy()
    return p, q


def join_pairs(parts: list[tuple[FloatArray, FloatArray]], origin: str) -> PointPairs:
    """All corners of several pictures. Raises CalibrationError when there are none."""
    if not parts:
        raise CalibrationError(
            f"{origin}: the board was not found in both cameras at one instant.",
            "Show all of it, sharp and large, and let it blink or move slowly; check the size given with --board.",
        )
    return PointPairs(np.concatenate([p for p, _ in parts]), np.concatenate([q for _, q in parts]), origin)


def _checkerboard(grey: Grey, board: Board) -> Corners | None:
    size = (board.columns, board.rows)
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
    seen, corners = cv2.findChessboardCornersSB(grey, size, flags=flags)
    if not seen:
        return None
    points = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    return Corners(np.arange(len(points)), _sharpened(grey, points, board))


def _sharpened(grey: Grey, points: FloatArray, board: Board) -> FloatArray:
    """Corners where the gradients around them meet; in noisy pictures from events this is the more exact place."""
    grid = points.reshape(board.rows, board.columns, 2)
    spacing = min(float(np.hypot(*np.diff(grid, axis=k).reshape(-1, 2).T).min()) for k in (0, 1))
    half = int(np.clip(_WINDOW_SHARE * spacing, 2, 20))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    start = np.ascontiguousarray(points, dtype=np.float32).reshape(-1, 1, 2)
    fine = cv2.cornerSubPix(grey, start, (half, half), (-1, -1), criteria)
    return np.asarray(fine, dtype=np.float64).reshape(-1, 2)


def _charuco(grey: Grey, board: Board) -> Corners | None:
    corners, ids, _, _ = cv2.aruco.CharucoDetector(charuco_board(board)).detectBoard(grey)
    if ids is None or len(ids) < 4:
        return None
    points = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    return Corners(np.asarray(ids, dtype=np.int64).ravel(), points)
