"""Lens and plane files of a cell: what the doctor says of them, and that the cell uses them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from motiondlo.bundled import bundled_recording
from motiondlo.config.cell import load_cell
from motiondlo.errors import ConfigError
from motiondlo.geometry.camera_map import CameraMap, map_points
from motiondlo.geometry.homography import warp_points
from motiondlo_services.doctor.cell import check_cell
from motiondlo_services.doctor.findings import Verdict
from motiondlo_services.replay_cell import write_replay_cell

LENS = {
    "width": 1280,
    "height": 720,
    "camera_matrix": [[1230, 0, 637], [0, 1230, 363], [0, 0, 1]],
    "distortion": [-0.1, 0, 0, 0],
}


def cell_with(tmp_path: Path, **calibration: Any) -> Path:
    return write_replay_cell(tmp_path / "c.toml", bundled_recording(), sections={"calibration": calibration})


def finding(path: Path, subject: str) -> tuple[Verdict, str]:
    found = [f for f in check_cell(path) if f.subject == subject]
    assert len(found) == 1
    return found[0].verdict, found[0].what


def test_a_lens_is_judged_and_used(tmp_path: Path) -> None:
    (tmp_path / "event.json").write_text(json.dumps(LENS))
    path = cell_with(tmp_path, event_lens="event.json")
    verdict, what = finding(path, "event lens")
    assert verdict == Verdict.OK
    assert "moves points by up to" in what
    cell = load_cell(path)
    camera_map = cell.event_map()
    assert isinstance(camera_map, CameraMap)
    point = np.array([[200.0, 300.0]])
    assert np.hypot(*(map_points(point, camera_map) - warp_points(point, cell.event_from_rgb())).T) > 3.0


def test_without_lens_files_nothing_is_said_and_the_matrix_is_used(tmp_path: Path) -> None:
    path = cell_with(tmp_path)
    assert isinstance(load_cell(path).event_map(), np.ndarray)
    assert not [f for f in check_cell(path) if "lens" in f.subject]


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({"width": 640, "camera_matrix": [[600, 0, 320], [0, 600, 300], [0, 0, 1]]}, Verdict.FAILURE),
        ({"distortion": [9.0, 0, 0, 0]}, Verdict.FAILURE),
        ({"distortion": [1.5, 0, 0, 0]}, Verdict.FAILURE),
    ],
)
def test_a_lens_that_cannot_be_is_found(tmp_path: Path, changes: dict[str, Any], verdict: Verdict) -> None:
    (tmp_path / "event.json").write_text(json.dumps(LENS | changes))
    assert finding(cell_with(tmp_path, event_lens="event.json"), "event lens")[0] == verdict


def test_a_missing_lens_is_found(tmp_path: Path) -> None:
    verdict, what = finding(cell_with(tmp_path, rgb_lens="none.json"), "rgb lens")
    assert verdict == Verdict.FAILURE
    assert "none.json" in what


def test_a_plane_file_gives_mm(tmp_path: Path) -> None:
    matrix = [[0.185, 0.001, -3.0], [0.0, 0.187, 1.0], [2e-5, 1e-5, 1.0]]
    (tmp_path / "plane.json").write_text(json.dumps({"mm_from_event": matrix}))
    path = cell_with(tmp_path, work_plane="plane.json")
    assert finding(path, "scale")[0] == Verdict.OK
    plane = load_cell(path).work_plane()
    assert plane is not None
    assert np.allclose(plane.mm(np.array([[100.0, 50.0]])), warp_points(np.array([[100.0, 50.0]]), np.array(matrix)))


@pytest.mark.parametrize("matrix", [[[1e-6, 0, 0], [0, 1e-6, 0], [0, 0, 1]], [[0.2, 0, 0], [0, 0.2, 0], [2e-3, 0, 1]]])
def test_an_implausible_plane_is_found(tmp_path: Path, matrix: list[list[float]]) -> None:
    (tmp_path / "plane.json").write_text(json.dumps({"mm_from_event": matrix}))
    verdict, what = finding(cell_with(tmp_path, work_plane="plane.json"), "scale")
    assert verdict == Verdict.FAILURE
    assert "not plausible" in what


def test_plane_and_scale_together_are_refused(tmp_path: Path) -> None:
    (tmp_path / "plane.json").write_text('{"px_per_mm": 5.4}')
    path = cell_with(tmp_path, work_plane="plane.json", px_per_mm=5.0)
    with pytest.raises(ConfigError, match="both work_plane and px_per_mm"):
        load_cell(path).work_plane()
    assert finding(path, "scale")[0] == Verdict.FAILURE
