"""Chains of two DLOs are taken apart at their kink; bends of one DLO are not."""

from __future__ import annotations

import numpy as np

from motiondlo.frames.chain_splitting import split_at_kinks
from motiondlo.frames.traversal import Chain
from motiondlo.geometry.curve import resample

WIDTH = 12.0


def chain(*corners):
    path = resample(np.array(corners, float), int(np.hypot(*np.diff(np.array(corners, float), axis=0).T).sum()))
    return Chain(path, np.full(len(path), 0.5 * WIDTH))


def test_a_straight_chain_stays_whole():
    whole = chain((0, 0), (200, 0))
    assert split_at_kinks(whole, 1.0) == [whole]


def test_a_bend_of_two_widths_radius_stays_whole():
    angle = np.linspace(0.0, np.pi, 120)
    whole = chain(*np.stack([2.0 * WIDTH * np.cos(angle), 2.0 * WIDTH * np.sin(angle)], axis=1))
    assert len(split_at_kinks(whole, 1.0)) == 1


def test_a_kink_gives_two_pieces_that_meet_there():
    first, second = split_at_kinks(chain((0, 0), (120, 0), (120, 140)), 1.0)
    assert np.hypot(*(first.path[-1] - (120, 0))) < 0.3 * WIDTH
    assert np.hypot(*(second.path[0] - (120, 0))) < 0.3 * WIDTH
    assert first.width == second.width == WIDTH


def test_two_kinks_give_three_pieces():
    assert len(split_at_kinks(chain((0, 0), (120, 0), (120, 140), (260, 140)), 1.0)) == 3
