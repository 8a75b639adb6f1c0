from __future__ import annotations

import cv2
import numpy as np
import pytest

from motiondlo.drawing.event_image import event_image
from motiondlo.drawing.overlay import DrawnDlo, overlay, png_bytes, write_png
from motiondlo.drawing.palette import as_hex, colour_of
from motiondlo.errors import MotionDLOError
from motiondlo.events.types import SensorGeometry, empty_events

GREY = np.full((720, 1280, 3), 128, np.uint8)


def _straight(y):
    return np.stack([np.linspace(100.0, 500.0, 20), np.full(20, y)], axis=1)


def _is_colour(pixel, colour):
    return np.abs(pixel.astype(int) - np.array(colour)).max() <= 2


def test_line_is_where_the_nodes_are_and_the_input_stays_as_it_was():
    image = overlay(GREY, [DrawnDlo(1, _straight(200.0))])
    assert _is_colour(image[200, 310], colour_of(1))
    assert (image[260, 310] == 128).all()
    assert (GREY == 128).all()


def test_on_an_rgb_frame_nodes_pass_through_the_inverse_homography():
    event_from_rgb = np.array([[2.0, 0.0, 40.0], [0.0, 2.0, -60.0], [0.0, 0.0, 1.0]])
    image = overlay(GREY, [DrawnDlo(0, _straight(200.0))], event_from_rgb=event_from_rgb)
    assert _is_colour(image[130, 146], colour_of(0))
    assert (image[200, 310] == 128).all()


def test_band_is_two_sigmas_wide_and_absent_without_a_sigma():
    sigma = np.full(20, 8.0)
    image = overlay(GREY, [DrawnDlo(0, _straight(200.0), sigma_px=sigma)])
    assert (image[214, 310] != 128).any()
    assert (image[219, 310] == 128).all()
    for absent in (None, np.full(20, np.nan)):
        assert (overlay(GREY, [DrawnDlo(0, _straight(200.0), sigma_px=absent)])[214, 310] == 128).all()


def test_nodes_without_support_look_different():
    visible = np.ones(20, np.uint8)
    visible[10] = 0
    supported = overlay(GREY, [DrawnDlo(0, _straight(200.0))])
    hidden = overlay(GREY, [DrawnDlo(0, _straight(200.0), visible=visible)])
    x = round(float(_straight(200.0)[10, 0]))
    assert (supported[200, x] != hidden[200, x]).any()


def test_label_of_a_dlo_at_the_border_stays_in_the_image():
    nodes = np.array([[1279.0, 2.0], [600.0, 2.0]])
    plain, labelled = overlay(GREY, [DrawnDlo(0, nodes, label=" ")]), overlay(GREY, [DrawnDlo(0, nodes, label="id 0")])
    assert (plain != labelled).any()


@pytest.mark.parametrize("nodes", [np.array([[1e9, -1e9], [2e9, 5.0]]), np.full((5, 2), 100.0)])
def test_far_away_or_collapsed_chain_is_drawn_without_failure(nodes):
    assert overlay(GREY, [DrawnDlo(0, nodes, sigma_px=np.ones(len(nodes)))], truth=[nodes]).shape == GREY.shape


def test_truth_is_dashed_white():
    row = overlay(GREY, [], truth=[_straight(200.0)])[200, 110:490]
    assert (row > 240).all(axis=1).any()
    assert (row < 40).all(axis=1).any()


def test_newest_event_of_a_pixel_is_shown_and_events_off_the_sensor_are_not():
    events = empty_events(4)
    events["t"], events["x"], events["y"] = [1, 2, 3, 4], [5, 5, 9, 999], [6, 6, 6, 6]
    events["p"] = [1, 0, 1, 1]
    image = event_image(events, SensorGeometry(20, 10))
    assert image.shape == (10, 20, 3)
    assert (image[6, 9] > 200).all()
    assert image[6, 5, 0] > image[6, 5, 2]
    assert len(np.unique(image.reshape(-1, 3), axis=0)) == 3


def test_first_seven_ids_have_colours_of_their_own():
    assert len({colour_of(i) for i in range(7)}) == 7
    assert as_hex((0, 94, 213)) == "#d55e00"


def test_written_png_comes_back_and_a_wrong_place_is_one_clear_error(tmp_path):
    write_png(tmp_path / "picture.png", GREY)
    assert (cv2.imread(str(tmp_path / "picture.png")) == GREY).all()
    assert png_bytes(GREY)[:4] == b"\x89PNG"
    with pytest.raises(MotionDLOError, match="cannot be written"):
        write_png(tmp_path / "absent" / "picture.png", GREY)
