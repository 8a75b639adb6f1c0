"""Boards that are drawn, seen by both cameras: corners to a fraction of a pixel, also from events."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from motiondlo.calibration.board_recording import board_pairs
from motiondlo.calibration.boards import Board, charuco_board, find_corners, pair_corners, parse_board
from motiondlo.calibration.event_picture import EventPicture
from motiondlo.calibration.homography_report import calibrate_homography
from motiondlo.errors import CalibrationError
from motiondlo.events.types import EVENT_DTYPE, TRIGGER_DTYPE, EventArray, SensorGeometry
from motiondlo.events.writer import Evt3Writer
from motiondlo.geometry.homography import warp_points
from motiondlo.recording.layout import open_recording

Grey = npt.NDArray[np.uint8]
FloatArray = npt.NDArray[np.float64]

GEOMETRY = SensorGeometry(640, 360)
RGB_SIZE = (800, 600)
EVENT_FROM_RGB = np.array([[0.86, -0.03, -25.0], [0.04, 0.84, -70.0], [5e-5, 1e-5, 1.0]])
CHECKERBOARD = Board("checkerboard", 9, 6)
CHARUCO = Board("charuco", 8, 6)


def drawing(board: Board, square_px: int = 40) -> Grey:
    if board.kind == "charuco":
        return np.asarray(charuco_board(board).generateImage((8 * square_px, 6 * square_px), marginSize=square_px // 2))
    tiles = np.indices((board.rows + 1, board.columns + 1)).sum(axis=0) % 2 * 225 + 30
    squares = np.kron(tiles, np.ones((square_px, square_px))).astype(np.uint8)
    return np.pad(squares, square_px // 2, constant_values=255)


def rgb_from_board(board: Board) -> FloatArray:
    turn = cv2.getRotationMatrix2D((0, 0), -4.0, 1.15)
    turn[:, 2] = (165.0, 140.0)
    return np.vstack([turn, [1e-5, 2e-5, 1.0]])


def picture(board: Board, view: FloatArray, size: tuple[int, int], ground: int = 120) -> Grey:
    # Drawn three times as large and reduced: corners are where the geometry says, without staircases.
    big = np.diag([3.0, 3.0, 1.0])
    big[:2, 2] = 1.0  # pixel centres
    image = cv2.warpPerspective(
        drawing(board), big @ view, (3 * size[0], 3 * size[1]), borderValue=ground, flags=cv2.INTER_LINEAR
    )
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def blink(board: Board, start_us: int, seed: int = 0) -> EventArray:
    """A screen shows the board: where it is light, several ON events at every pixel."""
    rng = np.random.default_rng(seed)
    light = picture(board, EVENT_FROM_RGB @ rgb_from_board(board), (GEOMETRY.width_px, GEOMETRY.height_px), 30)
    # The area that a pixel sees decides how many thresholds it crosses.
    counts = np.floor(light / 255.0 * 6.0 + rng.random(light.shape)).astype(int)
    y, x = np.nonzero(counts)
    repeat = counts[y, x]
    events = np.zeros(int(repeat.sum()), EVENT_DTYPE)
    events["x"], events["y"] = np.repeat(x, repeat), np.repeat(y, repeat)
    events["p"] = 1
    events["t"] = start_us + rng.integers(0, 4000, len(events))
    return events[np.argsort(events["t"], kind="stable")]


@pytest.mark.parametrize("board", [CHECKERBOARD, CHARUCO], ids=lambda board: board.kind)
def test_corners_of_a_picture_and_of_events_give_the_homography(board: Board) -> None:
    rgb = find_corners(picture(board, rgb_from_board(board), RGB_SIZE), board)
    summed = EventPicture(GEOMETRY)
    summed.add(blink(board, 1000))
    event = find_corners(summed.at(5000), board)
    assert rgb is not None
    assert event is not None
    p, q = pair_corners(rgb, event, board)
    assert len(p) >= 30
    error = np.hypot(*(warp_points(p, EVENT_FROM_RGB) - q).T)
    assert error.mean() < 0.3


def test_an_inverted_board_is_found_too() -> None:
    assert find_corners(255 - picture(CHARUCO, rgb_from_board(CHARUCO), RGB_SIZE), CHARUCO) is not None


def test_a_picture_without_a_board_has_no_corners() -> None:
    assert find_corners(np.full((360, 640), 128, np.uint8), CHECKERBOARD) is None
    assert find_corners(EventPicture(GEOMETRY).at(0), CHARUCO) is None


def test_a_checkerboard_numbered_from_the_other_end_is_turned() -> None:
    rgb = find_corners(picture(CHECKERBOARD, rgb_from_board(CHECKERBOARD), RGB_SIZE), CHECKERBOARD)
    assert rgb is not None
    other = type(rgb)(rgb.ids, rgb.points[::-1].copy())
    p, q = pair_corners(rgb, other, CHECKERBOARD)
    assert np.array_equal(p, q)


def test_what_rests_fades_from_the_event_picture() -> None:
    summed = EventPicture(GEOMETRY, tau_ms=10.0)
    y, x = np.mgrid[50:150, 100:300]
    events = np.zeros(2 * x.size, EVENT_DTYPE)
    events["x"], events["y"], events["p"] = np.append(x, x + 250), np.append(y, y), 1
    events["t"][x.size :] = 60_000
    summed.add(events)
    late = summed.at(60_000)
    assert late[100, 450] > 200
    assert late[100, 200] < 10


@pytest.mark.parametrize("text", ["chess:9x6", "charuco:8", "charuco:2x6", ""])
def test_a_board_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(CalibrationError, match="no board"):
        parse_board(text)
    assert parse_board("charuco:8x6") == CHARUCO


def test_a_recording_of_a_blinking_board_calibrates_the_cell(tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    triggers = np.zeros(4, TRIGGER_DTYPE)
    triggers["t"], triggers["edge"] = [4000, 9000, 104000, 109000], [1, 0, 1, 0]
    image = picture(CHARUCO, rgb_from_board(CHARUCO), RGB_SIZE)
    for k in (1, 2):
        cv2.imwrite(str(tmp_path / "frames" / f"frame_00000{k}.jpg"), image)
    (tmp_path / "manifest.json").write_text(json.dumps({"frame_000001.jpg": 4000, "frame_000002.jpg": 104000}))
    events = np.concatenate([blink(CHARUCO, 1000), blink(CHARUCO, 101_000, seed=1)])
    with Evt3Writer(tmp_path / "events.raw", GEOMETRY) as writer:
        writer.write(events, triggers)
    pairs = board_pairs(open_recording(tmp_path), CHARUCO)
    fit, report = calibrate_homography(pairs, (GEOMETRY.width_px, GEOMETRY.height_px))
    assert report.inliers > 0.9 * report.pairs >= 50
    middle = np.array([[400.0, 300.0]])
    assert np.hypot(*(warp_points(middle, fit.target_from_source) - warp_points(middle, EVENT_FROM_RGB)).T) < 0.3


def test_a_recording_without_the_board_is_an_error(tmp_path: Path) -> None:
    with Evt3Writer(tmp_path / "events.raw", GEOMETRY) as writer:
        writer.write(np.zeros(3, EVENT_DTYPE))
    with pytest.raises(CalibrationError, match="not found in both cameras"):
        board_pairs(open_recording(tmp_path), CHARUCO)
