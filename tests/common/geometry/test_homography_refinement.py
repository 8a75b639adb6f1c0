"""A running homography is refined only when curves of both branches prove it wrong, and can be put back."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from motiondlo.geometry.homography import warp_points
from motiondlo.geometry.homography_refinement import CurvePair, HomographyRefinement, RefinementParams

FloatArray = npt.NDArray[np.float64]

SIZE = (1280, 720)
GIVEN = np.array([[1.17, -0.05, -60.0], [0.08, 1.12, -210.0], [8e-5, -4e-6, 1.0]])
LOOSE = RefinementParams(prior_px=1.0)


def shifted(dx_px: float, dy_px: float) -> FloatArray:
    return np.array([[1.0, 0.0, dx_px], [0.0, 1.0, dy_px], [0.0, 0.0, 1.0]]) @ GIVEN


def curve(k: int) -> FloatArray:
    """A bent cable, in another place and direction for every k; event px."""
    rng = np.random.default_rng(k)
    s, angle = np.linspace(-1, 1, 60), rng.uniform(0, np.pi)
    line = np.stack([260 * s, 40 * np.sin(2 * s + rng.uniform(0, 6))], axis=1)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return line @ turn.T + rng.uniform([300, 280], [980, 440])


def pair(k: int, true: FloatArray, noise_px: float = 0.1, raised_px: float = 0.0, dlo: int = 0) -> CurvePair:
    event = curve(k) + np.random.default_rng(100 + k).normal(0, noise_px, (60, 2))
    rgb = warp_points(curve(k) + np.array([raised_px, 0.0]), np.linalg.inv(true))
    some = np.full(60, 0.2)
    return CurvePair(dlo, rgb, some, event, some, np.ones(60, np.uint8))


def filled(true: FloatArray, count: int = 18, params: RefinementParams | None = LOOSE) -> HomographyRefinement:
    refinement = HomographyRefinement(GIVEN, SIZE, params)
    for k in range(count):
        refinement.add(pair(k, true, dlo=k))
    return refinement


def error(h: FloatArray, true: FloatArray) -> float:
    x, y = np.meshgrid(np.linspace(100, 1180, 9), np.linspace(100, 620, 6))
    event = np.stack([x.ravel(), y.ravel()], axis=1)
    return float(np.hypot(*(warp_points(warp_points(event, np.linalg.inv(true)), h) - event).T).mean())


def test_a_wrong_homography_is_refined() -> None:
    true = shifted(1.2, -0.9)
    refinement = filled(true)
    outcome = refinement.propose()
    assert outcome.accepted, outcome.reason
    assert error(outcome.event_from_rgb, true) < 0.25 * error(GIVEN, true)
    assert outcome.after_px < 0.5 * outcome.before_px


def test_a_right_homography_is_left_alone() -> None:
    refinement = filled(GIVEN)
    assert not refinement.propose().accepted
    assert np.array_equal(refinement.event_from_rgb, GIVEN)


def test_a_second_proposal_changes_nothing_more() -> None:
    refinement = filled(shifted(1.2, -0.9))
    first = refinement.propose()
    second = refinement.propose()
    assert not second.accepted
    assert np.array_equal(second.event_from_rgb, first.event_from_rgb)


def test_it_never_goes_further_than_allowed() -> None:
    refinement = filled(shifted(3.0, 3.0), params=RefinementParams(prior_px=5.0, max_shift_px=2.0))
    outcome = refinement.propose()
    assert not outcome.accepted
    assert "would move" in outcome.reason


def test_few_pairs_and_one_straight_line_are_not_enough() -> None:
    assert filled(shifted(1, 1), count=3).propose().reason == "too few pairs"
    refinement = HomographyRefinement(GIVEN, SIZE)
    line = np.stack([np.linspace(100, 1100, 60), np.full(60, 300.0)], axis=1)
    rgb, some = warp_points(line + 1.0, np.linalg.inv(GIVEN)), np.full(60, 0.2)
    for _ in range(12):
        refinement.add(CurvePair(0, rgb, some, line, some, np.ones(60, np.uint8)))
    assert "too little of the image" in refinement.propose().reason


def test_the_height_of_one_cable_is_not_taken_for_an_error_of_the_homography() -> None:
    """Three cables lie on the plane, one is raised by as much as shifts it by 1.5 px."""
    refinement = HomographyRefinement(GIVEN, SIZE, RefinementParams(prior_px=0.3, height_px=1.0))
    for k in range(24):
        refinement.add(pair(k, GIVEN, raised_px=1.5 if k % 4 == 0 else 0.0, dlo=k % 4))
    refinement.propose()
    assert error(refinement.event_from_rgb, GIVEN) < 0.25


@pytest.mark.parametrize("hidden", [0.0, 1.0])
def test_only_what_events_support_counts(hidden: float) -> None:
    refinement = HomographyRefinement(GIVEN, SIZE, LOOSE)
    for k in range(12):
        good = pair(k, shifted(1.5, 1.5), dlo=k)
        seen = np.full(60, int(1.0 - hidden), np.uint8)
        refinement.add(CurvePair(k, good.nodes_rgb, good.sigma_rgb_px, good.nodes_event, good.sigma_event_px, seen))
    assert refinement.propose().accepted == (hidden == 0.0)
