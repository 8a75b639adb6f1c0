"""Views of a board for the calibration of one lens: from pictures, or from a recording of either camera."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from motiondlo.calibration.boards import Board, Corners, charuco_board, find_corners
from motiondlo.calibration.event_picture import EventPicture
from motiondlo.errors import CalibrationError
from motiondlo.events.reader import open_events
from motiondlo.recording.layout import Recording, read_image

FloatArray = npt.NDArray[np.float64]

_PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
_BATCH_US = 500
_MEMORY_MS = 100.0


@dataclass(frozen=True)
class BoardView:
    """One picture in which the board was found."""

    name: str
    board_points: FloatArray
    """(K, 3) corners on the board, squares; z is 0."""
    image_points: FloatArray
    """(K, 2) px."""


@dataclass(frozen=True)
class BoardViews:
    """All of them, from pictures of one size."""

    views: tuple[BoardView, ...]
    size_px: tuple[int, int]
    pictures: int
    """How many were looked at."""


def views_of_pictures(paths: list[Path], board: Board) -> BoardViews:
    """Look for the board in picture files, and in all pictures of folders.

    Raises CalibrationError for a file that is no picture, and for pictures of different sizes.
    """
    views: list[BoardView] = []
    size: tuple[int, int] | None = None
    files = [file for path in paths for file in (_pictures_in(path) if path.is_dir() else [path])]
    if not files:
        raise CalibrationError("no pictures.", f"Give pictures ({', '.join(_PICTURES)}) or a folder of them.")
    for file in files:
        grey = cv2.imdecode(np.frombuffer(_read(file), np.uint8), cv2.IMREAD_GRAYSCALE)
        if grey is None:
            raise CalibrationError(f"{file}: no picture.", "Give PNG or JPEG files.")
        if size is None:
            size = (grey.shape[1], grey.shape[0])
        if (grey.shape[1], grey.shape[0]) != size:
            raise CalibrationError(
                f"{file}: {grey.shape[1]}x{grey.shape[0]} px, the others have {size[0]}x{size[1]}.",
                "Give pictures of one camera, at its own size.",
            )
        _add(views, file.name, find_corners(np.asarray(grey, dtype=np.uint8), board), board)
    assert size is not None
    return BoardViews(tuple(views), size, len(files))


def views_of_recording(recording: Recording, board: Board, camera: str, most: int = 60) -> BoardViews:
    """Look for the board in a recording: in the frames (camera ``rgb``), or in the events (``event``).

    For the event camera the board blinks, or moves; a picture is summed up at the time of every frame.
    """
    frames = recording.frames[:: max(1, -(-len(recording.frames) // most))]
    views: list[BoardView] = []
    if camera == "rgb":
        size: tuple[int, int] | None = None
        for frame in frames:
            image = read_image(frame.path)
            if image is not None and size in (None, (image.shape[1], image.shape[0])):
                size = (image.shape[1], image.shape[0])
                grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
                _add(views, frame.path.name, find_corners(grey, board), board)
        if size is None:
            raise CalibrationError(f"{recording.path}: no frame can be read.", "Give another recording, or pictures.")
        return BoardViews(tuple(views), size, len(frames))
    events = open_events(recording.events_path)
    picture = EventPicture(events.geometry, _MEMORY_MS)
    waiting = [frame.t_us for frame in frames]
    for batch in events.batches(_BATCH_US):
        picture.add(batch.events)
        while waiting and waiting[0] < batch.t1_us:
            t_us = waiting.pop(0)
            _add(views, f"{t_us} us", find_corners(picture.at(batch.t1_us), board), board)
    return BoardViews(tuple(views), (events.geometry.width_px, events.geometry.height_px), len(frames))


def _add(views: list[BoardView], name: str, corners: Corners | None, board: Board) -> None:
    if corners is not None and len(corners.ids) >= 4:
        views.append(BoardView(name, _on_board(corners, board), corners.points))


def _on_board(corners: Corners, board: Board) -> FloatArray:
    if board.kind == "charuco":
        return np.asarray(charuco_board(board).getChessboardCorners(), dtype=np.float64)[corners.ids]
    ids = corners.ids
    return np.stack([ids % board.columns, ids // board.columns, np.zeros(len(ids))], axis=1).astype(np.float64)


def _pictures_in(folder: Path) -> list[Path]:
    return sorted(file for file in folder.iterdir() if file.suffix.lower() in _PICTURES)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read ({error.strerror}).", "Give pictures that exist.") from error
