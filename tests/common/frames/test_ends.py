"""Where a followed end stops: in the shade of a gripper, under a jaw, at a tip."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.frames.board import model_board
from motiondlo.frames.covers import cover_of
from motiondlo.frames.ends import follow_end, learn_palette
from motiondlo.frames.params import FrameParams
from motiondlo.frames.strip import Scene

GREEN = (0.16, 0.38, 0.2)
BLUE = (0.5, 0.3, 0.1)
WIDTH = 14.0
REACH_PX = 60.0


def follow(board, to_x, wide=None):
    """Follow a horizontal cable at y = 240, known from x = 160 to ``to_x``. Returns the end's x and what was said."""
    frame, plate = board.photograph(), board.photograph_plate()
    scene = Scene(frame, plate, model_board(frame, plate, FrameParams().foreground), wide)
    centre = np.stack([np.arange(160.0, to_x, 2.0), np.full(len(np.arange(160.0, to_x, 2.0)), 240.0)], axis=1)
    end = follow_end(scene, centre, 1, learn_palette(scene, centre, WIDTH), REACH_PX)
    return (end.extension[-1, 0] if len(end.extension) else centre[-1, 0] - end.cut_px), end


def test_a_tip_is_found_to_a_pixel(make_board, curves):
    board = make_board(GREEN)
    board.cable(curves["line"](120, 240, 520, 240), WIDTH, BLUE)
    x, end = follow(board, 480)
    assert end.found
    assert x == pytest.approx(520.0, abs=1.0)


def test_in_the_shade_of_a_gripper_the_cable_goes_on_to_where_it_stops_being_seen(make_board, curves):
    board = make_board(GREEN)
    board.cable(curves["line"](120, 240, 520, 240), WIDTH, BLUE)
    # The light fades, then a jaw covers a part of the width, then the gripper's body covers all of it.
    board.light[:, 440:470] *= np.linspace(1.0, 0.45, 30)[:, None]
    board.light[:, 470:] *= 0.45
    board.box(455, 208, 36, 30, (0.35, 0.35, 0.35))
    board.box(466, 205, 100, 70, (0.5, 0.5, 0.5))
    x, end = follow(board, 430)
    assert end.found
    assert x == pytest.approx(465.5, abs=2.0)


def test_over_what_is_wider_than_any_dlo_an_end_is_followed_no_farther_than_its_reach(make_board, curves):
    board = make_board(GREEN)
    board.cable(curves["line"](120, 240, 600, 240), WIDTH, BLUE)
    everywhere = cover_of((486, 648), 1.0, [(np.array([[0.0, 240.0], [640.0, 240.0]]), 90.0)])
    free, _ = follow(board, 300)
    held_back, _ = follow(board, 300, everywhere)
    assert free == pytest.approx(600.0, abs=1.0)
    assert held_back < 300.0 + REACH_PX + 2.0 * WIDTH
