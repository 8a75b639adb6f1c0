"""From the frame's strip to expectations, and from a polyline to a chain."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.frames.types import Appearance, EndKind
from motiondlo.tracking.chain import near_kernels
from motiondlo.tracking.chain.layout import acceleration_kernel, lay_out, start_covariance
from motiondlo.tracking.chain.params import ChainParams
from motiondlo.tracking.chain.spline import design, fit, weights
from motiondlo.tracking.chain.templates import edge_density, end_patch, profile_bins, profile_densities, seen_in_frame
from motiondlo.tracking.chain.texture import find_texture
from motiondlo.tracking.types import Correction, CorrectionKind

RADIUS = 9.0


def strip(inner: float = -0.5, outer: float = -2.0, length: float = 200.0, hidden=None, marks=()) -> Appearance:
    rows = int((length + 160.0) / 2.0)
    s = -80.0 + 2.0 * np.arange(rows)
    d = np.arange(-48, 49)
    image = np.full((rows, 97), outer)
    image[np.ix_((s >= 0) & (s <= length), np.abs(d) <= RADIUS)] = inner
    for a, b in marks:
        image[np.ix_((s >= a) & (s < b), np.abs(d) <= 0.7 * RADIUS)] = inner - 1.2
    if hidden is not None:
        image[(s >= hidden[0]) & (s <= hidden[1])] = -1.2
    return Appearance(image.astype(np.float32), np.ones((rows, 97), np.uint8), -80.0)


def correction(nodes: np.ndarray, ends=(EndKind.TIP, EndKind.TIP), sigma_t: float = 3.0) -> Correction:
    sigma = np.ones(len(nodes))
    return Correction(1, 1, 0, CorrectionKind.REINITIALISE, nodes, sigma, sigma_t * sigma, 18.0, ends)


@pytest.mark.parametrize(("inner", "row_at_minus_r"), [(-0.5, 0), (-3.5, 1)])
def test_bright_and_dark_cables_have_opposite_edges(inner: float, row_at_minus_r: int) -> None:
    half = profile_bins(RADIUS)
    density = profile_densities(strip(inner), np.array([60.0, 120.0]), RADIUS, half, 24.0)
    np.testing.assert_allclose(density.sum(axis=(1, 2)), 1.0, atol=1e-6)
    at_minus, at_plus = half - round(2 * RADIUS), half + round(2 * RADIUS)
    assert density[0, row_at_minus_r, at_minus] > 5 * density[0, 1 - row_at_minus_r, at_minus]
    assert density[0, 1 - row_at_minus_r, at_plus] > 5 * density[0, row_at_minus_r, at_plus]


def test_without_a_look_either_sign_is_expected_at_both_edges() -> None:
    half = profile_bins(RADIUS)
    density = profile_densities(None, np.array([10.0]), RADIUS, half, 24.0)
    np.testing.assert_allclose(density[:, 0], density[:, 1])
    np.testing.assert_allclose(density, edge_density(RADIUS, half, np.zeros((1, 2))))


def test_what_a_plate_hides_is_not_seen() -> None:
    seen = seen_in_frame(strip(hidden=(80.0, 130.0)), np.array([30.0, 60.0, 105.0, 170.0]), RADIUS, 24.0)
    np.testing.assert_array_equal(seen, [True, True, False, True])


def test_tip_patch_knows_only_the_cable() -> None:
    look = strip()
    image = look.strip.copy()
    image[-20:-18, :] = 0.0
    marked = Appearance(image, look.known, look.s0_px)
    for end in (0, 1):
        patch = end_patch(marked, end, 200.0, -26.0, 20.0, 17.0, RADIUS)
        a = np.arange(patch.a0, patch.a1 + 0.5)
        assert np.abs(patch.grad_a[a > 6.0]).max() == 0.0
        middle = patch.grad_a[:, patch.grad_a.shape[1] // 2]
        # Outwards of either end it gets darker.
        assert middle.min() < -0.2
        assert abs(a[middle.argmin()]) <= 3.0


def test_marks_are_found_and_plain_cables_have_none() -> None:
    texture = find_texture(strip(marks=((70.0, 76.0), (82.0, 86.0), (120.0, 128.0))), 200.0, RADIUS, 6)
    assert texture is not None
    assert np.abs(texture.s_px[:, None] - np.array([74.0, 124.0])).min(axis=0).max() < 14.0
    assert find_texture(strip(), 200.0, RADIUS, 6) is None
    assert find_texture(None, 200.0, RADIUS, 6) is None


def test_spline_follows_an_arc_and_its_weights_sum_to_one() -> None:
    angle = np.linspace(0.0, 2.5, 200)
    arc = 110.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    nodes = fit(arc, 110.0 * 2.5, 9)
    points = design(np.linspace(0.0, 6.0, 50), 9) @ nodes
    np.testing.assert_allclose(np.hypot(*points.T), 110.0, atol=0.4)
    _, w, w1, w2 = weights(np.linspace(0.0, 6.0, 31), 9)
    np.testing.assert_allclose(w.sum(axis=1), 1.0)
    np.testing.assert_allclose(w1.sum(axis=1), 0.0, atol=1e-12)
    np.testing.assert_allclose(w2.sum(axis=1), 0.0, atol=1e-12)


def test_chains_go_on_beyond_border_and_holder_with_growing_doubt() -> None:
    nodes = np.stack([np.linspace(100.0, 400.0, 40), np.full(40, 200.0)], axis=1)
    params = ChainParams()
    c = correction(nodes, (EndKind.HELD, EndKind.BORDER))
    layout = lay_out(c, params)
    ends = design(np.array([0.0, layout.K - 3.0]), layout.K) @ layout.nodes
    assert ends[0, 0] == pytest.approx(100.0 - params.held_cover_max_px, abs=1.0)
    assert ends[1, 0] == pytest.approx(400.0 + params.border_extension_px, abs=1.0)
    P = start_covariance(layout, c, acceleration_kernel(layout, params))
    assert np.linalg.eigvalsh(P).min() > -1e-9
    y = np.diag(P)[layout.K : 2 * layout.K]
    assert y[-2] > 20.0 * y[5]
    # The whole may be shifted along itself, much less across.
    x = np.diag(P)[: layout.K]
    assert x[5] > y[5] + 5.0


def test_others_motion_is_marked_by_tiles() -> None:
    grid = np.zeros((20, 30), np.uint32)
    near_kernels.mark(grid, np.array([[100.0, 100.0]]), 20.0, 3)
    out = np.zeros(3, np.bool_)
    places = np.array([[105.0, 95.0], [300.0, 100.0], [-5.0, 100.0]])
    assert near_kernels.marked_by_others(grid, places, 1, out) == 1
    np.testing.assert_array_equal(out, [True, False, False])
    assert near_kernels.marked_by_others(grid, places, 3, out) == 0
