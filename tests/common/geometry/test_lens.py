"""Lens distortion in both directions, through both cameras, and files that cannot be."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from motiondlo.errors import CalibrationError
from motiondlo.geometry.camera_map import CameraMap, map_points, map_points_back
from motiondlo.geometry.homography import warp_points
from motiondlo.geometry.lens import LensModel, load_lens

K = np.array([[1360.0, 0.0, 640.0], [0.0, 1362.0, 490.0], [0.0, 0.0, 1.0]])
BARREL = LensModel(K, np.array([-0.25, 0.1, 1e-3, -5e-4, 0.0]), (1296, 972))
PINCUSHION = LensModel(np.array([[1230.0, 0, 637], [0, 1230, 363], [0, 0, 1]]), np.array([0.08, 0, 0, 0]), (1280, 720))
EVENT_FROM_RGB = np.array([[1.17, -0.05, -60.0], [0.08, 1.12, -210.0], [8e-5, -4e-6, 1.0]])


def grid() -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    x, y = np.meshgrid(np.linspace(0, 1295, 12), np.linspace(0, 971, 9))
    return np.stack([x.ravel(), y.ravel()], axis=1)


def write(path: Path, **changes: object) -> Path:
    document = {"width": 1296, "height": 972, "camera_matrix": K.tolist(), "distortion": [-0.2, 0.05, 0, 0, 0]}
    path.write_text(json.dumps(document | changes))
    return path


def test_there_and_back_again_is_exact() -> None:
    assert np.abs(BARREL.distorted(BARREL.undistorted(grid())) - grid()).max() < 1e-5
    assert BARREL.largest_shift_px() > 20.0


def test_it_is_the_model_of_opencv() -> None:
    near = grid()[40:60]
    opencv = cv2.undistortPoints(near[:, None], K, BARREL.distortion, P=K)[:, 0]
    assert np.abs(BARREL.undistorted(near) - opencv).max() < 0.01


def test_points_go_through_both_lenses_and_back() -> None:
    camera_map = CameraMap(EVENT_FROM_RGB, BARREL, PINCUSHION)
    event = map_points(grid(), camera_map)
    by_hand = PINCUSHION.distorted(warp_points(BARREL.undistorted(grid()), EVENT_FROM_RGB))
    assert np.allclose(event, by_hand)
    assert np.abs(event - map_points(grid(), EVENT_FROM_RGB)).max() > 5.0
    assert np.abs(map_points_back(event, camera_map) - grid()).max() < 1e-3


def test_without_lenses_it_is_the_homography() -> None:
    assert np.array_equal(map_points(grid(), EVENT_FROM_RGB), warp_points(grid(), EVENT_FROM_RGB))
    assert np.allclose(map_points_back(map_points(grid(), EVENT_FROM_RGB), EVENT_FROM_RGB), grid())


def test_a_file_is_read(tmp_path: Path) -> None:
    lens = load_lens(write(tmp_path / "lens.json"))
    assert lens.size_px == (1296, 972)
    assert len(lens.undistorted(np.zeros((0, 2)))) == 0


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"distortion": [0.1, 0.2]}, "2 distortion coefficients"),
        ({"distortion": [-3.0, 0, 0, 0, 0]}, "cannot be undone"),
        ({"camera_matrix": [[1, 0], [0, 1]]}, "camera_matrix"),
        ({"camera_matrix": [[0, 0, 640], [0, 1000, 480], [0, 0, 1]]}, "none of a camera"),
        ({"camera_matrix": [[1000, 9, 640], [0, 1000, 480], [0, 0, 1]]}, "skew"),
        ({"width": -1}, "width"),
    ],
)
def test_a_file_that_cannot_be_is_refused_by_name(tmp_path: Path, changes: dict[str, object], what: str) -> None:
    path = write(tmp_path / "lens.json", **changes)
    with pytest.raises(CalibrationError, match=what) as caught:
        load_lens(path)
    assert "lens.json" in str(caught.value)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="cannot be read"):
        load_lens(tmp_path / "none.json")
