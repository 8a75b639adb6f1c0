"""Plates on the empty board's picture: a step under an end, told from lines and texture."""

from __future__ import annotations

import numpy as np
import pytest

from motiondlo.frames.board import model_board
from motiondlo.frames.board_edges import on_board_edge
from motiondlo.frames.params import FrameParams
from motiondlo.frames.pipeline import segment_frame
from motiondlo.frames.strip import Scene
from motiondlo.geometry.curve import distance_to_curve

GREY = (0.3, 0.3, 0.3)
BLUE = (0.5, 0.15, 0.05)
WIDTH = 14.0


def scene_of(board, with_plate=True):
    frame, plate = board.photograph(), board.photograph_plate()
    background = plate if with_plate else None
    return Scene(frame, background, model_board(frame, background, FrameParams().foreground))


def lay_plate(board, x0=280, x1=400):
    """A metal plate from top to bottom, in the frame and in the picture of the empty board."""
    for light in (board.light, board.plate):
        light[:, x0:x1] = np.asarray(GREY) * 1.25


PLACES = {
    "ON_THE_PLATES_EDGE": ((280.0, 200.0), True),
    "A_FEW_PX_BESIDE_IT": ((275.0, 200.0), True),
    "ON_THE_OPEN_BOARD": ((200.0, 200.0), False),
    "ON_A_PRINTED_LINE": ((101.0, 200.0), False),
    "IN_THE_IMAGES_CORNER": ((2.0, 2.0), False),
}


@pytest.mark.parametrize("case", PLACES)
def test_steps_of_the_board_are_told_from_lines(make_board, case):
    place, expected = PLACES[case]
    board = make_board(GREY)
    board.light[:, 100:103] *= 1.5
    board.plate = board.light.copy()
    lay_plate(board)
    assert on_board_edge(scene_of(board), np.array(place), WIDTH) is expected


def test_without_a_picture_of_the_empty_board_nothing_is_known(make_board):
    board = make_board(GREY)
    lay_plate(board)
    assert not on_board_edge(scene_of(board, with_plate=False), np.array([280.0, 200.0]), WIDTH)


def test_a_cable_that_runs_obliquely_under_a_plate_of_the_empty_board_is_one_instance(make_board):
    board = make_board(GREY)
    angle = np.linspace(0.15, 2.2, 200)
    truth = board.cable(np.stack([220 + 260 * np.cos(angle), 60 + 300 * np.sin(angle)], axis=1), WIDTH, BLUE)
    lay_plate(board, 250, 350)
    found = segment_frame(board.photograph(), board.photograph_plate(), None, FrameParams(), 0, "").instances
    assert len(found) == 1
    seen = truth[(truth[:, 0] < 245) | (truth[:, 0] > 355)]
    assert distance_to_curve(seen[3:-3], found[0].nodes_rgb).max() < 2.0
    assert distance_to_curve(truth[3:-3], found[0].nodes_rgb).max() < 12.0
