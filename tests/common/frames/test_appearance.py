"""The straightened strip: its coordinates, its values, and what it does at image borders."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motiondlo.errors import CalibrationError
from motiondlo.frames.appearance import LOG_OFFSET, sample_appearance
from motiondlo.geometry.homography import warp_points

RGB_FROM_EVENT = np.array([[0.9, 0.02, 30.0], [-0.01, 0.92, 20.0], [1e-5, 2e-5, 1.0]])
EVENT_FROM_RGB = np.linalg.inv(RGB_FROM_EVENT)


def board(grey: int = 60) -> np.ndarray:
    return np.full((500, 700, 3), grey, np.uint8)


def draw(image: np.ndarray, points_event: np.ndarray, width_px: float, grey: int) -> None:
    """Draw a polyline given in event pixels into the RGB picture, with sub-pixel places."""
    points = warp_points(points_event, RGB_FROM_EVENT)
    cv2.polylines(
        image, [np.round(points * 16).astype(np.int32)], False, (grey,) * 3, int(width_px), cv2.LINE_AA, shift=4
    )


def test_columns_lie_on_the_left_normal_and_the_strip_is_centred_on_the_cable() -> None:
    angle = np.linspace(0.2, 1.4, 60)
    nodes = np.stack([100 + 300 * np.cos(angle), 60 + 300 * np.sin(angle)], axis=1)
    image = board()
    draw(image, nodes, 12, 220)
    # A bright line on one side only, 30 px along the left normal (-t_y, t_x): towards the circle's centre here.
    draw(image, np.stack([100 + 270 * np.cos(angle), 60 + 270 * np.sin(angle)], axis=1), 3, 255)
    look = sample_appearance(image, EVENT_FROM_RGB, nodes, diameter_px=13.0)
    columns = look.strip.shape[1]
    offset = (np.arange(columns) - (columns - 1) / 2) * look.dn_px
    inside = look.strip[60:-60]
    bright = inside > np.log(0.4)
    for row in bright:
        cable = offset[row & (np.abs(offset) < 15)]
        assert abs(cable.mean()) < 0.8
        assert cable.size == pytest.approx(13, abs=3)
    mean = inside.mean(axis=0)
    assert mean[np.argmin(np.abs(offset - 30))] > mean[np.argmin(np.abs(offset + 30))] + 1.0


def test_rows_count_arc_length_from_the_first_node_and_go_beyond_the_ends() -> None:
    nodes = np.stack([np.linspace(200, 320, 30), np.full(30, 200.0)], axis=1)
    image = board()
    draw(image, nodes, 10, 200)
    look = sample_appearance(image, EVENT_FROM_RGB, nodes, diameter_px=11.0, extend_px=50.0)
    assert look.s0_px == -50.0
    middle = look.strip[:, look.strip.shape[1] // 2]
    s = look.s0_px + np.arange(len(middle)) * look.ds_px
    on_cable = s[middle > np.log(0.3)]
    # The drawn line has round caps of half its width.
    assert on_cable[0] == pytest.approx(-5.5, abs=3)
    assert on_cable[-1] == pytest.approx(120 + 5.5, abs=3)
    assert s[-1] >= 120 + 48


def test_values_are_the_logarithm_of_linear_luminance() -> None:
    nodes = np.array([[100.0, 100.0], [300.0, 100.0]])
    look = sample_appearance(board(188), EVENT_FROM_RGB, nodes, diameter_px=10.0)
    linear = ((188 / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(look.strip, np.log(linear + LOG_OFFSET), atol=1e-3)


def test_places_outside_the_picture_are_marked_unknown_and_repeat_the_border() -> None:
    nodes = np.array([[-60.0, 200.0], [300.0, 200.0]])
    look = sample_appearance(board(188), EVENT_FROM_RGB, nodes, diameter_px=10.0, extend_px=80.0)
    x_rgb = 0.9 * (look.s0_px - 60.0) + 30.0
    assert x_rgb < 0
    assert look.known[0].max() == 0
    assert look.known[-60].min() == 1
    assert np.isfinite(look.strip).all()


def test_dimensions_follow_diameter_and_arguments() -> None:
    nodes = np.array([[100.0, 200.0], [300.0, 200.0]])
    thin = sample_appearance(board(), EVENT_FROM_RGB, nodes, diameter_px=10.0)
    thick = sample_appearance(board(), EVENT_FROM_RGB, nodes, diameter_px=60.0)
    narrow = sample_appearance(board(), EVENT_FROM_RGB, nodes, diameter_px=60.0, half_width_px=20.0)
    assert thin.strip.shape[1] == 97
    assert thick.strip.shape[1] == 181
    assert narrow.strip.shape[1] == 41
    assert thin.strip.dtype == np.float32
    assert thin.known.dtype == np.uint8
    assert thin.strip.shape == thin.known.shape


def test_large_pictures_are_blurred_before_sampling() -> None:
    # One event pixel covers 4 x 4 pixels of a checkerboard with single-pixel squares: it must come out grey.
    checker = ((np.indices((800, 800)).sum(axis=0) % 2) * 255).astype(np.uint8)
    image = np.repeat(checker[:, :, None], 3, axis=2)
    look = sample_appearance(image, np.diag([0.25, 0.25, 1.0]), np.array([[40.0, 100.3], [160.0, 100.3]]), 10.0)
    inside = look.strip[look.known == 1]
    assert inside.std() < 0.2


def test_wrong_input_is_refused() -> None:
    with pytest.raises(ValueError):
        sample_appearance(board(), EVENT_FROM_RGB, np.array([[1.0, 2.0]]), 10.0)
    with pytest.raises(ValueError):
        sample_appearance(board(), EVENT_FROM_RGB, np.array([[1.0, np.nan], [3.0, 4.0]]), 10.0)
    with pytest.raises(CalibrationError):
        sample_appearance(board(), np.zeros((3, 3)), np.array([[1.0, 2.0], [30.0, 4.0]]), 10.0)
