"""Cameras agree with their homographies, and look at the same place."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.geometry.homography import warp_points
from motiondlo.simulation.cameras import WORK_PLANE_MM, calibrated_homography, draw_cameras, event_from_rgb


@pytest.fixture(params=[1, 2, 3])
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    return np.random.default_rng(request.param)


def test_the_plane_homography_is_the_projection_of_the_plane(rng: np.random.Generator) -> None:
    places = rng.uniform(-60, 60, (20, 2))
    for camera in draw_cameras(rng):
        world = np.concatenate([places, np.full((20, 1), 7.0)], axis=1)
        np.testing.assert_allclose(warp_points(places, camera.image_from_plane(7.0)), camera.project(world), atol=1e-9)


def test_both_cameras_see_the_middle_of_the_board(rng: np.random.Generator) -> None:
    for camera in draw_cameras(rng):
        middle = camera.project(np.zeros(3))
        assert np.hypot(*(middle - [camera.width / 2, camera.height / 2])) < 60.0


def test_the_exact_homography_holds_on_the_work_plane_alone(rng: np.random.Generator) -> None:
    event, rgb = draw_cameras(rng)
    h = event_from_rgb(event, rgb)
    places = np.concatenate([rng.uniform(-60, 60, (20, 2)), np.full((20, 1), WORK_PLANE_MM)], axis=1)
    np.testing.assert_allclose(warp_points(rgb.project(places), h), event.project(places), atol=1e-8)
    higher = places + np.array([0.0, 0.0, 10.0])
    shift_mm = np.hypot(*(warp_points(rgb.project(higher), h) - event.project(higher)).T) / 5.4
    assert 0.3 < shift_mm.max() < 2.5


def test_the_calibrated_homography_is_off_by_about_a_pixel(rng: np.random.Generator) -> None:
    event, rgb = draw_cameras(rng)
    fitted, rgb_px, event_px = calibrated_homography(event, rgb, rng)
    exact = event_from_rgb(event, rgb)
    off = np.hypot(*(warp_points(rgb_px, fitted) - warp_points(rgb_px, exact)).T)
    assert 0.05 < off.mean() < 2.0
    assert np.std(warp_points(rgb_px, exact) - event_px) == pytest.approx(0.72, abs=0.25)
