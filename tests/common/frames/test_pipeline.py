"""The frame branch as a whole, on drawn boards."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motiondlo.errors import ConfigError
from motiondlo.frames.masks import MaskSet, ScoredMask
from motiondlo.frames.params import FrameParams
from motiondlo.frames.pipeline import StageTimes, segment_frame
from motiondlo.frames.types import EndKind, Instance
from motiondlo.geometry.curve import distance_to_curve
from motiondlo.geometry.homography import warp_points

PAPER = (0.7, 0.72, 0.72)
GREY = (0.3, 0.3, 0.3)
BLACK = (0.03, 0.03, 0.03)
RED = (0.05, 0.05, 0.45)
PARAMS = FrameParams()


def found(frame, plate, **changes):
    return segment_frame(frame, plate, None, PARAMS.model_copy(update=changes), 1000, "frame_000001.jpg")


def nearest(instances: tuple[Instance, ...], truth) -> Instance:
    return min(instances, key=lambda i: distance_to_curve(truth, i.nodes_rgb).mean())


@pytest.mark.parametrize("with_plate", [True, False])
def test_one_cable_within_a_fifth_of_a_pixel_from_tip_to_tip(make_board, curves, with_plate):
    board = make_board(PAPER)
    truth = board.cable(curves["wave"](80, 560, 240, 60), 16.0, RED)
    result = found(board.photograph(), board.photograph_plate() if with_plate else None)
    assert result.failure == ""
    assert result.t_us == 1000
    (cable,) = result.instances
    assert distance_to_curve(cable.nodes_rgb, truth).mean() < 0.2
    ends = sorted([cable.nodes_rgb[0], cable.nodes_rgb[-1]], key=lambda p: p[0])
    assert np.hypot(*(ends[0] - truth[0])) < 1.5
    assert np.hypot(*(ends[1] - truth[-1])) < 1.5
    assert cable.ends == (EndKind.TIP, EndKind.TIP)
    assert cable.width_rgb_px == pytest.approx(16.0, abs=0.8)
    steps = np.hypot(*np.diff(cable.nodes_rgb, axis=0).T)
    assert np.ptp(steps) < 0.05 * steps.mean()
    assert cable.sigma_px.shape == (PARAMS.fit.nodes,)


def test_another_exposure_than_the_plate_and_flicker_on_a_part_of_the_board(make_board, curves):
    board = make_board(PAPER)
    truth = board.cable(curves["wave"](80, 560, 240, 60), 16.0, (0.3, 0.2, 0.05))
    plate = board.photograph_plate()
    board.light[:, 400:] *= 0.9
    result = found(board.photograph(exposure=0.75), plate)
    assert len(result.instances) == 1
    assert distance_to_curve(truth, result.instances[0].nodes_rgb).mean() < 0.5


def test_crossing_cables_are_two_instances(make_board, curves):
    board = make_board(PAPER)
    first = board.cable(curves["line"](120, 100, 540, 390), 15.0, BLACK)
    second = board.cable(curves["line"](110, 360, 560, 130), 15.0, BLACK)
    result = found(board.photograph(), board.photograph_plate())
    assert len(result.instances) == 2
    for truth in (first, second):
        cable = nearest(result.instances, truth)
        assert distance_to_curve(truth, cable.nodes_rgb).mean() < 0.4
        assert distance_to_curve(cable.nodes_rgb, truth).max() < 1.5


def test_a_cable_that_crosses_itself_is_one_instance(make_board):
    board = make_board(PAPER)
    u = np.linspace(-1.0, 1.0, 400)
    angle = 1.5 * np.pi * u
    loop = np.stack([324 + 330 * u - 130 * np.sin(angle), 250 - 90 * np.cos(angle)], axis=1)
    truth = board.cable(loop, 14.0, BLACK)
    result = found(board.photograph(), board.photograph_plate())
    (cable,) = result.instances
    inside = truth[(truth[:, 0] > 0) & (truth[:, 0] < 647)]
    assert distance_to_curve(inside, cable.nodes_rgb).mean() < 0.5
    assert len(cable.nodes_rgb) == PARAMS.fit.nodes


def test_gripper_and_label_are_no_cables_and_the_held_end_reaches_the_gripper(make_board, curves):
    board = make_board(PAPER)
    truth = board.cable(curves["wave"](90, 480, 250, 40), 16.0, RED)
    board.box(450, 205, 110, 90, (0.2, 0.2, 0.2))
    board.box(60, 60, 40, 60, (0.1, 0.5, 0.2))
    result = found(board.photograph(), board.photograph_plate())
    (cable,) = result.instances
    right = 0 if cable.nodes_rgb[0, 0] > cable.nodes_rgb[-1, 0] else -1
    assert cable.ends[right] is EndKind.HELD
    assert cable.nodes_rgb[right, 0] == pytest.approx(450.0, abs=2.5)
    visible = truth[truth[:, 0] < 449]
    assert distance_to_curve(visible, cable.nodes_rgb).mean() < 0.4


def test_a_bent_cable_under_another_one_is_one_instance(make_board, curves):
    board = make_board((0.5, 0.5, 0.5))
    angle = np.linspace(-0.2, np.pi + 0.2, 200)
    under = board.cable(np.stack([320 + 170 * np.cos(angle), 350 - 200 * np.sin(angle)], axis=1), 14.0, (0.1, 0.2, 0.5))
    board.cable(curves["line"](290, 60, 350, 420), 24.0, (0.5, 0.1, 0.1))
    instances = found(board.photograph(), board.photograph_plate()).instances
    assert len(instances) == 2
    cable = nearest(instances, under)
    assert distance_to_curve(under[3:-3], cable.nodes_rgb).max() < 3.0


def test_a_cable_that_leaves_the_image_ends_at_the_border(make_board, curves):
    board = make_board(PAPER)
    board.cable(curves["line"](300, 200, 720, 260), 16.0, BLACK)
    (cable,) = found(board.photograph(), board.photograph_plate()).instances
    right = 0 if cable.nodes_rgb[0, 0] > cable.nodes_rgb[-1, 0] else -1
    assert cable.ends[right] is EndKind.BORDER
    assert cable.nodes_rgb[right, 0] > 645.0


def test_grey_cable_on_a_grey_board_is_found_by_its_shading(make_board, curves):
    board = make_board(GREY)
    truth = board.cable(curves["line"](120, 380, 520, 110), 16.0, (0.24, 0.24, 0.24))
    frame, plate = board.photograph(), board.photograph_plate()
    (cable,) = found(frame, plate).instances
    assert distance_to_curve(truth, cable.nodes_rgb).mean() < 1.5
    without = PARAMS.faint.model_copy(update={"enabled": False})
    assert found(frame, plate, faint=without).failure == "nothing_found"


def test_shadow_alone_is_no_cable(make_board, curves):
    board = make_board(PAPER)
    centre = curves["wave"](80, 560, 240, 60)
    stroke = np.zeros(board.light.shape[:2], np.float32)
    cv2.polylines(stroke, [np.round(centre).astype(np.int32).reshape(-1, 1, 2)], False, 1.0, 16)
    board.light *= (1.0 - 0.35 * cv2.GaussianBlur(stroke, (0, 0), 2.0))[..., None]
    assert found(board.photograph(), board.photograph_plate()).failure == "nothing_found"
    assert found(board.photograph(), None).failure == "nothing_found"


def test_nodes_and_widths_are_warped_by_the_homography_as_points(make_board, curves):
    board = make_board(PAPER)
    board.cable(curves["wave"](80, 560, 240, 60), 16.0, RED)
    event_from_rgb = np.array([[2.0, 0.02, -50.0], [-0.01, 2.0, -120.0], [1e-5, 0.0, 1.0]])
    frame = board.photograph()
    (plain,) = found(frame, None).instances
    (cable,) = segment_frame(frame, None, event_from_rgb, PARAMS, 0, "").instances
    assert plain.nodes_event is None
    np.testing.assert_allclose(cable.nodes_event, warp_points(cable.nodes_rgb, event_from_rgb))
    assert cable.diameter_px == pytest.approx(2.0 * cable.width_rgb_px, rel=0.03)
    assert np.median(cable.sigma_px / plain.sigma_px) == pytest.approx(2.0, rel=0.05)
    assert cable.appearance is not None


FAILURES = {
    "BLACK": (np.zeros((486, 648, 3), np.uint8), None, "black"),
    "SATURATED": (np.full((486, 648, 3), 255, np.uint8), None, "saturated"),
    "EMPTY_BOARD": (np.full((486, 648, 3), 120, np.uint8), None, "nothing_found"),
    "GREY_IMAGE": (np.full((486, 648), 120, np.uint8), None, "wrong_size"),
    "TINY": (np.full((20, 20, 3), 120, np.uint8), None, "wrong_size"),
    "OTHER_PLATE": (np.full((486, 648, 3), 120, np.uint8), np.zeros((100, 100, 3), np.uint8), "wrong_size"),
}


@pytest.mark.parametrize("scenario", FAILURES)
def test_frames_that_give_nothing_say_why(scenario):
    frame, plate, reason = FAILURES[scenario]
    result = found(frame, plate)
    assert result.failure == reason
    assert result.instances == ()
    assert result.backend == "classical"


def test_cable_smeared_by_motion_is_refused_as_blurred(make_board, curves):
    board = make_board(PAPER)
    plate = board.photograph_plate()
    board.cable(curves["line"](100, 240, 560, 250), 18.0, BLACK)
    board.light = cv2.blur(board.light, (1, 11))
    assert found(board.photograph(), plate).failure == "blurred"


def test_masks_of_another_backend_go_the_same_way(make_board, curves):
    class Drawn:
        name = "drawn"

        def segment(self, image_bgr, background, frame_name):
            mask = np.zeros((1944 // 2, 2592 // 2), np.uint8)
            points = np.round(2 * curves["wave"](80, 560, 240, 60) + 0.5).astype(np.int32)
            cv2.polylines(mask, [points.reshape(-1, 1, 2)], False, 1, 26)
            return MaskSet((ScoredMask(mask, 0.9),))

    board = make_board(PAPER)
    truth = board.cable(curves["wave"](80, 560, 240, 60), 16.0, RED)
    result = segment_frame(board.photograph(), None, None, PARAMS, 0, "", Drawn())
    assert result.backend == "drawn"
    assert distance_to_curve(truth, result.instances[0].nodes_rgb).mean() < 0.4


def test_same_input_gives_the_same_result_and_the_time_of_every_stage(make_board, curves):
    board = make_board(PAPER)
    board.cable(curves["wave"](80, 560, 240, 60), 16.0, RED)
    frame = board.photograph()
    times = StageTimes()
    first = segment_frame(frame, None, None, PARAMS, 0, "", times=times)
    second = segment_frame(frame, None, None, PARAMS, 0, "")
    np.testing.assert_array_equal(first.instances[0].nodes_rgb, second.instances[0].nodes_rgb)
    assert {"board", "segment", "clean", "thin", "graph", "refine", "fit"} <= times.ns.keys()
    assert first.elapsed_ms == pytest.approx(times.total_ms)


def test_unknown_backend_is_refused_with_the_known_names():
    with pytest.raises(ConfigError, match="classical"):
        found(np.full((486, 648, 3), 120, np.uint8), None, backend="magic")
