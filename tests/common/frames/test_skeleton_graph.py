"""Skeleton graph, crossings and traversal on drawn masks."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motiondlo.frames.junctions import Crossing, find_crossings, pair_score, ranked_pairings
from motiondlo.frames.params import GraphParams
from motiondlo.frames.skeleton_graph import FREE, build_graph, distance_inside, prune_spurs, skeletonise
from motiondlo.frames.traversal import traverse

PARAMS = GraphParams()
SHAPE = (300, 400)


def mask_of(*lines, width=11):
    mask = np.zeros(SHAPE, np.uint8)
    for line in lines:
        cv2.polylines(mask, [np.asarray(line, np.int32).reshape(-1, 1, 2)], False, 1, width)
    return mask


def graph_of(mask):
    return prune_spurs(build_graph(skeletonise(mask), distance_inside(mask)), PARAMS.spur_radii)


def flat(value=-1.0):
    return np.full((*SHAPE, 3), value, np.float32)


def test_a_bumpy_band_is_one_branch_with_two_tips():
    mask = mask_of([(40, 150), (360, 150)])
    for x in range(60, 340, 25):
        cv2.rectangle(mask, (x, 139), (x + 2, 145), 1, -1)
    assert len(build_graph(skeletonise(mask), distance_inside(mask)).branches) > 1
    graph = graph_of(mask)
    assert len(graph.branches) == 1
    assert graph.branches[0].nodes == (FREE, FREE)
    assert graph.branches[0].width == pytest.approx(11.0, abs=3.5)


def test_a_ring_is_no_branch():
    mask = np.zeros(SHAPE, np.uint8)
    cv2.circle(mask, (200, 150), 60, 1, 9)
    assert graph_of(mask).branches == ()


def test_a_band_over_the_border_is_thinned_up_to_it():
    chains = traverse(graph_of(mask_of([(200, 150), (450, 170)])), flat(), PARAMS)
    assert len(chains) == 1
    assert chains[0].path[:, 0].max() == SHAPE[1] - 1


@pytest.mark.parametrize("slope", [20, 45, 120])
def test_crossing_bands_are_walked_straight_through(slope):
    a = [(30, 150 - slope), (370, 150 + slope)]
    b = [(30, 150 + slope), (370, 150 - slope)]
    chains = traverse(graph_of(mask_of(a, b)), flat(), PARAMS)
    long = [c for c in chains if c.length > 60]
    assert len(long) == 2
    for chain in long:
        assert abs(chain.path[0, 1] - chain.path[-1, 1]) > 1.4 * slope


def test_colour_decides_where_direction_cannot():
    # Two bands that touch and part again look the same whether they cross or kiss.
    left_up, right_up = [(30, 100), (200, 150)], [(200, 150), (370, 100)]
    left_down, right_down = [(30, 200), (200, 150)], [(200, 150), (370, 200)]
    graph = graph_of(mask_of(left_up, right_up, left_down, right_down))
    image = flat()
    image[:148] = -3.0
    colour_first = PARAMS.model_copy(update={"colour_weight": 2.0})
    chains = [c for c in traverse(graph, image, colour_first) if c.length > 60]
    assert sorted(round(abs(c.path[0, 1] - c.path[-1, 1]) / 10) for c in chains) == [0, 0]
    ignored = PARAMS.model_copy(update={"colour_weight": 0.0})
    chains = [c for c in traverse(graph, image, ignored) if c.length > 60]
    assert min(abs(c.path[0, 1] - c.path[-1, 1]) for c in chains) > 70


def test_a_loop_is_one_chain_with_two_ends_and_no_ring():
    u = np.linspace(-1.0, 1.0, 300)
    angle = 1.45 * np.pi * u
    loop = np.stack([200 + 105 * u - 85 * np.sin(angle), 170 - 70 * np.cos(angle)], axis=1)
    chains = [c for c in traverse(graph_of(mask_of(np.round(loop), width=9)), flat(), PARAMS) if c.length > 40]
    assert len(chains) == 1
    length = np.hypot(*np.diff(loop, axis=0).T).sum()
    assert chains[0].length == pytest.approx(length, rel=0.06)


def test_all_one_to_one_pairings_are_ranked():
    graph = graph_of(mask_of([(30, 60), (370, 240)], [(30, 240), (370, 60)]))
    crossings, _ = find_crossings(graph, flat(), PARAMS)
    (crossing,) = crossings
    ranked = ranked_pairings(crossing, PARAMS, keep=99)
    # Involutions of four ends: 1 without a pair, 6 with one, 3 with two.
    assert len(ranked) == 10
    assert ranked[0][0] == max(score for score, _ in ranked)
    assert len(ranked[0][1]) == 2


def test_pair_score_is_the_papers_collinearity_without_our_penalties():
    plain = GraphParams(bend_weight=0.0, width_weight=0.0, colour_weight=0.0)
    graph = graph_of(mask_of([(30, 60), (370, 240)], [(30, 240), (370, 60)]))
    crossing: Crossing = find_crossings(graph, flat(), plain)[0][0]
    for i, a in enumerate(crossing.ends):
        for b in crossing.ends[i + 1 :]:
            assert pair_score(a, b, plain) == pytest.approx(-float(a.outward @ b.outward))
            assert pair_score(a, b, PARAMS) <= pair_score(a, b, plain) + 1e-12
