"""Wires: found against the empty board's picture, told from printed lines and from grooves."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.frames.board import model_board
from motiondlo.frames.params import FrameParams
from motiondlo.frames.pipeline import segment_frame
from motiondlo.frames.strip import Scene
from motiondlo.frames.thin import beside, ridge_strength
from motiondlo.frames.types import EndKind
from motiondlo.geometry.curve import distance_to_curve

GREY = (0.4, 0.4, 0.4)
BLACK = (0.03, 0.03, 0.03)
WHITE = (0.8, 0.8, 0.8)


def segment(board, with_plate=True):
    plate = board.photograph_plate() if with_plate else None
    return segment_frame(board.photograph(), plate, None, FrameParams(), 0, "frame")


def print_lines(board):
    """A mat's lines, on the board itself: in the frame and in the picture of the empty board."""
    for x in range(40, 648, 60):
        board.light[:, x : x + 2] *= 1.25
    board.plate = board.light.copy()


@pytest.mark.parametrize("bgr", [BLACK, (0.1, 0.1, 0.5), (0.6, 0.2, 0.1)])
def test_a_wire_on_a_board_with_lines_is_found_from_tip_to_tip(make_board, curves, bgr):
    board = make_board(GREY)
    print_lines(board)
    centre = board.cable(curves["wave"](80, 560, 240, 70), 3.0, bgr)
    (wire,) = segment(board).instances
    assert distance_to_curve(wire.nodes_rgb, centre).mean() < 0.4
    assert distance_to_curve(centre, wire.nodes_rgb).max() < 3.0
    assert wire.ends == (EndKind.TIP, EndKind.TIP)
    assert wire.width_rgb_px == pytest.approx(3.0, abs=1.0)


def test_a_wire_whose_highlight_is_stronger_than_its_own_edges_is_found(make_board, curves):
    board = make_board(GREY)
    path = curves["wave"](80, 560, 240, 70)
    centre = board.cable(path, 5.0, (0.12, 0.1, 0.08))
    board.cable(path - (0.8, 0.8), 1.6, (2.0, 2.0, 2.0))
    (wire,) = segment(board).instances
    assert distance_to_curve(wire.nodes_rgb, centre).mean() < 1.2


def test_two_wires_side_by_side_are_two(make_board, curves):
    board = make_board(GREY)
    first = board.cable(curves["line"](80, 150, 560, 200), 3.0, BLACK)
    second = board.cable(curves["line"](80, 250, 560, 230), 3.0, WHITE)
    found = segment(board).instances
    assert len(found) == 2
    for centre in (first, second):
        assert min(distance_to_curve(centre, wire.nodes_rgb).mean() for wire in found) < 0.6


def test_lines_without_a_picture_of_the_empty_board_are_no_wires(make_board):
    board = make_board(GREY)
    print_lines(board)
    assert segment(board, with_plate=False).failure == "nothing_found"


def test_a_groove_in_something_of_the_boards_colour_is_no_wire(make_board, curves):
    board = make_board(GREY)
    board.light[180:260, 100:560] = np.asarray(GREY) * 1.08
    board.cable(curves["line"](110, 220, 550, 220), 3.0, BLACK)
    assert segment(board).failure == "nothing_found"


def test_what_lies_beside_a_wire_is_the_board(make_board, curves):
    board = make_board(GREY)
    centre = board.cable(curves["line"](80, 240, 560, 240), 3.0, BLACK)
    model = model_board(board.photograph(), board.photograph_plate(), FrameParams().foreground)
    scene = Scene(board.photograph(), board.photograph_plate(), model)
    assert beside(scene, centre, 3.0) < 0.014


def test_light_that_changes_slowly_is_no_ridge(make_board):
    board = make_board(GREY)
    board.light = board.light * (1.0 + 0.3 * np.sin(np.linspace(0.0, 12.0, 648)))[None, :, None]
    model = model_board(board.photograph(), board.photograph_plate(), FrameParams().foreground)
    assert float(np.percentile(ridge_strength(model), 99.9)) < 0.1


def test_a_straight_block_that_is_held_is_no_dlo(make_board, curves):
    board = make_board(GREY)
    wire = board.cable(curves["wave"](200, 560, 240, 50), 3.0, BLACK)
    board.box(60, 222, 110, 24, (0.8, 0.8, 0.8))
    board.box(150, 200, 55, 70, (0.15, 0.15, 0.15))
    (found,) = segment(board).instances
    assert distance_to_curve(found.nodes_rgb, wire).mean() < 0.6
    assert EndKind.HELD in found.ends
