"""Arc length, resampling and distances on curves whose answers are known."""

from __future__ import annotations

import numpy as np

from motiondlo.geometry.curve import arc_length, distance_to_curve, left_normals, project, resample, tangents
from motiondlo.geometry.homography import warp_points


def circle(radius: float, count: int, turn: float = np.pi) -> np.ndarray:
    a = np.linspace(0.0, turn, count)
    return np.stack([radius * np.cos(a), radius * np.sin(a)], axis=1)


def test_arc_length_of_a_half_circle() -> None:
    s = arc_length(circle(100.0, 2000))
    assert s[0] == 0.0
    np.testing.assert_allclose(s[-1], np.pi * 100.0, rtol=1e-6)


def test_resampling_is_equidistant_and_keeps_the_ends() -> None:
    uneven = circle(50.0, 200)[np.unique((np.linspace(0, 1, 120) ** 2 * 199).astype(int))]
    nodes = resample(uneven, 25)
    steps = np.hypot(*np.diff(nodes, axis=0).T)
    np.testing.assert_allclose(steps, steps.mean(), rtol=1e-3)
    np.testing.assert_allclose(nodes[[0, -1]], uneven[[0, -1]])


def test_left_normal_points_to_the_left_when_y_goes_down() -> None:
    t = tangents(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]))
    np.testing.assert_allclose(left_normals(t), [[0.0, 1.0]] * 3)


def test_distance_and_place_of_the_nearest_point() -> None:
    nodes = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    points = np.array([[5.0, 2.0], [12.0, 4.0], [-3.0, -4.0]])
    distance, s = project(points, nodes)
    np.testing.assert_allclose(distance, [2.0, 2.0, 5.0])
    np.testing.assert_allclose(s, [5.0, 14.0, 0.0])
    np.testing.assert_allclose(distance_to_curve(points, nodes), distance)


def test_a_homography_and_its_inverse_give_the_points_back() -> None:
    h = np.array([[1.1, 0.02, -90.0], [0.03, 1.2, -180.0], [8e-5, 4e-6, 1.0]])
    points = np.array([[10.0, 20.0], [1200.0, 900.0]])
    np.testing.assert_allclose(warp_points(warp_points(points, h), np.linalg.inv(h)), points, atol=1e-9)
