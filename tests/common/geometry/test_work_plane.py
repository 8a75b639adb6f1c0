"""Event pixels in mm: a scale, a plane seen from an angle, and files that cannot be."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from motiondlo.errors import CalibrationError
from motiondlo.geometry.homography import warp_points
from motiondlo.geometry.lens import LensModel
from motiondlo.geometry.work_plane import load_work_plane, plane_of_scale

TILTED = np.array([[0.2, 0.01, -3.0], [0.0, 0.19, 2.0], [5e-5, 1e-5, 1.0]])


def test_a_scale_divides() -> None:
    plane = plane_of_scale(5.0)
    assert plane.mm(np.array([[10.0, 20.0]])).tolist() == [[2.0, 4.0]]
    assert plane.px_per_mm_over(1280, 720) == pytest.approx((5.0, 5.0))


def test_a_tilted_plane_has_a_scale_that_changes(tmp_path: Path) -> None:
    path = tmp_path / "plane.json"
    path.write_text(json.dumps({"mm_from_event": TILTED.tolist()}))
    plane = load_work_plane(path)
    points = np.array([[0.0, 0.0], [1000.0, 500.0]])
    assert np.allclose(plane.mm(points), warp_points(points, TILTED))
    least, most = plane.px_per_mm_over(1280, 720)
    assert 4.0 < least < 0.95 * most < 7.0


def test_the_lens_comes_first() -> None:
    lens = LensModel(np.array([[1230.0, 0, 637], [0, 1230, 363], [0, 0, 1]]), np.array([0.1, 0, 0, 0]), (1280, 720))
    corner = np.array([[0.0, 0.0]])
    assert np.allclose(plane_of_scale(5.0, lens).mm(corner), lens.undistorted(corner) / 5.0)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("{}", "either"),
        ('{"px_per_mm": 5, "mm_from_event": [[1,0,0],[0,1,0],[0,0,1]]}', "either"),
        ('{"px_per_mm": -5}', "px_per_mm"),
        ('{"mm_from_event": [[1,0,0],[1,0,0],[0,0,1]]}', "singular"),
        ('{"mm_from_event": [[1,0],[1,0]]}', "mm_from_event"),
        ("no json", "file"),
    ],
)
def test_a_file_that_cannot_be_is_refused(tmp_path: Path, text: str, what: str) -> None:
    path = tmp_path / "plane.json"
    path.write_text(text)
    with pytest.raises(CalibrationError, match=what):
        load_work_plane(path)
