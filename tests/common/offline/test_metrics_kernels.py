from __future__ import annotations

import numpy as np

from motiondlo.geometry.curve import point_at, project, resample
from motiondlo.offline.metrics_kernels import paired_distance, shifted_normal_distance
from motiondlo.offline.nearest import places_on

RNG = np.random.default_rng(5)


def _wavy(rows, count):
    x = np.linspace(0.0, 400.0, count)
    phase = RNG.uniform(0.0, 6.0, rows)[:, None]
    return np.stack(np.broadcast_arrays(x[None], 80.0 * np.sin(x[None] / 60.0 + phase)), axis=2)


def test_nearest_places_agree_with_the_plain_projection():
    curves, points = _wavy(4, 30), RNG.uniform(-100.0, 500.0, (4, 25, 2))
    found = places_on(curves, points)
    for r in range(4):
        distance, s = project(points[r], curves[r])
        np.testing.assert_allclose(found.distance[r], distance, atol=1e-9)
        steps = np.hypot(*np.diff(curves[r], axis=0).T)
        knots = np.concatenate([[0.0], np.cumsum(steps)])
        np.testing.assert_allclose(knots[found.segment[r]] + found.fraction[r] * steps[found.segment[r]], s, atol=1e-9)
        nodes = np.linalg.norm(points[r][:, None] - curves[r][None], axis=2).argmin(axis=1)
        np.testing.assert_array_equal(found.nearest_node[r], nodes)
    assert (found.normal_distance <= found.distance + 1e-9).all()


def test_normal_distance_leaves_out_what_lies_past_an_end():
    curve = np.array([[[0.0, 0.0], [10.0, 0.0]]])
    found = places_on(curve, np.array([[[14.0, 3.0], [5.0, -2.0]]]))
    np.testing.assert_allclose(found.distance[0], [5.0, 2.0])
    np.testing.assert_allclose(found.normal_distance[0], [3.0, 2.0])


def test_degenerate_curve_gives_finite_distances():
    found = places_on(np.full((1, 5, 2), 3.0), np.array([[[0.0, 3.0]]]))
    np.testing.assert_allclose(found.distance, 3.0)
    assert np.isfinite(found.normal_distance).all()


def test_paired_distance_agrees_with_plain_resampling():
    estimate, truth = _wavy(3, 20), _wavy(3, 50)
    first, last = np.array([0, 5, 7]), np.array([49, 40, 7])
    cut_first_s, cut_last_s = np.array([np.nan, 30.0, np.nan]), np.array([np.nan, np.nan, 100.0])
    out = np.empty(3)
    paired_distance(estimate, truth, first, last, cut_first_s, cut_last_s, out)
    whole = np.linalg.norm(resample(estimate[0], 20) - resample(truth[0], 20), axis=1).mean()
    length = np.hypot(*np.diff(estimate[1], axis=0).T).sum()
    cut = point_at(estimate[1], np.linspace(30.0, length, 20))
    part = np.linalg.norm(cut - resample(truth[1, 5:41], 20), axis=1).mean()
    np.testing.assert_allclose(out, [whole, part, np.nan])


def test_shifted_normal_distance_agrees_with_interpolated_truth():
    times_us = np.arange(0, 50_001, 1000)
    truth = _wavy(1, 60) + np.stack([0.0 * times_us, 2.0 * times_us / 1000.0], axis=1)[:, None]
    t_us = np.array([20_000, 25_500])
    points = _wavy(1, 15).repeat(2, axis=0) + RNG.normal(0.0, 2.0, (2, 15, 2)) + np.array([0.0, 45.0])
    used = RNG.random((2, 15)) < 0.8
    shifts_us = np.arange(0, -10_001, -500)

    def truth_at(t):
        j = np.minimum(t // 1000, 49)
        w = ((t - times_us[j]) / 1000.0)[:, None, None]
        return truth[j] * (1 - w) + truth[j + 1] * w

    out = np.empty(len(shifts_us))
    segment = places_on(truth_at(t_us), points).segment
    shifted_normal_distance(points, used, t_us, times_us, truth, shifts_us, segment, out)
    plain = []
    for shift in shifts_us:
        d = places_on(truth_at(t_us + shift), points).normal_distance
        plain.append(np.mean([d[r, used[r]].mean() for r in range(2)]))
    np.testing.assert_allclose(out, plain, rtol=1e-6)
