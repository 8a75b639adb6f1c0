"""From events to observation points, stage by stage."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from motiondlo.events.types import EVENT_DTYPE, SensorGeometry
from motiondlo.geometry.curve import arc_length, distance_to_curve
from motiondlo.tracking.paper.centreline import pca_centreline
from motiondlo.tracking.paper.event_mask import active_cells, refined
from motiondlo.tracking.paper.mask_kernels import newest_age_of_cells
from motiondlo.tracking.paper.morphology import close_mask, drop_small_parts, morphology_scale, open_mask
from motiondlo.tracking.paper.noise_filter import NEVER_US, NoiseFilter
from motiondlo.tracking.paper.observations import observe
from motiondlo.tracking.paper.params import PaperParams
from motiondlo.tracking.paper.path_kernels import longest_paths
from motiondlo.tracking.paper.recentness import (
    AGE_BINS,
    AdaptiveDecay,
    active_age_us,
    longest_ages_us,
    oldest_age_us,
    recentness_threshold,
)
from motiondlo.tracking.paper.region import tube_around, whole_sensor
from motiondlo.tracking.paper.skeleton_path import skeleton_paths, spread_over
from motiondlo.tracking.paper.stage_clock import StageClock

SENSOR = SensorGeometry(200, 120)


def events_at(rows: list[tuple[int, int, int]]) -> np.ndarray:
    """Events from (t_us, x, y)."""
    events = np.zeros(len(rows), EVENT_DTYPE)
    for name, column in zip(("t", "x", "y"), zip(*rows, strict=True), strict=True):
        events[name] = column
    return events


def test_lonely_event_and_hot_pixel_are_dropped_neighbours_are_kept() -> None:
    noise = NoiseFilter(PaperParams(filter_window_us=1000, hot_pixel_period_us=200), SENSOR)
    kept = noise.filter(
        events_at(
            [
                (0, 10, 10),  # first of its kind: nothing corroborates it
                (100, 11, 10),  # its neighbour
                (150, 11, 10),  # too soon after itself
                (500, 50, 50),
                (1500, 50, 50),  # a pixel is no witness for itself
                (1800, 52, 50),  # two pixels away
                (2000, 11, 11),  # a neighbour, but too late
                (2100, 900, 10),  # outside the sensor
            ]
        )
    )
    assert kept["t"].tolist() == [100]


def test_neighbour_of_the_batch_before_corroborates() -> None:
    noise = NoiseFilter(PaperParams(), SENSOR)
    assert len(noise.filter(events_at([(0, 10, 10)]))) == 0
    assert len(noise.filter(events_at([(500, 11, 11)]))) == 1
    assert len(noise.filter(np.zeros(0, EVENT_DTYPE))) == 0


def test_decay_follows_the_event_rate_between_its_bounds() -> None:
    decay = AdaptiveDecay(PaperParams())
    assert decay.update(0, 2000) == 60_000.0
    taus = [decay.update(2000, 2000) for _ in range(100)]  # a million a second
    assert taus[-1] == 15_000.0
    assert all(a >= b for a, b in pairwise(taus))
    assert AdaptiveDecay(PaperParams(adaptive_decay=False)).update(2000, 2000) == 20_000.0


def test_otsu_threshold_is_clamped_to_the_papers_range() -> None:
    counts = np.zeros(AGE_BINS, np.int64)
    assert recentness_threshold(counts, 20_000.0, 0.05, 0.15) == 0.05
    counts[2] = counts[100] = 500  # fresh ones and a trail
    free = recentness_threshold(counts, 20_000.0, 0.0, 1.0)
    ages = (np.array([2, 100]) + 0.5) * active_age_us(20_000.0) / AGE_BINS
    assert np.exp(-ages[1] / 20_000) < free < np.exp(-ages[0] / 20_000)
    assert 0.05 <= recentness_threshold(counts, 20_000.0, 0.05, 0.15) <= 0.15


def test_age_threshold_is_the_recentness_threshold_without_exponentials() -> None:
    rng = np.random.default_rng(1)
    ages = rng.uniform(0, 100_000, 1000)
    recentness = np.exp(-ages / 15_000.0)
    np.testing.assert_array_equal(recentness > 0.1, ages < oldest_age_us(0.1, 15_000.0))


def test_longest_age_is_the_time_to_move_by_a_diameter_across() -> None:
    nodes = np.stack([np.linspace(0, 300, 4), np.zeros(4)], axis=1)
    across, along = np.zeros((4, 2)), np.zeros((4, 2))
    across[:, 1], along[:, 0] = -4000.0, 4000.0  # 4 px/ms
    np.testing.assert_allclose(longest_ages_us(across, nodes, 20.0, 2000.0), 5000.0)
    assert np.isinf(longest_ages_us(along, nodes, 20.0, 2000.0)).all()
    np.testing.assert_allclose(longest_ages_us(100 * across, nodes, 20.0, 2000.0), 2000.0)


def test_cells_hold_the_newest_event_of_both_polarities() -> None:
    rng = np.random.default_rng(2)
    last_us = rng.integers(0, 50_000, (2, 30, 47))
    last_us[rng.random(last_us.shape) < 0.7] = NEVER_US
    inside = (rng.random((10, 14)) < 0.8).astype(np.uint8)
    ages, counts = np.empty((10, 14), np.int32), np.empty(16, np.int64)
    active = newest_age_of_cells(last_us, inside, 7, 2, 3, 50_000, 40_000, ages, counts)
    expected = np.full((10, 14), 40_000)
    for r in range(10):
        for c in range(14):
            block = last_us[:, 2 + 3 * r : 5 + 3 * r, 7 + 3 * c : 10 + 3 * c]
            if inside[r, c] and block.size:
                expected[r, c] = min(50_000 - block.max(), 40_000)
    np.testing.assert_array_equal(ages, expected)
    assert active == counts.sum() == (expected < 40_000).sum()


def test_region_follows_the_curve_and_knows_its_segments() -> None:
    curve = np.array([[20.0, 20.0], [100.0, 20.0], [100.0, 100.0]])
    region = tube_around(curve, 10.0, SENSOR, 2)
    assert region is not None
    row, column = np.nonzero(region.inside)
    inside_px = region.to_pixels(np.stack([column, row], axis=1).astype(float))
    assert distance_to_curve(inside_px, curve).max() < 14.0
    on_curve = region.to_cells(np.array([[60.0, 20.0], [100.0, 70.0]])).round().astype(int)
    assert [int(region.inside[r, c]) for c, r in on_curve] == [1, 2]
    assert tube_around(curve + 1000.0, 10.0, SENSOR, 2) is None
    far = np.array([[20.0, 20.0], [1e9, 20.0]])
    assert tube_around(far, 10.0, SENSOR, 2) is not None  # its start is in view


def test_morphology_scales_with_the_diameter_and_bridges_what_it_should() -> None:
    scale = morphology_scale(PaperParams(), 40.0, 2)
    assert scale.close_cells == pytest.approx(2 * 1.5 * 40 / 2 / 2)
    assert scale.open_cells == pytest.approx(0.3 * 40 / 2 / 2)
    fixed = PaperParams(diameter_scaled_morphology=False)
    assert morphology_scale(fixed, 40.0, 2) == morphology_scale(fixed, 10.0, 2)
    mask = np.zeros((40, 100), np.uint8)
    mask[18:22, 5:45] = mask[18:22, 55:95] = 1
    assert close_mask(mask, 20.0)[20, 50] == 1
    assert close_mask(mask, 3.0)[20, 50] == 0
    mask[2, 2] = 1
    assert open_mask(mask, 1.5)[2, 2] == 0
    assert drop_small_parts(mask, 2)[2, 2] == 0
    assert drop_small_parts(mask, 2)[20, 30] == 1


def test_path_runs_from_tip_to_tip_over_diagonal_steps_and_ends_on_a_ring() -> None:
    skeleton = np.zeros((30, 30), np.uint8)
    for k in range(20):
        skeleton[5 + k, 3 + k] = 1  # 8-connected only
    skeleton[15, 13:20] = 1  # a branch
    path, ends = longest_paths(skeleton, 5)
    assert ends.tolist() == [20]
    assert {tuple(path[0]), tuple(path[-1])} == {(3, 5), (22, 24)}
    ring = np.zeros((9, 9), np.uint8)
    ring[2, 3:6] = ring[6, 3:6] = ring[3:6, 2] = ring[3:6, 6] = 1
    path, ends = longest_paths(ring, 3)
    assert len(ends) == 1
    assert 3 <= len(path) <= 12
    assert longest_paths(np.zeros((5, 5), np.uint8), 3)[0].shape == (0, 2)


def bent_mask() -> tuple[np.ndarray, np.ndarray]:
    """A U-shaped band 12 cells wide, and its centreline."""
    angle = np.linspace(0, np.pi, 60)
    arc = np.stack([100 + 40 * np.cos(angle), 60 + 40 * np.sin(angle)], axis=1)
    line = np.concatenate([[[140.0, 10.0]], arc, [[60.0, 10.0]]])
    y, x = np.mgrid[0:120, 0:200]
    points = np.stack([x.ravel(), y.ravel()], axis=1).astype(float)
    return (distance_to_curve(points, line) <= 6.0).reshape(120, 200).astype(np.uint8), line


def test_pca_centreline_of_a_straight_band_is_its_middle() -> None:
    mask = np.zeros((60, 200), np.uint8)
    mask[20:31, 10:190] = 1
    mask[20:31, 80:100] = 0  # a gap that no event fills
    line = pca_centreline(mask, 40)
    assert line is not None
    assert np.abs(line[:, 1] - 25.0).max() < 1.0
    assert sorted(line[[0, -1], 0].round().tolist()) == [10.0, 189.0]
    assert pca_centreline(np.zeros((60, 200), np.uint8), 40) is None


def test_skeleton_reaches_the_borders_of_the_mask() -> None:
    mask, line = bent_mask()
    (path,) = skeleton_paths(mask, 12.0)
    assert distance_to_curve(path, line).mean() < 1.0
    assert arc_length(path)[-1] == pytest.approx(arc_length(line)[-1] + 12.0, abs=10.0)


def test_the_bent_band_is_taken_from_the_skeleton_not_from_the_zigzag() -> None:
    mask, line = bent_mask()
    region = whole_sensor(SENSOR, 1)
    seen = observe(mask, region, 12.0, line, float(arc_length(line)[-1]), PaperParams(), StageClock())
    assert seen is not None
    assert seen.from_skeleton
    assert distance_to_curve(seen.points, line).mean() < 1.0
    only_pca = observe(mask, region, 12.0, line, 0.0, PaperParams(skeleton_path=False), StageClock())
    assert only_pca is not None
    assert distance_to_curve(only_pca.points, line).mean() > 2.0
    assert observe(np.zeros_like(mask), region, 12.0, line, 0.0, PaperParams(), StageClock()) is None


def test_part_of_the_dlo_gets_its_share_of_the_points() -> None:
    mask = np.zeros((60, 200), np.uint8)
    mask[20:31, 50:100] = 1
    expected = np.array([[0.0, 25.0], [200.0, 25.0]])
    seen = observe(mask, whole_sensor(SENSOR, 1), 12.0, expected, 200.0, PaperParams(observations=100), StageClock())
    assert seen is not None
    assert 20 <= len(seen.points) <= 30
    paths = [np.array([[0.0, 0.0], [90.0, 0.0]]), np.array([[0.0, 9.0], [10.0, 9.0]])]
    assert len(spread_over(paths, 100)) == 100


def test_mask_of_a_moving_band_leaves_out_its_trail() -> None:
    last_us = np.full((2, 120, 200), NEVER_US, np.int64)
    for y in range(20, 80):  # the leading edge swept these rows, one a millisecond
        last_us[1, y, 20:180] = 1000 * y
    curve = np.array([[20.0, 70.0], [180.0, 70.0]])
    region = tube_around(curve, 60.0, SENSOR, 1)
    assert region is not None
    params = PaperParams()
    trail = active_cells(last_us, region, 80_000, 15_000.0, 20.0, params)
    body = active_cells(last_us, region, 80_000, 15_000.0, 20.0, params, np.array([20_000.0]))
    rows = np.nonzero(body.any(axis=1))[0] + region.y0_px
    assert (rows.min(), rows.max()) == (61, 79)
    assert trail.sum() > 1.2 * body.sum()
    assert refined(body, region, 20.0, params).sum() >= body.sum() * 0.9
