"""Masks of single DLOs decide which branches belong together."""

from __future__ import annotations

import cv2
import numpy as np

from motiondlo.frames.instance_masks import is_made_up, single_masks
from motiondlo.frames.masks import MaskSet, ScoredMask
from motiondlo.frames.params import FrameParams, GraphParams
from motiondlo.frames.pipeline import segment_frame
from motiondlo.geometry.curve import distance_to_curve

SHAPE = (486, 648)
PAPER = (0.7, 0.72, 0.72)
RED = (0.05, 0.05, 0.45)


def stroke(points, width=16):
    mask = np.zeros(SHAPE, np.uint8)
    cv2.polylines(mask, [np.round(points).astype(np.int32).reshape(-1, 1, 2)], False, 1, width)
    return mask


class Drawn:
    name = "drawn"

    def __init__(self, *masks):
        self.masks = masks

    def segment(self, image_bgr, background, frame_name):
        return MaskSet(tuple(ScoredMask(mask, 0.9) for mask in self.masks))


def test_a_mask_of_two_dlos_is_left_out_where_both_have_their_own(curves):
    a, b = stroke(curves["line"](100, 200, 500, 200)), stroke(curves["line"](100, 300, 500, 300))
    assert is_made_up(a | b, [a, b])
    assert not is_made_up(a | b, [a])
    assert not is_made_up(a, [b, a | b])
    drawn = Drawn(a | b, a, b).segment(None, None, "")
    assert len(single_masks(drawn, SHAPE, FrameParams().cleaning)) == 2


def test_one_mask_is_not_known_to_be_one_dlo(curves):
    drawn = Drawn(stroke(curves["line"](100, 200, 500, 200))).segment(None, None, "")
    assert single_masks(drawn, SHAPE, FrameParams().cleaning) == []


def test_alike_cables_that_touch_side_by_side_come_out_as_the_masks_say(make_board, curves):
    """They come together, run in contact, and part without crossing; the union says nothing about that."""
    board = make_board(PAPER)
    u = np.linspace(0.0, 1.0, 200)
    near = 9.0 + 60.0 * np.abs(2.0 * u - 1.0) ** 3
    upper = board.cable(np.stack([80 + 480 * u, 240 - near], axis=1), 16.0, RED)
    lower = board.cable(np.stack([80 + 480 * u, 240 + near], axis=1), 16.0, RED)
    frame, plate = board.photograph(), board.photograph_plate()
    backend = Drawn(stroke(upper), stroke(lower))
    instances = segment_frame(frame, plate, None, FrameParams(), 0, "", backend).instances
    assert len(instances) == 2
    for truth in (upper, lower):
        assert min(distance_to_curve(truth, i.nodes_rgb).max() for i in instances) < 2.5


def test_the_union_of_the_paper_can_be_had(make_board, curves):
    board = make_board(PAPER)
    truth = board.cable(curves["wave"](80, 560, 240, 60), 16.0, RED)
    frame, plate = board.photograph(), board.photograph_plate()
    half = len(truth) // 2
    backend = Drawn(stroke(truth[: half + 10]), stroke(truth[half - 10 :]))
    params = FrameParams(graph=GraphParams(single_masks=False))
    (cable,) = segment_frame(frame, plate, None, params, 0, "", backend).instances
    assert distance_to_curve(truth, cable.nodes_rgb).max() < 2.0


def test_two_masks_of_one_cable_give_one_instance(make_board, curves):
    board = make_board(PAPER)
    truth = board.cable(curves["wave"](80, 560, 240, 60), 16.0, RED)
    half = len(truth) // 2
    backend = Drawn(stroke(truth[: half - 8]), stroke(truth[half + 8 :]))
    frame, plate = board.photograph(), board.photograph_plate()
    (cable,) = segment_frame(frame, plate, None, FrameParams(), 0, "", backend).instances
    assert distance_to_curve(truth, cable.nodes_rgb).max() < 2.0


def test_a_wire_in_a_models_mask_is_found(make_board, curves):
    board = make_board(PAPER)
    truth = board.cable(curves["wave"](80, 560, 240, 60), 4.0, RED)
    backend = Drawn(stroke(truth, 4))
    frame, plate = board.photograph(), board.photograph_plate()
    (wire,) = segment_frame(frame, plate, None, FrameParams(), 0, "", backend).instances
    assert distance_to_curve(truth[5:-5], wire.nodes_rgb).max() < 2.0
