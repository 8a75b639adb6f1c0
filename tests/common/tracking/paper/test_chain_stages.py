"""Kernel, velocity, ends, triggers, hibernation, blending, and the parameters' bounds."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from motiondlo.geometry.curve import arc_length
from motiondlo.tracking.paper.blending import innovation, runs_backwards
from motiondlo.tracking.paper.endpoints import extend_ends, within_length, within_reach
from motiondlo.tracking.paper.geodesic import (
    chain_coordinates,
    mct_kernel,
    node_distances,
    updated_velocity,
    warm_start,
)
from motiondlo.tracking.paper.hibernation import Hibernation
from motiondlo.tracking.paper.params import PaperParams
from motiondlo.tracking.paper.recovery import RecoveryMonitor, Trigger
from motiondlo.tracking.paper.registration import cold_sigma2, register, respaced
from motiondlo.tracking.paper.track import PastState


def line(x0: float, x1: float, count: int, y: float = 0.0) -> np.ndarray:
    """(count, 2) points of a horizontal line."""
    return np.stack([np.linspace(x0, x1, count), np.full(count, y)], axis=1)


FOLDED = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 10.0], [0.0, 10.0]])


def test_kernel_is_the_papers_formula_and_does_not_couple_across_a_fold() -> None:
    d, beta = 30.0, 20.0
    expected = 1 / (4 * beta**2) * np.exp(-np.sqrt(2) * d / beta) * (2 * d + np.sqrt(2) * beta)
    assert mct_kernel(np.array([[d]]), beta)[0, 0] == pytest.approx(expected)
    s = chain_coordinates(FOLDED, True)
    np.testing.assert_allclose(s, [0, 100, 110, 210])
    along = mct_kernel(node_distances(FOLDED, s, True), beta)
    straight = mct_kernel(node_distances(FOLDED, s, False), beta)
    assert along[0, 3] < 1e-3 * along[0, 0]
    assert straight[0, 3] > 0.5 * straight[0, 0]
    np.testing.assert_allclose(chain_coordinates(FOLDED, False), [0, 70, 140, 210])


def test_warm_start_moves_a_rigid_motion_unchanged() -> None:
    nodes = line(0, 400, 20)
    kernel = mct_kernel(node_distances(nodes, arc_length(nodes), True), 20.0)
    np.testing.assert_allclose(warm_start(nodes, np.tile([3.0, -7.0], (20, 1)), kernel), nodes + np.array([3.0, -7.0]))


def test_velocity_is_an_average_and_nodes_without_observations_borrow_it() -> None:
    v, observed = np.zeros((5, 2)), np.tile([10.0, 0.0], (5, 1))
    observed[0] = observed[2] = 99.0  # what they were predicted to do, not what they were seen to do
    out = updated_velocity(v, observed, np.array([0, 1, 0, 1, 1], np.uint8), 0.85)
    np.testing.assert_allclose(out, np.tile([8.5, 0.0], (5, 1)))
    assert not updated_velocity(observed, observed, np.zeros(5, np.uint8), 0.85).any()


def test_ends_grow_to_the_last_observation_within_clip_and_known_length() -> None:
    nodes, seen = line(100, 300, 11), line(80, 320, 100, 2.0)
    params = PaperParams(extension_clip_px=30.0, length_tolerance=0.05)
    free = extend_ends(nodes, seen, 20.0, 0.0, params)
    assert (free[0, 0], free[-1, 0]) == pytest.approx((80.0, 320.0))
    np.testing.assert_allclose(np.diff(arc_length(free)), 24.0)
    known = extend_ends(nodes, seen, 20.0, 200.0, params)
    assert arc_length(known)[-1] == pytest.approx(210.0)
    far = extend_ends(nodes, line(305, 345, 30), 20.0, 0.0, params)
    assert far[-1, 0] == pytest.approx(330.0)
    aside = extend_ends(nodes, line(305, 325, 30, 50.0), 20.0, 0.0, params)
    np.testing.assert_allclose(aside, nodes)


def test_curve_drawn_along_its_holder_is_cut_where_the_ends_were_expected() -> None:
    stretched, expected = line(0, 300, 11), line(100, 300, 11)
    kept = within_length(stretched, expected, 200.0, 0.0)
    assert (kept[0, 0], kept[-1, 0]) == pytest.approx((100.0, 300.0), abs=2.0)
    assert within_length(stretched, expected, 0.0, 0.0) is stretched
    points = within_reach(line(0, 300, 31), expected, 200.0, 20.0)
    assert points[:, 0].min() == pytest.approx(90.0)
    assert len(within_reach(line(0, 300, 31), expected, 0.0, 20.0)) == 31


def test_each_trigger_fires_for_its_own_reason_and_can_be_switched_off() -> None:
    long, short = line(0, 400, 20), line(0, 20, 20)
    monitor = RecoveryMonitor(PaperParams())
    assert monitor.check(long, 5.0, 1.0, 30.0) is None
    assert monitor.check(long, 41.0, 1.0, 30.0) is Trigger.DRIFT
    assert [monitor.check(short, 5.0, 1.0, 30.0) for _ in range(3)] == [None, None, Trigger.STUCK_SPAN]
    monitor.count(Trigger.STUCK_SPAN)
    assert monitor.check(short, 5.0, 1.0, 30.0) is None
    assert monitor.check(long, 20.0, 1.0, 500.0) is Trigger.STAGNATION
    assert monitor.check(long, 20.0, 3.0, 500.0) is None
    assert monitor.counts == {Trigger.DRIFT: 0, Trigger.STUCK_SPAN: 1, Trigger.STAGNATION: 0}
    off = RecoveryMonitor(PaperParams(reinit_on_drift=False, reinit_on_stuck_span=False, reinit_on_stagnation=False))
    assert all(off.check(short, 99.0, 0.0, 500.0) is None for _ in range(5))


def test_hibernation_needs_several_updates_and_has_two_levels() -> None:
    state = Hibernation(PaperParams(rho_wake=0.01, rho_sleep=0.005, rho_updates=3))
    assert [state.update(rho) for rho in (0.02, 0.02, 0.001, 0.02, 0.02, 0.02)] == [False] * 5 + [True]
    assert all(state.update(0.007) for _ in range(10))  # between the levels nothing changes
    assert [state.update(0.001) for _ in range(3)] == [True, True, False]
    assert Hibernation(PaperParams(hibernation=False)).update(0.0)


def test_shape_is_absorbed_in_full_at_rest_and_less_the_longer_the_dlo_has_moved() -> None:
    past = PastState(line(0, 190, 20), 9.0, moved_us=0)
    shape, sigma = line(0, 190, 50, 8.0), np.zeros(50)
    params = PaperParams(blend_decay_us=1_000_000)
    np.testing.assert_allclose(innovation(past, shape, sigma, 0, params), np.tile([0.0, 8.0], (20, 1)))
    moved = innovation(past, shape, sigma, 1_000_000, params)
    np.testing.assert_allclose(moved[:, 1], 8.0 * np.exp(-1.0))
    unsure = innovation(past, shape, np.full(50, 3.0), 0, params)
    np.testing.assert_allclose(unsure[:, 1], 4.0)
    reversed_shape = innovation(past, shape[::-1], sigma, 0, params)
    np.testing.assert_allclose(reversed_shape, np.tile([0.0, 8.0], (20, 1)))
    assert runs_backwards(past.nodes, shape[::-1])


def test_shape_of_a_part_moves_only_that_part_and_only_across() -> None:
    past = PastState(line(0, 190, 20), 9.0, moved_us=0)
    part = innovation(past, line(45, 105, 20, 8.0), np.zeros(20), 0, PaperParams())
    np.testing.assert_allclose(part[5:11], np.tile([0.0, 8.0], (6, 1)), atol=1e-9)
    assert not part[:4].any()
    assert not part[12:].any()


def test_sigma2_starts_from_the_spacing_and_is_tied_to_the_fit() -> None:
    params = PaperParams(sigma2_max_px2=500.0)
    nodes = line(0, 380, 20)
    assert cold_sigma2(nodes, params) == pytest.approx(100.0)
    assert cold_sigma2(line(0, 3800, 20), params) == 500.0
    result = register(nodes, line(0, 380, 200, 3.0), 400.0, params)
    assert result is not None
    assert result.sigma2_px2 <= result.residual_px**2 + 20.0
    assert np.abs(result.nodes[2:-2, 1] - 3.0).max() < 1.0
    assert register(nodes, line(0, 380, 200, 5000.0), 400.0, params) is None
    assert respaced(np.zeros((20, 2))) is None
    assert respaced(np.full((20, 2), np.nan)) is None


@pytest.mark.parametrize(
    "wrong",
    [
        {"tau_min_us": 70_000},
        {"rho_sleep": 0.5},
        {"pca_centreline": False, "skeleton_path": False},
        {"nodes": 2},
        {"beta_px": "20"},
        {"unknown": 1},
    ],
)
def test_wrong_parameters_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        PaperParams(**wrong)  # type: ignore[arg-type]
