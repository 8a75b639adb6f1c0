"""Where a moving DLO has come to while nobody tracked it."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline

from motiondlo.frames.types import EndKind
from motiondlo.tracking.carrying import MOTION_KNOWN_US, carried_correction, carried_state
from motiondlo.tracking.inextensible.shape import cubic_basis
from motiondlo.tracking.types import Correction, CorrectionKind, TrackSource, TrackState

NODES = np.stack([np.linspace(100.0, 500.0, 20), np.full(20, 300.0)], axis=1)
VELOCITY = np.stack([np.full(20, 1000.0), np.linspace(-500.0, 500.0, 20)], axis=1)


def state(moving: bool) -> TrackState:
    cov = np.tile([1.0, 0.0, 1.0], (20, 1))
    return TrackState(
        3, NODES, VELOCITY, cov, np.ones(20, np.uint8), 20.0, 0.9, moving, TrackSource.EVENT, 0, 0.1, 0
    )  # fmt: skip


def correction() -> Correction:
    sigma = np.ones(20)
    ends = (EndKind.TIP, EndKind.TIP)
    return Correction(
        1, 3, 50_000, CorrectionKind.REINITIALISE, NODES, sigma, sigma, 20.0, ends, velocity_px_s=VELOCITY
    )


def test_a_moving_state_goes_on_and_becomes_less_certain() -> None:
    later = carried_state(state(moving=True), 20_000)
    np.testing.assert_allclose(later.nodes, NODES + 0.02 * VELOCITY)
    assert (later.cov_px2[:, [0, 2]] > 1.0).all()
    assert later.source is TrackSource.PREDICTED
    far = carried_state(state(moving=True), 10 * MOTION_KNOWN_US)
    np.testing.assert_allclose(far.nodes, NODES + MOTION_KNOWN_US * 1e-6 * VELOCITY)


def test_a_resting_state_stays() -> None:
    later = carried_state(state(moving=False), 500_000)
    np.testing.assert_array_equal(later.nodes, NODES)
    np.testing.assert_array_equal(later.cov_px2, state(moving=False).cov_px2)


def test_a_shape_with_a_velocity_is_carried_to_now() -> None:
    now = carried_correction(correction(), 60_000)
    np.testing.assert_allclose(now.nodes, NODES + 0.01 * VELOCITY)
    assert (now.sigma_normal_px > 1.0).all()
    assert now.velocity_px_s is VELOCITY
    assert carried_correction(correction(), 50_000 + MOTION_KNOWN_US).velocity_px_s is None
    assert carried_correction(correction(), 40_000).nodes[0, 0] == NODES[0, 0], "never back in time"


def test_cubic_basis_is_that_of_scipy() -> None:
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, 9), np.ones(3)])
    at = np.clip(np.linspace(0.0, 1.0, 57), 0.0, 1.0 - 1e-12)
    np.testing.assert_allclose(cubic_basis(at, knots), BSpline.design_matrix(at, knots, 3).toarray(), atol=1e-12)
