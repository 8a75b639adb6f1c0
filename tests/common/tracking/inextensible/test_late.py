"""What a late shape says about now."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.frames.types import EndKind
from motiondlo.tracking.inextensible.late import PastState, carried_innovation, oriented_like
from motiondlo.tracking.types import Correction, CorrectionKind

M = 20
S_PX = np.arange(M) * 12.0
POINTS = np.stack([100.0 + S_PX, np.full(M, 50.0)], axis=1)


def past() -> PastState:
    return PastState(POINTS, np.full(M, 0.5), np.zeros(M), (0.0, 0.0), (0.0, S_PX[-1]))


def shape(shift=(0.0, 3.0), flipped: bool = False) -> Correction:
    nodes = np.stack([np.linspace(100.0, 100.0 + S_PX[-1], 30), np.full(30, 50.0)], axis=1) + np.array(shift)
    nodes = nodes[::-1] if flipped else nodes
    return Correction(
        1, 1, 0, CorrectionKind.BLEND, nodes, np.ones(30), np.full(30, 3.0), 12.0, (EndKind.TIP, EndKind.TIP)
    )


def carried(correction: Correction, seen_ms: np.ndarray):
    return carried_innovation(correction, past(), S_PX, seen_ms, (0.0, 0.0), (True, True), 10.0, 1.0)


def test_offset_is_taken_along_the_normal_and_the_tips_along_the_tangent() -> None:
    found = carried(shape((4.0, 3.0)), np.zeros(M))
    np.testing.assert_allclose(found.offset_px[2:-2], 3.0, atol=1e-6)
    assert found.end_shift_px == pytest.approx((-4.0, 4.0))
    assert found.plausible


def test_what_was_measured_since_is_hardly_touched() -> None:
    seen_ms = np.where(S_PX < 100.0, 60.0, 0.0)
    variance = carried(shape(), seen_ms).variance_px2
    assert variance[3] > 1000.0 * variance[12]


def test_a_shape_far_away_is_implausible() -> None:
    assert not carried(shape((0.0, 30.0)), np.zeros(M)).plausible


def test_nodes_beyond_the_shape_get_no_offset() -> None:
    short = shape()
    cut = Correction(
        1, 1, 0, CorrectionKind.BLEND, short.nodes[:15], np.ones(15), np.full(15, 3.0), 12.0,
        (EndKind.TIP, EndKind.HIDDEN),
    )  # fmt: skip
    found = carried(cut, np.zeros(M))
    assert np.isinf(found.variance_px2[12:]).all()
    assert np.isinf(found.end_variance_px2[1])


def test_a_shape_from_the_other_end_is_turned_round() -> None:
    turned = oriented_like(shape(flipped=True), POINTS)
    np.testing.assert_allclose(turned.nodes, shape().nodes)
