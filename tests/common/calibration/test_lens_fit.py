"""Lenses from views of a board: the true one within its error, and refusals of what cannot tell one."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motiondlo.calibration.lens_fit import calibrate_lens
from motiondlo.calibration.lens_picture import lens_picture
from motiondlo.calibration.lens_views import BoardView, BoardViews
from motiondlo.errors import CalibrationError
from motiondlo.geometry.lens import LensModel

SIZE = (1296, 972)
TRUE = LensModel(
    np.array([[1360.0, 0.0, 652.0], [0.0, 1362.0, 480.0], [0.0, 0.0, 1.0]]),
    np.array([-0.12, 0.05, 0.0004, -0.0003, 0.0]),
    SIZE,
)
CORNERS = np.array([[x, y, 0.0] for y in range(6) for x in range(9)])


def view(rng, k, noise_px=0.1, tilt_rad=0.5, reach=1.0, away=1.0, lens=TRUE):
    """The board somewhere in the image, tilted about some axis."""
    axis = rng.uniform(0.0, 2 * np.pi)
    turn = np.array([np.cos(axis), np.sin(axis), 0.0]) * rng.uniform(0.4, 1.0) * tilt_rad
    distance = away * rng.uniform(18.0, 24.0)
    place = reach * np.array([-1.0 + (k % 4) * 0.66, -1.0 + (k // 4 % 3) * 1.0]) * [0.30 * distance, 0.22 * distance]
    shift = np.array([place[0] - 4.0, place[1] - 2.5, distance])
    points, _ = cv2.projectPoints(CORNERS, turn, shift, lens.camera_matrix, lens.distortion)
    points = points.reshape(-1, 2) + rng.normal(0.0, noise_px, (len(CORNERS), 2))
    inside = ((points > 0) & (points < SIZE)).all(axis=1)
    return BoardView(f"view {k}", CORNERS[inside], points[inside])


def views(count=16, seed=0, **how):
    rng = np.random.default_rng(seed)
    return BoardViews(tuple(view(rng, k, **how) for k in range(count)), SIZE, count)


def error_of(lens):
    """Mean distance of undistorted rays, px of the true camera, best turned and scaled away by nothing."""
    x, y = np.meshgrid(np.linspace(60, SIZE[0] - 60, 15), np.linspace(60, SIZE[1] - 60, 11))
    places = np.stack([x.ravel(), y.ravel()], axis=1)

    def rays(model):
        ideal = model.undistorted(places)
        k = model.camera_matrix
        return (ideal - k[:2, 2]) / np.diag(k)[:2]

    # A shift of the principal point is a turn of the camera, which a homography takes up.
    found, _ = cv2.findHomography(rays(lens), rays(TRUE))
    mapped = cv2.perspectiveTransform(rays(lens)[None], found)[0]
    return float(np.hypot(*(mapped - rays(TRUE)).T).mean() * TRUE.camera_matrix[0, 0])


@pytest.mark.parametrize("seed", range(3))
def test_the_true_lens_is_found(seed):
    fit, report = calibrate_lens(views(seed=seed))
    assert error_of(fit.lens) < 0.1
    assert abs(fit.lens.camera_matrix[0, 0] - 1360.0) < 4.0 * report.focal_sigma_px + 1.0
    assert report.rms_px == pytest.approx(0.1 * np.sqrt(2), rel=0.15)
    assert report.held_out_px is not None
    assert 0.8 * report.rms_px < report.held_out_px < 2.0 * report.rms_px
    assert fit.lens.distortion[4] == 0.0, "a coefficient that the views do not tell is none"
    assert report.views == 16
    assert report.warnings == ()


def test_a_view_of_another_lens_is_left_out_by_name():
    good = views()
    rng = np.random.default_rng(5)
    wrong = view(rng, 5, noise_px=4.0)
    fit, report = calibrate_lens(
        BoardViews((*good.views, BoardView("moved.png", wrong.board_points, wrong.image_points)), SIZE, 17)
    )
    assert report.left_out == ("moved.png",)
    assert error_of(fit.lens) < 0.1


REFUSED = {
    "TOO_FEW": (lambda: views(3), "needed"),
    "ALWAYS_FACING_THE_CAMERA": (lambda: views(tilt_rad=0.02), "same way"),
    "ONLY_IN_THE_MIDDLE": (lambda: views(reach=0.0, away=2.5), "cover"),
    "NO_BOARD_OF_THIS_SIZE": (lambda: views(noise_px=30.0), "agree"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_tell_a_lens_is_refused(case):
    make, words = REFUSED[case]
    with pytest.raises(CalibrationError, match=words):
        calibrate_lens(make())


def test_views_in_a_part_of_the_image_are_warned_of():
    _, report = calibrate_lens(views(reach=0.4, away=1.6))
    assert any("cover" in text for text in report.warnings)


def test_the_picture_is_a_png():
    assert lens_picture(*calibrate_lens(views(8)))[:4] == b"\x89PNG"
