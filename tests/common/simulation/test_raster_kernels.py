"""Tubes and boxes are drawn where they are; the kernels agree with plain numpy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import norm

from motiondlo.geometry.curve import left_normals, project, tangents
from motiondlo.simulation.raster_kernels import (
    TILE,
    draw_box,
    mark_box,
    mark_points,
    nearest_on_tube,
    restore_tiles,
    shade_tube,
    step_of,
)

H, W = 96, 128
SIGMA = 0.7


class Canvas:
    """An image with the buffers that the kernels need."""

    def __init__(self) -> None:
        self.image = np.full((H, W, 1), 0.5, np.float32)
        self.light = np.ones((H, W), np.float32)
        self.tiles = np.ones((H // TILE, W // TILE), np.uint8)
        self.hit = np.zeros((H, W), np.int32)
        self.place, self.across, self.beyond = (np.zeros((H, W), np.float32) for _ in range(3))
        self.touched = np.zeros(H * W, np.int32)

    def draw(self, points: npt.NDArray[np.float64], radius: float, look: tuple[float, ...] = ()) -> int:
        radii, arcs = np.full(len(points), radius), np.linspace(0.0, 20.0, len(points))
        hits = (self.hit, self.place, self.across, self.beyond, self.touched)
        n = nearest_on_tube(self.tiles, points, radii, np.ones(len(points)), arcs, 2.6 * SIGMA, *hits)
        plain = np.array(look or (6.0, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0, 70.0, 0.0, 0.0, 1.0))
        up = np.array([0.0, 0.0, 1.0])
        shade_tube(
            self.image, self.light, points, left_normals(tangents(points)), radii, arcs, np.array([0.1]), plain, up, up,
            SIGMA, *hits, n,
        )  # fmt: skip
        return int(n)


def arc() -> npt.NDArray[np.float64]:
    angle = np.linspace(0.3, 1.9, 40)
    return np.stack([64 + 45 * np.cos(angle), 20 + 45 * np.sin(angle)], axis=1)


def test_step_is_the_gaussian_distribution() -> None:
    x = np.linspace(-5, 5, 41)
    np.testing.assert_allclose([step_of(v) for v in x], norm.cdf(x), atol=2e-3)


@pytest.mark.parametrize("radius", [2.5, 9.0])
def test_a_tube_covers_what_lies_within_its_radius(radius: float) -> None:
    canvas, points = Canvas(), arc()
    canvas.draw(points, radius)
    y, x = np.mgrid[0:H, 0:W]
    pixels = np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)
    distance, place = project(pixels, points)
    cover = norm.cdf((radius - distance) / SIGMA) - norm.cdf((-radius - distance) / SIGMA)
    length = np.hypot(*np.diff(points, axis=0).T).sum()
    middle = (place > 4.0) & (place < length - 4.0)
    wanted = 0.5 + cover * (0.1 - 0.5)
    np.testing.assert_allclose(canvas.image.ravel()[middle], wanted[middle], atol=0.02)


def test_ends_are_flat() -> None:
    canvas = Canvas()
    canvas.draw(np.stack([np.linspace(30.0, 90.0, 16), np.full(16, 48.0)], axis=1), 8.0)
    np.testing.assert_allclose(canvas.image[42:55, 90, 0], 0.3, atol=0.02)
    np.testing.assert_allclose(canvas.image[42:55, 93, 0], 0.5, atol=0.01)
    np.testing.assert_allclose(canvas.image[42:55, 87, 0], 0.1, atol=0.01)


def test_buffers_are_clear_after_drawing() -> None:
    canvas = Canvas()
    assert canvas.draw(arc(), 5.0) > 0
    assert not canvas.hit.any()


def test_clean_tiles_are_left_alone() -> None:
    canvas = Canvas()
    canvas.tiles[:, 4:] = 0
    canvas.draw(arc(), 6.0)
    assert (canvas.image[:, 4 * TILE :] == 0.5).all()
    assert (canvas.image[:, : 4 * TILE] != 0.5).any()


def test_marked_tiles_hold_all_that_is_drawn() -> None:
    canvas, points = Canvas(), arc()
    canvas.draw(points, 6.0)
    changed = np.abs(canvas.image[..., 0] - 0.5) > 1e-4
    tiles = np.zeros_like(canvas.tiles)
    mark_points(tiles, points, np.full(len(points), 6.0 + 2.6 * SIGMA + 2.0))
    assert not (changed & ~np.kron(tiles, np.ones((TILE, TILE))).astype(bool)).any()
    restore_tiles(canvas.image, np.full((H, W, 1), 0.5, np.float32), tiles)
    assert (canvas.image == 0.5).all()


def test_a_box_covers_its_rectangle_and_shows_its_texture() -> None:
    canvas = Canvas()
    box = np.array([60.0, 50.0, 0.4, 30.0, 12.0, 1.0])
    texture = np.tile(np.linspace(0.1, 0.9, 200, dtype=np.float32), (60, 1))
    draw_box(canvas.image, canvas.light, canvas.tiles, box, texture, np.ones(1), SIGMA, 0.0)
    y, x = np.mgrid[0:H, 0:W]
    u = np.cos(0.4) * (x - 60) + np.sin(0.4) * (y - 50)
    v = -np.sin(0.4) * (x - 60) + np.cos(0.4) * (y - 50)
    inside, outside = (np.abs(u) < 27) & (np.abs(v) < 9), (np.abs(u) > 33) | (np.abs(v) > 15)
    np.testing.assert_allclose(canvas.image[..., 0][inside], 0.5 + 0.4 * u[inside] / 30.0, atol=0.01)
    assert (canvas.image[..., 0][outside] == 0.5).all()
    tiles = np.zeros_like(canvas.tiles)
    mark_box(tiles, box, 3.0)
    assert not (~outside & ~np.kron(tiles, np.ones((TILE, TILE))).astype(bool)).any()
