"""First frames of simulated recordings against the truth: the shapes that trackers start from."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from motiondlo.frames.params import FrameParams
from motiondlo.frames.pipeline import segment_frame
from motiondlo.frames.types import EndKind
from motiondlo.geometry.curve import distance_to_curve, project
from motiondlo.geometry.homography import warp_points
from motiondlo.recording.layout import open_recording, read_image

# Mean distance of nodes to the true centreline, mm: with the recording's homography, and with the exact one.
BOUNDS_MM = {
    "quad_dlo1_speed75": (0.35, 0.35),
    "occlusion": (0.20, 0.15),
    "loop": (0.20, 0.15),
}


def first_segmentation(folder: Path, with_plate: bool):
    recording = open_recording(folder)
    frame = recording.frames[0]
    image = read_image(frame.path)
    plate = recording.background() if with_plate else None
    return segment_frame(image, plate, recording.event_from_rgb(), FrameParams(), frame.t_us, frame.name)


@pytest.mark.shared_data
@pytest.mark.parametrize("with_plate", [True, False])
@pytest.mark.parametrize("name", BOUNDS_MM)
def test_every_cable_is_found_once_and_where_it_is(shared_data, name, with_plate):
    result = first_segmentation(shared_data / name, with_plate)
    truth = np.load(shared_data / name / "ground_truth.npz")
    px_per_mm = float(truth["px_per_mm"])
    nodes, visible = truth["nodes"][:, 0].astype(np.float64), truth["visibility"][:, 0] == 0
    seen = [k for k in range(len(nodes)) if visible[k].sum() > 10]
    assert len(result.instances) == len(seen)
    taken = set()
    for k in seen:
        gaps = [distance_to_curve(nodes[k][visible[k]], i.nodes_event).mean() for i in result.instances]
        taken.add(int(np.argmin(gaps)))
        cable = result.instances[int(np.argmin(gaps))]
        assert min(gaps) / px_per_mm < 0.5
        for nodes_event, bound in zip(
            (cable.nodes_event, warp_points(cable.nodes_rgb, truth["H_true"])), BOUNDS_MM[name], strict=True
        ):
            distance, place = project(nodes_event, nodes[k])
            length = np.hypot(*np.diff(nodes[k], axis=0).T).sum()
            at = np.round(place / length * (len(nodes[k]) - 1)).astype(int)
            inside = (nodes_event >= 0).all(axis=1) & (nodes_event < (1280, 720)).all(axis=1)
            assert distance[visible[k][at] & inside].mean() / px_per_mm < bound
        assert cable.diameter_px / px_per_mm == pytest.approx(float(truth["diameters_mm"][k]), rel=0.1)
    assert len(taken) == len(seen)


@pytest.mark.shared_data
def test_the_moved_cable_of_the_loop_is_held_at_one_end(shared_data):
    (cable,) = first_segmentation(shared_data / "loop", with_plate=True).instances
    assert sorted(cable.ends) == [EndKind.HELD, EndKind.TIP]
    info = json.loads((shared_data / "loop" / "camera_info.json").read_text())
    assert cable.appearance is not None
    assert cable.appearance.strip.shape[0] > 2 * cable.diameter_px
    assert info["rgb"]["width"] == 1296
