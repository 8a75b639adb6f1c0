"""The curve cannot stretch, its derivatives are right, and a polyline becomes the curve nearest to it."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.frames.types import EndKind
from motiondlo.geometry.curve import arc_length, distance_to_curve
from motiondlo.tracking.inextensible.curve_kernels import acceleration_covariance, place_curve
from motiondlo.tracking.inextensible.params import InextensibleParams
from motiondlo.tracking.inextensible.shape import STRIDE, fit_pose, make_layout

PARAMS = InextensibleParams()


def bow(count: int = 80) -> np.ndarray:
    angle = np.linspace(0.3, 2.6, count)
    return np.stack([300.0 + 200.0 * np.cos(angle), 100.0 + 150.0 * np.sin(angle)], axis=1)


def placed(q: np.ndarray, layout, stretch: float = 1.0):
    theta, points = np.empty(layout.samples), np.empty((layout.samples, 2))
    jacobian = np.zeros(((layout.samples - 1) // STRIDE + 1, 2, len(q)))
    place_curve(q, stretch, layout.basis, layout.ds_px, layout.anchor, STRIDE, theta, points, jacobian)
    return theta, points, jacobian


def numpy_curve(q: np.ndarray, layout, stretch: float) -> np.ndarray:
    """The plain twin: integrate the tangent by trapezoids from the anchor outwards."""
    theta = layout.basis @ q[2:]
    tangent = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    steps = 0.5 * (tangent[1:] + tangent[:-1]) * layout.ds_px * stretch
    way = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return way - way[layout.anchor] + q[:2]


def test_kernel_equals_its_numpy_twin() -> None:
    nodes = bow()
    layout = make_layout(float(arc_length(nodes)[-1]), (EndKind.HELD, EndKind.BORDER), PARAMS)
    q = fit_pose(layout, nodes)
    _, points, _ = placed(q, layout, 1.02)
    np.testing.assert_allclose(points, numpy_curve(q, layout, 1.02), atol=1e-9)


def test_jacobian_is_the_derivative() -> None:
    nodes = bow()
    layout = make_layout(float(arc_length(nodes)[-1]), (EndKind.TIP, EndKind.TIP), PARAMS)
    q = fit_pose(layout, nodes)
    _, _, jacobian = placed(q, layout)
    for k in range(len(q)):
        step = np.zeros(len(q))
        step[k] = 1e-6
        change = (numpy_curve(q + step, layout, 1.0) - numpy_curve(q - step, layout, 1.0)) / 2e-6
        np.testing.assert_allclose(jacobian[:, :, k], change[::STRIDE], atol=1e-5)


def test_length_is_kept_whatever_the_pose() -> None:
    layout = make_layout(400.0, (EndKind.TIP, EndKind.TIP), PARAMS)
    rng = np.random.default_rng(3)
    q = np.concatenate([[100.0, 100.0], rng.normal(0.0, 0.4, layout.coefficients).cumsum()])
    _, points, _ = placed(q, layout)
    total = layout.ds_px * (layout.samples - 1)
    assert arc_length(points)[-1] == pytest.approx(total, rel=0.01)


def test_fit_is_nearer_than_a_third_of_a_pixel() -> None:
    nodes = bow()
    layout = make_layout(float(arc_length(nodes)[-1]), (EndKind.TIP, EndKind.TIP), PARAMS)
    _, points, _ = placed(fit_pose(layout, nodes), layout)
    inner = points[4:-4]
    assert distance_to_curve(inner, nodes).max() < 0.3


def test_a_border_end_is_continued_straight_beyond_the_image() -> None:
    nodes = np.stack([np.linspace(10.0, 300.0, 40), np.full(40, 50.0)], axis=1)
    layout = make_layout(290.0, (EndKind.BORDER, EndKind.TIP), PARAMS)
    _, points, _ = placed(fit_pose(layout, nodes), layout)
    assert points[0, 0] == pytest.approx(10.0 - PARAMS.border_reach_px, abs=2.0)
    assert abs(points[0, 1] - 50.0) < 2.0


def test_acceleration_field_moves_both_ends_alike() -> None:
    """Noise is put on places, not on angles: else the far end of the anchor would shake most."""
    nodes = np.stack([np.linspace(0.0, 500.0, 60), np.full(60, 50.0)], axis=1)
    layout = make_layout(500.0, (EndKind.TIP, EndKind.TIP), PARAMS)
    _, _, jacobian = placed(fit_pose(layout, nodes), layout)
    s = layout.stations_s_px
    every = max(1, round(24.0 / PARAMS.station_px))
    field = np.unique(np.append(np.arange(0, len(s), every), len(s) - 1))
    r = np.sqrt(3.0) * np.abs(s[field][:, None] - s[field][None]) / 150.0
    precision = np.linalg.inv((1 + r) * np.exp(-r) + 1e-3 * np.eye(len(field)))
    out = np.zeros((jacobian.shape[2],) * 2)
    acceleration_covariance(jacobian, field, precision, 1e-6, out)
    normal = np.sqrt([jacobian[i, 1] @ out @ jacobian[i, 1] for i in (0, len(s) // 2, len(s) - 1)])
    assert normal == pytest.approx([1.0, 1.0, 1.0], abs=0.25)
