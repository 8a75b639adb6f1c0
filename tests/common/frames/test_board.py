"""Board comparison, edges, ends and fits in isolation."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.frames.board import model_board, smooth_gain, working_scale
from motiondlo.frames.colour import board_distance
from motiondlo.frames.edges import refine_centreline, robust_smooth
from motiondlo.frames.ends import follow_end, learn_palette
from motiondlo.frames.params import ForegroundParams
from motiondlo.frames.polyline_fit import fit_spline, smooth_path
from motiondlo.frames.strip import Scene
from motiondlo.geometry.curve import distance_to_curve, resample

PARAMS = ForegroundParams()
PAPER = (0.7, 0.72, 0.72)


def scene_of(frame, plate):
    return Scene(frame, plate, model_board(frame, plate, PARAMS))


def test_shadows_and_highlights_lie_on_the_boards_line_and_paint_does_not():
    darkest, brightest = np.log(0.55), np.log(1.13)
    ratio = np.log(np.array([[0.65] * 3, [1.1] * 3, [1.0] * 3, [0.2] * 3, [1.0, 1.0, 0.5]])).astype(np.float32)
    distance = board_distance(ratio, darkest, brightest)
    np.testing.assert_allclose(distance[:3], 0.0, atol=1e-6)
    assert distance[3] == pytest.approx(np.log(0.55 / 0.2), rel=1e-4)
    assert distance[4] > 0.5


def test_gain_follows_the_light_and_not_the_objects():
    ratio = np.full((486, 648, 3), np.log(0.8), np.float32)
    ratio[:, 400:] += np.float32(np.log(0.9))
    ratio[100:116, 50:350] = -2.0
    gain = smooth_gain(ratio, 0.25)
    assert gain[300, 100, 0] == pytest.approx(np.log(0.8), abs=0.02)
    assert gain[300, 600, 0] == pytest.approx(np.log(0.72), abs=0.03)
    assert gain[108, 200, 1] == pytest.approx(np.log(0.8), abs=0.03)


def test_working_scale_is_a_whole_factor():
    assert [working_scale(w, 648) for w in (320, 648, 1296, 2592)] == [1, 1, 2, 4]


@pytest.mark.parametrize("with_plate", [True, False])
def test_edges_give_the_centreline_to_a_tenth_of_a_pixel_in_spite_of_the_shadow(make_board, curves, with_plate):
    board = make_board(PAPER)
    truth = board.cable(curves["wave"](80, 560, 240, 60), 16.0, (0.3, 0.2, 0.05))
    scene = scene_of(board.photograph(), board.photograph_plate() if with_plate else None)
    rough = truth[15:-15] + np.array([2.0, -2.5])
    refined = refine_centreline(scene, rough, 18.0, rounds=2, smooth_w=0.9)
    inner = refined.centre[5:-5]
    assert distance_to_curve(inner, truth).mean() < 0.12
    assert refined.width == pytest.approx(16.0, abs=0.6)
    assert refined.edge_support > 0.9
    errors = distance_to_curve(inner, truth) / refined.sigma[5:-5]
    assert np.sqrt((errors**2).mean()) < 2.0


@pytest.mark.parametrize("cut", [12.0, -9.0])
def test_an_end_is_followed_out_or_cut_back_to_the_tip(make_board, curves, cut):
    board = make_board(PAPER)
    truth = board.cable(curves["line"](100, 200, 500, 260), 16.0, (0.05, 0.05, 0.4))
    scene = scene_of(board.photograph(), board.photograph_plate())
    direction = (truth[-1] - truth[0]) / np.hypot(*(truth[-1] - truth[0]))
    body = resample(np.stack([truth[0], truth[-1] - cut * direction]), 200)
    end = follow_end(scene, body, 1, learn_palette(scene, body[:180], 16.0), 60.0)
    assert end.found
    reached = end.extension[-1] if len(end.extension) else body[-1] - end.cut_px * direction
    assert float((reached - truth[-1]) @ direction) == pytest.approx(0.0, abs=1.2)


def test_gaps_are_bridged_smoothly_with_growing_sigma():
    x = np.linspace(0, 4 * np.pi, 400)
    values, weight = np.sin(x), np.ones(400)
    values[180:220], weight[180:220] = 50.0, 0.0
    values[::37] += 3.0
    smooth, sigma = robust_smooth(values, weight, 6.0)
    assert np.abs(smooth - np.sin(x)).max() < 0.35
    assert np.abs(smooth[:170] - np.sin(x[:170])).max() < 0.1
    assert sigma[200] > 3 * sigma[100]


def test_staircase_goes_without_moving_the_curve_and_nodes_are_equidistant():
    t = np.linspace(0, 1, 500)
    curve = np.stack([50 + 300 * t, 100 + 60 * np.sin(4 * t)], axis=1)
    pixels = np.unique(np.round(curve), axis=0)
    smooth = smooth_path(pixels, 21.0, 3)
    assert distance_to_curve(smooth, curve).mean() < 0.5 * distance_to_curve(pixels, curve).mean() + 0.1
    nodes = fit_spline(smooth, 16.0, 60)
    steps = np.hypot(*np.diff(nodes, axis=0).T)
    assert nodes.shape == (60, 2)
    assert np.ptp(steps) < 0.02 * steps.mean()
    assert distance_to_curve(nodes, curve).mean() < 0.25
