"""Connections over gaps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from motiondlo.frames.covers import cover_of
from motiondlo.frames.merging import SegmentEnd, bend_w, bezier_bridge, connect, connection_score, is_candidate
from motiondlo.frames.params import MergeParams
from motiondlo.frames.types import EndKind

PARAMS = MergeParams()
D_MAX = 400.0


def end(segment, x, y, dx, dy, kind=EndKind.TIP, width=20.0, colour=5.0, side=0, maybe=False):
    d = np.array([dx, dy], float) / np.hypot(dx, dy)
    return SegmentEnd(segment, side, np.array([x, y], float), d, width, np.full(3, colour), kind, maybe)


def test_score_is_the_papers():
    a, b = end(0, 0, 0, 1, 0), end(1, 100, 0, -1, 0.5)
    expected = -(a.outward @ b.outward) * (1 - np.sqrt(100 / D_MAX))
    assert connection_score(a, b, D_MAX) == pytest.approx(expected)


CASES = {
    "SMALL_GAP": (end(0, 0, 0, 1, 0), end(1, 30, 0, -1, 0), True),
    "BOARD_BETWEEN": (end(0, 0, 0, 1, 0), end(1, 150, 0, -1, 0), False),
    "UNDER_A_PLATE": (end(0, 0, 0, 1, 0, EndKind.HIDDEN), end(1, 150, 0, -1, 0, EndKind.HIDDEN), True),
    "ONE_EDGE_OF_THE_PLATE_SEEN": (end(0, 0, 0, 1, 0, EndKind.HIDDEN), end(1, 150, 0, -1, 0), True),
    "ONE_EDGE_SEEN_OTHER_COLOUR": (end(0, 0, 0, 1, 0, EndKind.HIDDEN), end(1, 150, 0, -1, 0, colour=4.6), False),
    "OBLIQUE_EDGE_SEEN": (end(0, 0, 0, 1, 0, maybe=True), end(1, 150, 0, -1, 0), True),
    "OBLIQUE_EDGE_SEEN_OTHER_COLOUR": (end(0, 0, 0, 1, 0, maybe=True), end(1, 150, 0, -1, 0, colour=4.6), False),
    "TOO_FAR": (end(0, 0, 0, 1, 0, EndKind.HIDDEN), end(1, 500, 0, -1, 0, EndKind.HIDDEN), False),
    "SIDEWAYS": (end(0, 0, 0, 1, 0, EndKind.HIDDEN), end(1, 10, 150, -1, 0, EndKind.HIDDEN), False),
    "TURNED": (end(0, 0, 0, 1, 0), end(1, 30, 0, 0, 1), False),
    "OTHER_WIDTH": (end(0, 0, 0, 1, 0), end(1, 30, 0, -1, 0, width=30.0), False),
    "BENT_UNDER_A_PLATE": (end(0, 0, 0, 1, -1, EndKind.HIDDEN), end(1, 160, 0, -1, -1, EndKind.HIDDEN), True),
    "BENT_IN_THE_OPEN": (end(0, 0, 0, 1, -1), end(1, 160, 0, -1, -1), False),
    "BENT_OTHER_COLOUR": (
        end(0, 0, 0, 1, -1, EndKind.HIDDEN),
        end(1, 160, 0, -1, -1, EndKind.HIDDEN, colour=4.6),
        False,
    ),
    "BENT_MORE_THAN_A_DLO_DOES": (
        end(0, 0, 0, 1, -1, EndKind.HIDDEN),
        end(1, 60, 0, -1, -1, EndKind.HIDDEN),
        False,
    ),
    "U_TURN": (end(0, 0, 0, 1, -4, EndKind.HIDDEN), end(1, 160, 0, -1, -4, EndKind.HIDDEN), False),
    "THROUGH_A_GRIPPER_ONTO_ITS_ARM": (
        end(0, 0, 0, 1, 0, EndKind.HELD),
        replace(end(1, 150, 0, -1, 0, EndKind.HELD), rigid=True),
        False,
    ),
    "AT_THE_BORDER": (end(0, 0, 0, 1, 0, EndKind.BORDER), end(1, 30, 0, -1, 0), False),
}


@pytest.mark.parametrize("case", CASES)
def test_candidates(case):
    a, b, expected = CASES[case]
    assert is_candidate(a, b, D_MAX, PARAMS) is expected
    assert is_candidate(b, a, D_MAX, PARAMS) is expected


def test_a_gap_that_known_things_hide_needs_no_other_sign():
    a, b = end(0, 100, 50, 1, 0), end(1, 250, 50, -1, 0)
    over_it = cover_of((120, 320), 1.0, [(np.array([[175.0, 0.0], [175.0, 119.0]]), 130.0)])
    beside_it = cover_of((120, 320), 1.0, [(np.array([[110.0, 0.0], [110.0, 119.0]]), 40.0)])
    assert is_candidate(a, b, D_MAX, PARAMS, over_it)
    assert not is_candidate(a, b, D_MAX, PARAMS, beside_it)


def test_the_end_of_like_looks_is_preferred_to_the_nearer_one():
    ends = [
        end(0, 0, 0, 1, 0, EndKind.HIDDEN),
        end(1, 90, 0, -1, 0, EndKind.HIDDEN, colour=4.3),
        end(2, 100, 0, -1, 0, EndKind.HIDDEN),
    ]
    (connection,) = connect(ends, D_MAX, PARAMS)
    assert {connection.a.segment, connection.b.segment} == {0, 2}


def test_bend_of_an_arc_is_width_over_radius():
    radius, half = 100.0, 0.4
    a = end(0, -radius * np.sin(half), 0, np.cos(half), np.sin(half))
    b = end(1, radius * np.sin(half), 0, -np.cos(half), np.sin(half))
    assert bend_w(a, b) == pytest.approx(20.0 / radius, rel=0.05)


def test_each_end_is_joined_once_and_the_best_connection_wins():
    ends = [end(0, 0, 0, 1, 0), end(1, 20, 0, -1, 0), end(2, 35, 3, -1, 0)]
    (connection,) = connect(ends, D_MAX, PARAMS)
    assert {connection.a.segment, connection.b.segment} == {0, 1}


def test_segments_are_never_joined_to_a_ring():
    ends = [
        end(0, 0, 0, 1, 0, side=1),
        end(1, 20, 0, -1, 0, side=0),
        end(1, 20, 10, -1, 0, side=1),
        end(0, 0, 10, 1, 0, side=0),
    ]
    assert len(connect(ends, D_MAX, PARAMS)) == 1


def test_bridge_leaves_and_arrives_along_the_tangents():
    start, stop = np.array([0.0, 0.0]), np.array([100.0, 40.0])
    bridge = bezier_bridge(start, np.array([1.0, 0.0]), stop, np.array([0.0, 1.0]), alpha=0.4)
    first, last = bridge[0] - start, stop - bridge[-1]
    assert first[1] / first[0] == pytest.approx(0.0, abs=0.05)
    assert last[0] / last[1] == pytest.approx(0.0, abs=0.05)
    # The middle of a cubic Bezier curve: an eighth of the ends, three eighths of the control points.
    gap = np.hypot(100, 40)
    middle = (start + stop) / 8 + 3 / 8 * (start + stop + np.array([0.4 * gap, -0.4 * gap]))
    assert np.hypot(*(bridge - middle).T).min() < 1.0
    assert len(bezier_bridge(start, np.array([1.0, 0.0]), start + 1.0, np.array([1.0, 0.0]), 0.4)) == 0
